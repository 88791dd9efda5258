"""What an arm errs by alike is the same then and now: in both camera and poses of now, and no noise between them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import calibrant as cb
from calibrant.arrays import Array
from calibrant.calibrate.cell.certainty.accuracy import geometry_field
from calibrant.calibrate.cell.certainty.geometry import RADIANS, REACH
from calibrant.data import CalibrationResult, RobotPoses
from calibrant.data.details import ArmError, ArmErrors
from calibrant.geometry import se3
from calibrant.simulate.scenes import grid, gripper_poses, look_at_board, observe, standard_camera, standard_mounting
from calibrant.verification.unchanged.compare import on_robot, seen_now
from calibrant.verification.unchanged.robot_noise import RobotSide, robot_side
from calibrant.verification.unchanged.spread import spread_of

VIEWS = 20
POINTS = grid(9, 7, 0.03)
HELD = 1e-3


@cache
def worked(setup: str) -> tuple[CalibrationResult, Array, Array]:
    """A calibration by an arm that is off by a pattern of its field, with the poses that it says, three of now behind
    them, and what it errs by at each, (n, 6)."""
    rng, camera = np.random.default_rng(5), standard_camera()
    T = look_at_board(camera, POINTS, VIEWS + 3, rng=rng, distance=(0.4, 0.8), tilt_deg=35)
    true = gripper_poses(setup, *standard_mounting(setup), T)
    E = geometry_field(true, reach=REACH, radians=RADIANS)
    errors = E @ rng.normal(scale=HELD, size=E.shape[2])
    said = se3.retract(true, -errors)
    seen = observe(camera, POINTS, T[:VIEWS], sigma_px=0.02, rng=rng)
    result = cb.calibrate_hand_eye(RobotPoses.from_matrices(said[:VIEWS]), seen, setup=setup, camera=camera)
    held = ArmErrors({"robot": ArmError(1e3 * HELD, 0.0, 0.0, False)})
    assert result.detail(ArmErrors) is not None
    details = (*(d for d in result.details if not isinstance(d, ArmErrors)), held)
    return replace(result, details=details), said, errors


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_camera_and_target_are_off_as_the_field_says(setup: str) -> None:
    result, _, errors = worked(setup)
    side = robot_side(result, "camera")
    assert side.arm is not None
    X, Z = standard_mounting(setup)
    told = side.arm.pull @ errors[:VIEWS].ravel()
    off = np.concatenate([se3.local(side.X, X), se3.local(side.Z, Z)])
    for kind in (0, 1):  # radians, metres
        a, b = (v.reshape(2, 2, 3)[:, kind] for v in (told, off))
        assert np.linalg.norm(a - b) < 0.1 * np.linalg.norm(b)


def decided(setup: str, side: RobotSide, result: CalibrationResult, said: Array, push: Array) -> float:
    rng = np.random.default_rng(3)
    camera = standard_camera()
    T = look_at_board(camera, POINTS, VIEWS + 3, rng=np.random.default_rng(5), distance=(0.4, 0.8), tilt_deg=35)
    seen = observe(camera, POINTS, se3.inverse(push) @ T[VIEWS:], sigma_px=0.02, rng=rng)
    spread = spread_of(result, "camera", result.camera)
    return on_robot(result.camera, side, seen_now(result.camera, seen.views), said[VIEWS:], spread).decision.chance


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_an_arm_that_errs_as_it_did_hides_less_than_its_error(setup: str) -> None:
    result, said, _ = worked(setup)
    side = robot_side(result, "camera")
    assert side.arm is not None
    assert decided(setup, side, result, said, np.eye(4)) > 0.05
    push = se3.make(np.eye(3), [2e-3, 0.0, 0.0])
    seen = decided(setup, side, result, said, push)
    apart, _ = side.arm.roots(said[:0])
    C = side.covariance.copy()
    C[:12, :12] += apart @ apart.T
    assert seen < decided(setup, replace(side, covariance=C, arm=None), result, said, push)
