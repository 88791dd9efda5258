"""What leaving a view out would move: by the linearised problem as by calibrating again without it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from tests.made_results import observed, poses_that_see

from calibrant.calibrate.cell.hand_eye import calibrate_hand_eye
from calibrant.calibrate.cell.rig import calibrate_rig
from calibrant.calibrate.intrinsics.calibrate import calibrate_intrinsics
from calibrant.data import CalibrationResult, Observations, RobotPoses, View
from calibrant.diagnose.compare.cameras import compare_cameras
from calibrant.diagnose.influence import influence
from calibrant.geometry import se3
from calibrant.simulate.scenes import grid, look_at_board, standard_camera


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


def test_the_moment_that_bends_a_rig_is_named_with_the_camera_that_it_moves() -> None:
    """Three pixels sideways in one picture of one camera: of all moments that one moves the rig most."""
    names, places = ("left", "right"), (np.eye(4), se3.make(np.eye(3), [-0.1, 0.0, 0.0]))
    rng = np.random.default_rng(8)
    lens, points = standard_camera(), grid(8, 6, 0.03)
    views = []
    for m, T in enumerate(look_at_board(lens, points, 9, rng=rng, distance=(0.5, 0.8))):
        for name, M in zip(names, places):
            uv = lens.project(se3.apply(M @ T, points)) + rng.normal(0, 0.1, (len(points), 2))
            views.append(View(f"{name}-{m}", points, uv, np.arange(len(points)), name, moment=str(m)))
    observations = Observations(tuple(views), dict.fromkeys(names, lens.image_size))
    result = calibrate_rig(observations)
    quiet = influence(result)
    assert [v.view for v in quiet] == [str(m) for m in range(9)]
    assert {v.camera for v in quiet} == {"right"}
    bent = tuple(replace(v, uv=v.uv + np.array([3.0, 0.0])) if v.id == "right-4" else v for v in observations.views)
    loud = influence(replace(result, observations=replace(observations, views=bent)))
    worst = max(loud, key=lambda v: v.sigmas)
    assert (worst.view, worst.camera) == ("4", "right")
    assert worst.sigmas > 5 * max(v.sigmas for v in quiet)


def test_a_rig_whose_moments_have_no_one_pose_of_the_target_has_none() -> None:
    names = ("left", "right")
    lens, points = standard_camera(), grid(8, 6, 0.03)
    rng = np.random.default_rng(8)
    views = []
    for m, T in enumerate(look_at_board(lens, points, 9, rng=rng, distance=(0.5, 0.8))):
        for name in names:
            uv = lens.project(se3.apply(T, points))
            views.append(View(f"{name}-{m}", points, uv, np.arange(len(points)), name, moment=str(m)))
    result = calibrate_rig(Observations(tuple(views), dict.fromkeys(names, lens.image_size)))
    apart = tuple(
        replace(v, T_camera_target=se3.make(np.eye(3), [0, 0, 1e-3]) @ v.T_camera_target) if v.id == "right-4" else v
        for v in result.views
    )
    assert influence(replace(result, views=apart)) == ()
