"""Numbers of named columns: blanks round the names, what is missing, what is no number, what was not used."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calibrant.errors import InputError
from calibrant.reading.notes import heard
from calibrant.tasks.inputs.columns import read_columns

WANTED = ("u", "v")


def test_columns_are_found_by_name(tmp_path: Path) -> None:
    path = tmp_path / "u.csv"
    path.write_text("\ufeffimage, v ,u, by\na.png, 2, 1.5,me\nb.png, 4,-3e1,me\n", encoding="utf-8")
    with heard() as notes:
        table = read_columns(path, WANTED)
    np.testing.assert_array_equal(table.values, [[1.5, 2], [-30, 4]])
    assert table.names == ("a.png", "b.png")
    assert notes == [f"{path}: not used: by"]
    path.write_text("u,v\n1,2\n")
    assert read_columns(path, WANTED).names is None


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("u,w\n1,2\n", r"u\.csv: no column 'v'; expected the header u,v"),
        ("u,v\n", r"u\.csv: the header stands alone"),
        ("u,v\n1,2\n1,\n", r"u\.csv:3: expected a finite number in each of u, v"),
        ("u,v\n1,nan\n", r"u\.csv:2: expected a finite number"),
        ("u,v\n1\n", r"u\.csv:2: expected a finite number"),
        ("u,v,u\n1,2,3\n", r"u\.csv: the column 'u' stands there twice"),
        ("", r"u\.csv: no column 'u'"),
        ("u,v\n" + "9" * 200_000 + ",1\n", r"u\.csv:2: field larger than field limit"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "u.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=words):
        read_columns(path, WANTED)
