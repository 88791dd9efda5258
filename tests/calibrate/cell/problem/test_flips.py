"""Hand-eye from four corners of one tag: a known camera suffices, and the robot tells which of two poses is right."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calibrant.calibrate.cell.hand_eye import calibrate_hand_eye
from calibrant.calibrate.cell.problem.flips import right_branches
from calibrant.calibrate.pose.target_poses import target_poses
from calibrant.data import Observations, RobotPoses
from calibrant.diagnose.doctor.diagnosis import diagnose_views
from calibrant.errors import InputError
from calibrant.formats.poses.read import notations, read_poses
from calibrant.geometry import se3, so3
from calibrant.simulate.scenes import HandEyeScene, hand_eye_scene, observe
from calibrant.tasks.robots.doctor import csv_text


def tag_scene(setup: str, *, half: float, sigma_px: float) -> tuple[HandEyeScene, RobotPoses, Observations]:
    """A scene whose camera sees one tag, 2 `half` metres wide, in the middle of where the board was."""
    scene = hand_eye_scene("good", setup=setup, views=15)  # type: ignore[arg-type]
    corners = half * np.array([[-1.0, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]]) + scene.points.mean(axis=0)
    rng = np.random.default_rng(0)
    seen = observe(scene.camera, corners, scene.T_camera_target, sigma_px=sigma_px, rng=rng)
    seen = replace(seen, views=tuple(replace(v, moment=v.id) for v in seen.views))
    return scene, RobotPoses(tuple(v.id for v in seen.views), scene.robot_poses.T_base_gripper), seen


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_one_tag_and_a_known_camera(tmp_path: Path, setup: str) -> None:
    scene, poses, seen = tag_scene(setup, half=0.012, sigma_px=0.5)
    found = target_poses(scene.camera, list(seen.views)).T_camera_target
    flipped = np.array([se3.deviation(a, b)[1] for a, b in zip(found, scene.T_camera_target)]) > 5
    assert flipped.sum() >= 5  # by their pixels alone
    (tmp_path / "poses.csv").write_text(csv_text(poses))
    diagnosis = diagnose_views(notations(read_poses(tmp_path / "poses.csv")), seen, scene.camera, camera_given=True)
    assert diagnosis.sound
    assert diagnosis.poses.setup == setup
    result = calibrate_hand_eye(poses, seen, setup=setup, camera=scene.camera)
    t = result.transforms[0]
    off = 1e3 * (t.matrix[:3, 3] - scene.X[:3, 3])
    assert np.all(np.abs(off) < 4 * np.asarray(t.sigma_translation_mm))
    assert np.linalg.norm(off) < 2


def test_without_a_camera_four_corners_are_too_few() -> None:
    _, poses, seen = tag_scene("eye-in-hand", half=0.025, sigma_px=0.3)
    with pytest.raises(InputError, match="no view has 6 points"):
        calibrate_hand_eye(poses, seen, setup="eye-in-hand")


def test_every_flip_is_undone_in_any_reading_of_the_robot() -> None:
    rng = np.random.default_rng(1)
    R_A, (R_X, R_Z) = so3.random(rng, 12), so3.random(rng, 2)
    right = np.swapaxes(R_A @ R_X, 1, 2) @ R_Z
    wrong = so3.exp(rng.normal(scale=0.5, size=(12, 3))) @ right
    flipped = rng.random(12) < 0.5
    first, second = (np.where(pick[:, None, None], wrong, right) for pick in (flipped, ~flipped))
    sides = [so3.random(rng, 12), np.swapaxes(R_A, 1, 2), R_A]
    np.testing.assert_array_equal(right_branches(sides, first, second), flipped)
    one = np.arange(12) % 3 > 0  # the others have two poses
    first[one] = second[one] = right[one]
    np.testing.assert_array_equal(right_branches(sides, first, second), flipped & ~one)
