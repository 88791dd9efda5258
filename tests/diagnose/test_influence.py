"""What leaving a view out would move: by the linearised problem as by calibrating again without it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from tests.made_results import observed, poses_that_see

from calibrant.calibrate.cell.hand_eye import calibrate_hand_eye
from calibrant.calibrate.intrinsics.calibrate import calibrate_intrinsics
from calibrant.data import CalibrationResult, RobotPoses
from calibrant.diagnose.compare.cameras import compare_cameras
from calibrant.diagnose.influence import influence
from calibrant.geometry import se3


@pytest.mark.long
def test_a_lens_moves_as_in_a_calibration_without_the_view() -> None:
    rng = np.random.default_rng(4)
    seen = observed(poses_that_see(10, rng), rng)
    whole = calibrate_intrinsics(seen)
    by_view = {v.view: v for v in influence(whole)}
    assert set(by_view) == {v.id for v in whole.views if v.used}
    for name in ("0.png", "5.png"):
        rest = replace(seen, views=tuple(v for v in seen.views if v.id != name))
        again = compare_cameras(whole.camera, calibrate_intrinsics(rest).camera).rotated_rms_px
        assert by_view[name].px == pytest.approx(again, rel=0.2)


@pytest.mark.long
def test_a_mounting_moves_as_in_a_calibration_without_the_pose() -> None:
    rng = np.random.default_rng(5)
    B = poses_that_see(12, rng)
    X, Z = se3.make(np.eye(3), [0.03, -0.07, 0.06]), se3.make(np.eye(3), [0.6, 0.1, 0.02])
    robot = Z @ se3.inverse(B) @ se3.inverse(X)
    noise = np.concatenate([rng.normal(scale=2e-4, size=(12, 3)), rng.normal(scale=2e-4, size=(12, 3))], axis=1)
    poses = RobotPoses(tuple(f"{i}.png" for i in range(12)), se3.retract(robot, noise))
    seen = observed(B, rng)
    from tests.made_results import camera

    whole = calibrate_hand_eye(poses, seen, camera=camera(), setup="eye-in-hand")
    by_view = {v.view: v for v in influence(whole)}
    for name in ("1.png", "7.png"):
        rest = replace(seen, views=tuple(v for v in seen.views if v.id != name))
        again = calibrate_hand_eye(poses, rest, camera=camera(), setup="eye-in-hand")
        moved = again.transform("gripper", "camera").matrix[:3, 3] - whole.transform("gripper", "camera").matrix[:3, 3]
        assert by_view[name].mm == pytest.approx(1e3 * np.linalg.norm(moved), rel=0.12)


def test_results_without_what_it_takes_have_none(
    intrinsics_result: CalibrationResult, hand_eye_result: Callable[[str], CalibrationResult]
) -> None:
    assert influence(replace(intrinsics_result, observations=None)) == ()
    assert len(influence(intrinsics_result)) == sum(v.used for v in intrinsics_result.views)
    found = influence(hand_eye_result("eye-to-hand"))
    assert all(v.mm is not None and v.sigmas >= 0 for v in found)
    assert len(found) == 11
