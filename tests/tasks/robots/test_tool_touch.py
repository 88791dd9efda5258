"""Touches from the field: units in a header, poses that touch nothing, a point that moved, a bad touch."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from calibrant.calibrate.tool.moved_point import moved_point
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3, so3
from calibrant.tasks.options.poses import TouchPoseOptions
from calibrant.tasks.options.robots import RobotOptions
from calibrant.tasks.robots import tool_touch

Array = np.ndarray


def tip_of(file: Path, **form: str) -> tuple[Array, Array, str]:
    """The tip and its sigma, mm, and what is said of the touches' agreement."""
    arm = RobotOptions(robot_format=form.pop("robot_format", None))
    request = tool_touch.Request(poses=(str(file),), form=TouchPoseOptions(**form), arm=arm)
    result = tool_touch.run(request).result
    assert result is not None
    tip = result.transform("flange", "tip")
    agreement = next(c.message for c in result.checks if c.name == "agreement")
    return 1e3 * tip.matrix[:3, 3], np.asarray(tip.sigma_translation_mm), agreement


def test_a_header_with_units(shared_case: Callable[[str], Path]) -> None:
    """Right by another program: (6.1, 92.5, 307.3) mm to 3 mm."""
    file = shared_case("01-tool-touch") / "touches.csv"
    tip, sigma, _ = tip_of(file)
    np.testing.assert_allclose(tip, [6.1, 92.5, 307.3], atol=0.1)
    assert np.all(sigma < 4)
    with pytest.raises(InputError, match=r"the file says its positions are in mm.*Universal Robots"):
        tip_of(file, robot_format="ur")
    for wrong in ({"pose_rotation": "euler:xyz"}, {"pose_units": "m"}):
        with pytest.raises(RefusedError, match="agreement"):
            tip_of(file, **wrong)


def test_poses_that_touch_nothing(shared_case: Callable[[str], Path]) -> None:
    with pytest.raises(RefusedError, match="agreement: the poses agree on the tip to"):
        tip_of(shared_case("01-tool-touch") / "nothing.csv")


def test_a_point_that_moved_and_a_bad_touch(shared_case: Callable[[str], Path]) -> None:
    folder = shared_case("01-tool-touch")
    with pytest.raises(RefusedError, match=r"the touched point moved by 19.8 mm between 3 and 4"):
        tip_of(folder / "moved.csv")
    assert "3 is off by 23.1 mm, at odds with the others" in tip_of(folder / "onebad.csv")[2]


def touches(rng: np.random.Generator, n: int, *, moved: float = 0.0, slipped: float = 0.0) -> Array:
    """Poses that touch a point to 0.2 mm per axis, which moves by `moved` metres in the middle; one touch slips."""
    R = so3.exp(rng.normal(scale=0.5, size=(n, 3)))
    point = np.tile([0.4, -0.1, 0.05], (n, 1))
    point[n // 2 :] += [moved, 0.0, 0.0]
    point[1] += [0.0, slipped, 0.0]
    return se3.make(R, point + rng.normal(scale=2e-4, size=(n, 3)) - R @ [0.01, 0.09, 0.3])


def test_moves_are_told_from_slips() -> None:
    rng = np.random.default_rng(0)
    found = moved_point(touches(rng, 8, moved=0.01))
    assert found is not None
    assert found.first == 4
    assert found.mm == pytest.approx(10, abs=1.5)
    assert moved_point(touches(rng, 8, slipped=0.02)) is None


def test_touches_that_are_good_are_left_in_peace() -> None:
    """At a chance of 1e-3 a tool, one of 300 at most (P of two or more: 0.04)."""
    rng = np.random.default_rng(1)
    assert sum(moved_point(touches(rng, 8)) is not None for _ in range(300)) <= 1
