"""Bundler's bundle.out: its own equations, y up and the camera along -z, no image size, no principal point."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import calibrant as cb
from calibrant.errors import InputError
from calibrant.geometry import se3, so3

F, K1, K2 = 700.0, -0.12, 0.03
R = so3.exp([0.1, 3.0, -0.2])
T = np.array([0.3, -0.2, -1.5])
X = np.array([0.1, -0.05, 0.4])
TEXT = "\n".join(
    [
        "# Bundle file v0.3",
        "3 1",
        f"{F} {K1} {K2}",
        *(" ".join(map(repr, row.tolist())) for row in (*R, T)),
        "0 0 0\n0 0 0\n0 0 0\n0 0 0\n0 0 0",
        f"{F} {K1} {K2}\n1 0 0\n0 1 0\n0 0 1\n0 0 0",
        "0.1 0.2 0.3\n255 0 0\n1 0 5 10.5 20.5",
    ]
)
SIZE = "640x480"


def written(folder: Path, text: str = TEXT) -> Path:
    (folder / "bundle.out").write_text(text)
    return folder / "bundle.out"


def test_a_point_lands_where_bundler_says(tmp_path: Path) -> None:
    found = cb.convert(written(tmp_path), image_size=SIZE)
    P = R @ X + T
    p = -P[:2] / P[2]
    r2 = p @ p
    right, up = F * (1 + K1 * r2 + K2 * r2**2) * p
    assert P[2] < 0
    view = found.views[0]
    uv = found.cameras[str(view.camera)].project(se3.apply(view.T_camera_target, X))
    np.testing.assert_allclose(uv, [319.5 + right, 239.5 - up], atol=1e-9)
    assert ([v.id for v in found.views], len(found.cameras)) == (["0", "2"], 1)
    assert any("1 of 3 pictures" in n for n in found.notes)


def test_round_trip(tmp_path: Path) -> None:
    before = cb.convert(written(tmp_path), image_size=SIZE)
    cb.convert(tmp_path / "bundle.out", tmp_path / "again.out", to="bundler", image_size=SIZE)
    after = cb.convert(tmp_path / "again.out", image_size=SIZE)
    for a, b in zip(before.views, after.views, strict=True):
        np.testing.assert_allclose(a.T_camera_target, b.T_camera_target, atol=1e-12)
    assert after.cameras["camera_0"].parameters == before.cameras["camera_0"].parameters


def test_a_camera_that_it_cannot_say(tmp_path: Path) -> None:
    text = "1 OPENCV 640 480 500 510 321 239 0 0 0 0\n"
    (tmp_path / "m").mkdir()
    (tmp_path / "m" / "cameras.txt").write_text(text)
    (tmp_path / "m" / "images.txt").write_text("1 1 0 0 0 0 0 0 1 a.jpg\n\n")
    with pytest.raises(InputError, match="one focal length"):
        cb.convert(tmp_path / "m", tmp_path / "b.out", to="bundler")
    (tmp_path / "m" / "cameras.txt").write_text(text.replace("510", "500"))
    with pytest.raises(InputError, match="principal point"):
        cb.convert(tmp_path / "m", tmp_path / "b.out", to="bundler")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("# Bundle file v0.3\n", "second line"),
        ("# Bundle file v0.3\n900000000 3\n1 2 3", "pictures"),
        (TEXT[:200], "ends after|expected numbers"),
        (TEXT.replace(repr(F), "nan", 1), "not finite"),
        ("# Bundle file v0.3\n1 0\n700 0 0\n1 0 0\n0 1 0\n0 0 -1\n0 0 0", "mirrors"),
        ("# Bundle file v0.3\n1 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n0 0 0", "none of its 1"),
    ],
)
def test_bad_files(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        cb.convert(written(tmp_path, text), image_size=SIZE)


def test_the_size_is_asked_for(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="image size"):
        cb.convert(written(tmp_path))
