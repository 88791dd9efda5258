"""Which views contradict the others, and what is predicted of views that were kept out."""

from __future__ import annotations

import numpy as np

from calibrant.calibrate.cell.consistency import inconsistent_views, loop_statistics
from calibrant.calibrate.cell.held_out import leave_out
from calibrant.calibrate.cell.problem.camera_role import FLOORS, held_camera
from calibrant.calibrate.cell.problem.pose_pairs import TARGET_ROTATION, TARGET_TRANSLATION, pose_pair_problem
from calibrant.calibrate.cell.views import from_target_poses
from calibrant.calibrate.solvers.setup import get_setup
from calibrant.data import RobotPoses
from calibrant.geometry import se3
from calibrant.optimize.noise import NoiseEstimate, estimate_noise
from calibrant.simulate.scenes import HandEyeScene, hand_eye_scene

SETUP = get_setup("eye-to-hand")
SCENE = hand_eye_scene("good", setup="eye-to-hand", views=15)


def fitted(scene: HandEyeScene, T_base_gripper: np.ndarray) -> NoiseEstimate:
    sigmas = {TARGET_ROTATION: 1e-3, TARGET_TRANSLATION: 1e-3}
    B = scene.measured_T_camera_target
    return estimate_noise(
        pose_pair_problem(SETUP, T_base_gripper, B, X=scene.X, Z=scene.Z, sigmas=sigmas), floors=FLOORS
    )


def test_noise_alone_condemns_no_view() -> None:
    robot = SCENE.robot_poses.T_base_gripper
    data, noise = from_target_poses(SCENE.robot_poses, SCENE.measured_T_camera_target), fitted(SCENE, robot)
    statistic, _ = loop_statistics(SETUP, data, noise)
    # Chi-squares of 6 degrees, a little less for the 12 fitted unknowns of 90: the mean of 15 has a sigma of 0.9.
    assert 2 < statistic.mean() < 9
    assert not inconsistent_views(SETUP, data, noise).any()


def test_a_view_beyond_its_noise_is_found() -> None:
    robot = SCENE.robot_poses.T_base_gripper.copy()
    robot[6, :3, 3] += [0.0, 0.005, 0.0]  # ten times what the loop shows
    data = from_target_poses(RobotPoses.from_matrices(robot), SCENE.measured_T_camera_target)
    odd = inconsistent_views(SETUP, data, fitted(SCENE, robot))
    assert np.flatnonzero(odd).tolist() == [6]


def test_a_pose_kept_out_is_predicted_worse_than_it_is_fitted_but_not_by_much() -> None:
    robot, B = SCENE.robot_poses.T_base_gripper, SCENE.measured_T_camera_target
    noise = fitted(SCENE, robot)
    errors = leave_out(SETUP, robot, B, None, held_camera(SCENE.camera), noise.solution, noise.solution.sigmas)
    X, Z = (noise.solution.value(name)[0] for name in (SETUP.camera_transform, SETUP.target_transform))
    fit = 1e3 * np.linalg.norm(se3.local(Z, SETUP.normal_form(robot) @ X @ B)[:, 3:], axis=1)
    ratio = np.sqrt(np.mean(errors.mm**2)) / np.sqrt(np.mean(fit**2))
    assert errors.px is None
    # About 1 + 6 / n for n = 15 views.
    assert 1.0 < ratio < 2.0
