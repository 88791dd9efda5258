"""A controller that tells J3 against the ground is found out where the arm is given, and its cure is named."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.calibrate.kinematics.identify import calibrate_kinematics
from calibrant.calibrate.kinematics.result import as_result
from calibrant.data.joint_measurements import JointMeasurements
from calibrant.geometry import se3
from calibrant.robots.arms import arm

ROBOT = arm("ur5e")


def measured(sign: int) -> JointMeasurements:
    """40 poses of an arm whose joint 3 is told with joint 2 in it."""
    rng = np.random.default_rng(3)
    q = rng.uniform(-1.2, 1.2, (40, 6))
    T = se3.exp([0.1, 0.2, 0.3, 1.0, 2.0, 0.5]) @ ROBOT.forward(q) @ se3.exp([0.0, 0.0, 0.0, 0.02, 0.01, 0.15])
    told = q.copy()
    told[:, 2] += sign * told[:, 1]
    ids = tuple(map(str, range(40)))
    return JointMeasurements(ids, told, T[:, :3, 3] + 3e-5 * rng.standard_normal((40, 3)), T[:, :3, :3])


@pytest.mark.parametrize(("sign", "words"), [(1, "added"), (-1, "taken off")])
def test_coupling_is_named(sign: int, words: str) -> None:
    result = as_result(calibrate_kinematics(measured(sign), ROBOT))
    fit = next(check for check in result.checks if check.name == "fit")
    assert fit.status == "fail"
    assert f"Joint 3 is told with joint 2 {words}" in fit.message


@pytest.mark.long
def test_the_cure_works() -> None:
    cured = as_result(calibrate_kinematics(measured(1), ROBOT, identify=("offsets", "geometry", "coupling")))
    assert cured.verdict == "ok"


@pytest.mark.long
def test_rows_out_of_order_are_no_coupling() -> None:
    rows = measured(0)
    wrong = JointMeasurements(rows.ids, np.roll(rows.joints, 1, axis=0), rows.positions, rows.rotations)
    fit = next(check for check in as_result(calibrate_kinematics(wrong, ROBOT)).checks if check.name == "fit")
    assert fit.status == "fail"
    assert "told with" not in fit.message
