"""Files of one program as those of another: what is found out, what is asked, what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import calibrant as cb
from calibrant.errors import InputError

FISHEYE = """cam0:
  camera_model: ds
  intrinsics: [-0.2, 0.55, 358.6, 357.2, 367.2, 248.3]
  distortion_model: none
  resolution: [752, 480]
"""
NARROW = """cam0:
  camera_model: pinhole
  distortion_coeffs: [-0.28, 0.07, 0.0002, 2.0e-05]
  distortion_model: radtan
  intrinsics: [458.6, 457.2, 367.2, 248.3]
  resolution: [752, 480]
"""


@pytest.fixture
def narrow(tmp_path: Path) -> Path:
    file = tmp_path / "narrow.yaml"
    file.write_text(NARROW)
    return file


@pytest.mark.parametrize("name", ["opencv", "camera-info", "calibrant"])
def test_there_and_back(tmp_path: Path, narrow: Path, name: str) -> None:
    before = cb.convert(narrow).camera
    file = tmp_path / ("out.json" if name == "calibrant" else "out.yml")
    cb.convert(narrow, file, to=name)
    after = cb.convert(file).camera
    assert after.parameters == pytest.approx(before.parameters, rel=1e-15)
    assert after.image_size == before.image_size


def test_what_the_ending_cannot_tell_is_asked(tmp_path: Path, narrow: Path) -> None:
    with pytest.raises(InputError, match=r"which format shall x\.yml have\? .* opencv"):
        cb.convert(narrow, tmp_path / "x.yml")
    cb.convert(narrow, tmp_path / "x.json")
    assert json.loads((tmp_path / "x.json").read_text())["format"].startswith("calibrant/")


@pytest.mark.long
def test_a_model_that_the_format_lacks_is_refused_with_the_error_of_the_nearest(tmp_path: Path) -> None:
    source, target = tmp_path / "wide.yaml", tmp_path / "wide.yml"
    source.write_text(FISHEYE)
    with pytest.raises(
        InputError, match=r"has no double_sphere camera .cam0.; the nearest it has, [a-z_]*, would be off"
    ):
        cb.convert(source, target, to="camera-info")
    assert not target.exists()
    told = cb.convert(source, target, to="camera-info", approximate=True)
    assert told.verdict == "warn"
    wide, near = cb.convert(source).camera, cb.convert(target).camera
    uv = np.array([[10.0, 20.0], [376.0, 240.0], [700.0, 400.0]])
    away = np.linalg.norm(near.project(wide.unproject(uv)) - uv, axis=-1)
    value = told.checks[-1].value
    assert value is not None
    assert away.max() < 20 * value


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"to": "nonsense"}, "unknown format 'nonsense'; formats: .*calibrant"),
        ({"to": "described"}, "is read, not written"),
        ({"to": "opencv", "transform": "a"}, "PARENT:CHILD, got 'a'"),
        ({"to": "opencv", "answer": ["index"]}, "NAME=VALUE, got 'index'"),
        ({"to": "opencv", "choose": ["world=cam0"]}, "does not ask for 'world'"),
        ({"to": "opencv", "camera": "cam7"}, "cam7"),
        ({"to": "opencv", "read_as": "opencv-stereo"}, "no stereo pair in it"),
    ],
)
def test_options_that_cannot_be(tmp_path: Path, narrow: Path, options: dict, message: str) -> None:
    pair = tmp_path / "pair.yaml"
    pair.write_text("K1: [1, 0, 1, 0, 1, 1, 0, 0, 1]\nK2: [1, 0, 1, 0, 1, 1, 0, 0, 1]\nimage_size: [3, 3]\n")
    source = pair if "camera" in options else narrow
    with pytest.raises(InputError, match=message):
        cb.convert(source, tmp_path / "x.yml", **options)
    assert not (tmp_path / "x.yml").exists()
