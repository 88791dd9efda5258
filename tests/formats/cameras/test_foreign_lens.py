"""A lens that none of our models says: one rule for every reader, its file giving pixels of rays or rays of pixels."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calibrant.errors import InputError
from calibrant.formats.exchange.exchange_format import ReadOptions
from calibrant.formats.exchange.read import read_any
from calibrant.reading.notes import heard

KALIBR = """cam0: {camera_model: pinhole, intrinsics: [300.0, 301.0, 370.0, 240.0], distortion_model: fov,
  distortion_coeffs: [0.93], resolution: [752, 480]}
"""
COLMAP = "1 FOV 752 480 300.0 301.0 370.5 240.5 0.93\n"
"""The same lens: COLMAP counts pixels from the corner."""
BOTH = pytest.mark.parametrize(("name", "text"), [("cam.yaml", KALIBR), ("cameras.txt", COLMAP)])


def put(tmp_path: Path, name: str, text: str) -> Path:
    (tmp_path / name).write_text(text)
    return tmp_path / name


@BOTH
@pytest.mark.parametrize("answers", [{}, {"approximate": "no"}, {"approximate": "no", "model": "rational"}])
def test_it_is_refused_with_its_error_where_it_was_not_asked_for(
    tmp_path: Path, name: str, text: str, answers: dict[str, str]
) -> None:
    words = r"(FOV camera|fov lens) is a model that calibrant does not have; the nearest, \w+, is off by .* px RMS and "
    with pytest.raises(InputError, match=words + r".* px at most over .*--answer approximate=yes"):
        read_any(put(tmp_path, name, text), ReadOptions(answers=answers))


@BOTH
@pytest.mark.parametrize("answers", [{"approximate": "yes"}, {"model": "rational"}])
def test_asked_for_it_is_the_nearest_within_what_is_noted(
    tmp_path: Path, name: str, text: str, answers: dict[str, str]
) -> None:
    with heard() as notes:
        (camera,) = read_any(put(tmp_path, name, text), ReadOptions(answers=answers)).cameras.values()
    (told,) = (note for note in notes if "is read as the nearest" in note)
    most = float(told.split(" px at most")[0].rsplit(" ", 1)[1])
    assert camera.model.name == answers.get("model", "kannala_brandt")
    rays = np.array([[0.3, -0.2, 1.0], [-0.5, 0.4, 1.0], [0.01, 0.02, 1.0]])
    r = np.hypot(*rays[:, :2].T)
    uv = rays[:, :2] * (np.arctan(2 * r * np.tan(0.93 / 2)) / 0.93 / r)[:, None] * [300, 301] + [370, 240]
    assert np.linalg.norm(camera.project(rays) - uv, axis=1).max() <= most < 2.0


def test_a_model_that_is_none_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="fisheye9"):
        read_any(put(tmp_path, "cam.yaml", KALIBR), ReadOptions(answers={"model": "fisheye9"}))
