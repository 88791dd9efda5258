"""The door: what is no ordinary file, or larger than its kind can be, is refused before it is read."""

from __future__ import annotations

import os
import pickle
from pathlib import Path

import pytest

from calibrant.errors import InputError
from calibrant.reading.files import Most, open_file, read_bytes, read_text


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="a system without named pipes")
def test_what_is_no_file_is_named_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(
        InputError, match=r"camera file .*pipe cannot be read: it is a pipe, expected a file; write what"
    ):
        read_text(tmp_path / "pipe", what="camera file")
    with pytest.raises(InputError, match="it is a folder"):
        open_file(tmp_path)
    with pytest.raises(InputError, match="/dev/zero cannot be read: it is a device"):
        open_file("/dev/zero")
    with pytest.raises(InputError, match="does not exist"):
        open_file(tmp_path / "none")
    with pytest.raises(InputError, match="cannot be read: embedded null byte"):
        open_file("a\0b")


def test_a_sparse_file_is_refused_by_its_size(tmp_path: Path) -> None:
    with open(tmp_path / "big.csv", "wb") as stream:
        stream.truncate(2_000_000_000)
    with pytest.raises(InputError, match=r"big\.csv has 2,000 MB; expected 64 MB at most \(a million poses as text\)"):
        read_text(tmp_path / "big.csv")
    (tmp_path / "five").write_bytes(b"12345")
    assert read_bytes(tmp_path / "five", most=Most(5, "five letters")) == b"12345"
    with pytest.raises(InputError, match=r"expected 4e-06 MB at most \(four letters\)"):
        read_bytes(tmp_path / "five", most=Most(4, "four letters"))


def test_text_is_decoded_and_other_programs_files_are_named(tmp_path: Path) -> None:
    path = tmp_path / "poses.txt"
    for encoding in ("utf-8", "utf-8-sig", "utf-16"):
        path.write_text("x, y in °\n", encoding=encoding)
        assert read_text(path) == "x, y in °\n"
    path.write_bytes(pickle.dumps([1.0, 2.0]))
    with pytest.raises(InputError, match=r"is a Python pickle: reading one can run any program.*numpy\.save"):
        read_text(path)
    path.write_bytes(b"\x89HDF\r\n\x1a\n123")
    with pytest.raises(InputError, match=r"is an HDF5 file \(or MATLAB 7\.3\); expected a table"):
        read_text(path, expected="a table")
    path.write_bytes(b"1, 2 \xb0\n")
    with pytest.raises(InputError, match="cannot be read as text: byte 5 is no UTF-8"):
        read_text(path)
    path.write_bytes(b"1\0\0")
    with pytest.raises(InputError, match="is a binary file"):
        read_text(path)
