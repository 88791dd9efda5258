"""Files as weapons: each is refused with its name, at once, and takes next to no memory."""

from __future__ import annotations

import io
import json
import os
import time
import tracemalloc
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from calibrant.data.result_file import read_result
from calibrant.errors import CalibrantError, InputError
from calibrant.formats.cameras.read import read_camera
from calibrant.formats.poses.read import read_poses
from calibrant.formats.projects.text import parse_project
from calibrant.formats.robots.read import read_robot
from calibrant.reading.files import DOCUMENT, read_text
from calibrant.targets.registry import parse_target

READERS: dict[str, Callable[[Path], object]] = {
    "poses": read_poses,
    "camera": read_camera,
    "robot": read_robot,
    "result": read_result,
    "target": lambda path: parse_target(str(path)),
    "project": lambda path: parse_project(read_text(path, most=DOCUMENT), str(path)),
}
LAUGHS = "".join(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}' if i else '1'] * 9)}]\n" for i in range(9))
MANY = 20_000
TEXTS = {
    "laughs.yaml": LAUGHS + "poses: *a8\n",
    "turns.yaml": "a: &a {poses: *a}\n",
    "deep.json": "[" * 500 + "]" * 500,
    "deeper.json": "[" * 100_000,
    "dashes.yaml": "- " * 5000 + "1\n",
    "maps.yaml": "{a: " * 500 + "1" + "}" * 500,
    "long.json": "[[" + "1" * MANY + ", 0, 0, 0, 0, 0, 1]]",
    "long.yaml": "fx: " + "1" * MANY + "\nfy: 1\ncx: 0\ncy: 0\nwidth: 5\nheight: 5\n",
    "beyond.json": '{"fx": 1e999, "fy": 1, "cx": 1, "cy": 1, "width": 2, "height": 2}',
    "p.txt": "p[" * MANY,
    "names.txt": "aaaa" * MANY + " p[",
    "blanks.txt": "p" + " " * MANY + "[",
    "digits.txt": "p[" + "1" * MANY,
    "fanuc.txt": "P[1" * MANY,
    "braces.txt": "P[1{" * MANY,
    "brackets.csv": "(" * MANY + ",y,z\n1,2,3\n",
    "entities.xml": '<!DOCTYPE a [<!ENTITY b "b"><!ENTITY c "&b;&b;">]><opencv_storage><a>&c;</a></opencv_storage>',
    "deep.xml": "<opencv_storage>" + "<a>" * 3000 + "</a>" * 3000 + "</opencv_storage>",
    "field.csv": '"' + "x" * 200_000 + '",1\n',
    "twice.json": '{"fx": 1, "fx": 2}',
    "keys.yaml": "".join(f"k{i}: 1\n" for i in range(MANY)),
    "keys.json": json.dumps({f"k{i}": i for i in range(MANY)}),
    "elements.xml": f"<opencv_storage>{''.join(f'<k{i}>1</k{i}>' for i in range(MANY))}</opencv_storage>",
    "columns.csv": ",".join(f"c{i}" for i in range(MANY)) + "\n" + ",".join("1" * MANY) + "\n",
    "sexagesimal.yaml": "a: " + "1:" * 5000 + "1\n",
}


SLOW = ("keys.yaml", "keys.json")


@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.long) if n in SLOW else n for n in TEXTS])
def test_every_reader_refuses_it_with_its_name(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_text(TEXTS[name])
    for reader in READERS.values():
        start = time.process_time()
        with pytest.raises(CalibrantError) as caught:
            reader(path)
        assert time.process_time() - start < 2.0
        assert len(str(caught.value)) < 2000


def test_archives_and_headers_that_promise_more(tmp_path: Path) -> None:
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (10**30, 4, 4)})
    (tmp_path / "shape.npy").write_bytes(header.getvalue())
    with zipfile.ZipFile(tmp_path / "bomb.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("poses.npy", header.getvalue() + bytes(64 * 2**20))
    with zipfile.ZipFile(tmp_path / "many.npz", "w") as archive:
        for i in range(5000):
            archive.writestr(f"{i}.npy", b"")
    words = {"shape.npy": "are there", "bomb.npz": "unfolds to 1 arrays of 67 MB", "many.npz": "unfolds to 5000 arrays"}
    tracemalloc.start()
    for name, message in words.items():
        with pytest.raises(InputError, match=message):
            read_poses(tmp_path / name)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 20e6


def test_files_that_name_each_other_in_a_circle(tmp_path: Path) -> None:
    for i in range(3):
        (tmp_path / f"{i}.json").write_text(json.dumps([{"pose": f"{(i + 1) % 3}.json", "image": "a.png"}]))
    with pytest.raises(InputError, match=r"2\.json: names 0\.json as the file of a pose, which leads back to it"):
        read_poses(tmp_path / "0.json")
    for i in range(9):
        (tmp_path / f"c{i}.json").write_text(json.dumps([{"pose": f"c{i + 1}.json", "image": "a.png"}]))
    with pytest.raises(InputError, match="as 4 files before it do"):
        read_poses(tmp_path / "c0.json")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="a system without named pipes")
@pytest.mark.parametrize("suffix", ["csv", "json", "yaml", "npy", "npz", "xml", "urdf", "txt"])
def test_pipes_and_sparse_files(tmp_path: Path, suffix: str) -> None:
    pipe, sparse = tmp_path / f"pipe.{suffix}", tmp_path / f"sparse.{suffix}"
    os.mkfifo(pipe)
    with open(sparse, "wb") as stream:
        stream.truncate(2_000_000_000)
    for reader in READERS.values():
        for path, words in ((pipe, "is a pipe"), (sparse, "has 2,000 MB")):
            if reader is READERS["target"] and suffix not in ("yaml",):
                continue
            with pytest.raises(InputError, match=words):
                reader(path)


def test_the_cases_from_the_field(shared_case: Callable[[str], Path]) -> None:
    """All are refused but one, whose damaged key is a mark that its matrix does not need."""
    read = []
    for path in sorted(shared_case("12-hostile-files").iterdir()):
        for name, reader in READERS.items():
            start = time.process_time()
            try:
                reader(path)
                read.append((path.name, name))
            except CalibrantError:
                pass
            assert time.process_time() - start < 2.0
    assert read == [("cam_json-17.json", "camera")]
