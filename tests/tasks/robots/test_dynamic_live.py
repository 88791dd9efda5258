"""`dynamic --live`: what is missing is named, a wanted place is read, and a cell shows all of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import calibrant as cb
from calibrant.data import CalibrationResult, as_transform
from calibrant.errors import InputError
from calibrant.tasks.robots.dynamic_live import _wanted
from calibrant.tasks.robots.dynamic_request import Request, needed


def test_what_is_missing_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no images were given"):
        cb.dynamic(target="chessboard:9x6:25mm")
    with pytest.raises(InputError, match=r"missing: --wrist, .*--poses"):
        needed(Request())
    with pytest.raises(InputError, match="go with"):
        cb.dynamic(cell=True)


def test_the_wanted_place_is_a_results_or_named(tmp_path: Path) -> None:
    T = np.eye(4)
    T[0, 3] = 1.5
    place = CalibrationResult("dynamic", "ok", transforms=(as_transform("base", "external", T),))
    assert np.array_equal(_wanted(Request(wanted=place.write(tmp_path / "place.json"))), T)
    none = CalibrationResult("hand-eye", "ok", transforms=(as_transform("gripper", "camera", T),))
    with pytest.raises(InputError, match="gripper -> camera"):
        _wanted(Request(wanted=none.write(tmp_path / "none.json")))


@pytest.mark.long
def test_a_cells_front_camera_is_located_and_led() -> None:
    pytest.importorskip("mujoco")
    result = cb.dynamic(live=True, cell=True, seed=3)
    assert result is not None
    last = result.figures["left to the wanted place"]
    assert result.figures["error of the place"].value < 4 * last.sigma
    assert last.value < 4 * last.sigma
