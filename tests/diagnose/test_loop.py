"""The target by camera and by robot: two ways that meet when the calibration is right."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from calibrant.calibrate.cell.hand_eye import calibrate_hand_eye
from calibrant.calibrate.cell.stated import hand_eye_pair
from calibrant.data import CalibrationResult, RobotPoses, as_transform
from calibrant.diagnose.loop import by_view, loop_views, target_centre, target_outline
from calibrant.geometry import se3, so3
from calibrant.reports.parts.rows import view_rows
from calibrant.simulate.scenes import hand_eye_scene


def _exact(setup: str) -> tuple[CalibrationResult, np.ndarray]:
    """A result from exact target poses, and those poses."""
    rng = np.random.default_rng(4)
    B = se3.make(so3.random(rng, 5), rng.normal(size=(5, 3)))
    X = se3.make(so3.exp([0.4, -1.0, 0.3]), [0.1, 0.2, -0.3])
    Z = se3.make(so3.exp([-2.0, 0.3, 0.5]), [0.5, -0.1, 0.2])
    A = Z @ se3.inverse(X @ B)  # A X B = Z
    in_hand = setup == "eye-in-hand"
    frames = ("gripper", "base") if in_hand else ("base", "gripper")
    transforms = (as_transform(frames[0], "camera", X), as_transform(frames[1], "target", Z))
    poses = RobotPoses.from_matrices(A if in_hand else se3.inverse(A))
    return CalibrationResult("hand-eye", "ok", transforms=transforms, robot_poses=poses, T_camera_target=B), B


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_exact_data_close_the_loop(setup: str) -> None:
    result, _ = _exact(setup)
    loop = loop_views(result)
    assert [view.id for view in loop] == list("01234")
    for view in loop:
        assert view.T_base_target_by_camera is not None
        np.testing.assert_allclose(view.T_base_target_by_camera, view.T_base_target_by_robot, atol=1e-12)
        assert view.mm == pytest.approx(0, abs=1e-9)
        assert view.deg == pytest.approx(0, abs=1e-6)


def test_a_moved_board_shows_by_its_size() -> None:
    result, B = _exact("eye-to-hand")
    moved = B.copy()
    moved[2] = se3.retract(B[2], [0, np.deg2rad(0.5), 0, 3e-3, 0, 4e-3])
    loop = loop_views(replace(result, T_camera_target=moved))
    assert loop[2].mm == pytest.approx(5.0, abs=1e-6)
    assert loop[2].deg == pytest.approx(0.5, abs=1e-6)
    assert max(view.mm or 0.0 for i, view in enumerate(loop) if i != 2) < 1e-6


def test_the_loop_of_target_poses_goes_by_the_names_of_the_views() -> None:
    """A table and a page look a view's loop up by its camera and its id."""
    scene = hand_eye_scene("good", setup="eye-in-hand", views=8)
    result = calibrate_hand_eye(scene.robot_poses, scene.measured_T_camera_target, setup="eye-in-hand")
    loop = by_view(loop_views(result))
    assert [loop[row.camera, row.id].mm is not None for row in view_rows(result)] == [True] * 8


def test_no_loop_without_both_transforms_or_poses() -> None:
    result, _ = _exact("eye-in-hand")
    assert loop_views(replace(result, transforms=result.transforms[:1])) == ()
    assert loop_views(replace(result, robot_poses=None)) == ()
    assert hand_eye_pair(replace(result, transforms=result.transforms[:1])) is None


def test_the_outline_encloses_the_points(hand_eye_result: Callable[[str], CalibrationResult]) -> None:
    result = hand_eye_result("eye-in-hand")
    # The fixture's board has 9 x 6 points 30 mm apart.
    np.testing.assert_allclose(target_outline(result), [[0, 0, 0], [0.24, 0, 0], [0.24, 0.15, 0], [0, 0.15, 0]])
    np.testing.assert_allclose(target_centre(result), [0.12, 0.075, 0])
    np.testing.assert_array_equal(target_centre(replace(result, observations=None)), np.zeros(3))


def test_views_are_matched_by_their_moment(hand_eye_result: Callable[[str], CalibrationResult]) -> None:
    result = hand_eye_result("eye-to-hand")
    assert result.observations is not None
    assert result.robot_poses is not None
    renamed = replace(
        result,
        observations=replace(
            result.observations,
            views=tuple(replace(view, moment=f"pose {i}") for i, view in enumerate(result.observations.views)),
        ),
        robot_poses=RobotPoses(tuple(f"pose {i}" for i in range(12)), result.robot_poses.T_base_gripper),
    )
    by_name, by_moment = by_view(loop_views(result)), by_view(loop_views(renamed))
    for view in result.observations.views:
        # Compiled sums may run in another order: equal to rounding, not bit by bit.
        assert by_moment[view.camera, view.id].mm == pytest.approx(by_name[view.camera, view.id].mm, rel=1e-6)
