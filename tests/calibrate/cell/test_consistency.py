"""Which views contradict the others, and what is predicted of views that were kept out."""

from __future__ import annotations

import numpy as np

from calibrant.calibrate.cell.consistency import inconsistent_views, loop_statistics
from calibrant.calibrate.cell.held_out import leave_out
from calibrant.calibrate.cell.problem.problem import Cell, cell_of_one, cell_problem
from calibrant.calibrate.solvers.setup import get_setup
from calibrant.geometry import se3
from calibrant.optimize.noise import estimate_noise
from calibrant.optimize.solution import Solution
from calibrant.simulate.scenes import HandEyeScene, hand_eye_scene

SETUP = get_setup("eye-to-hand")
SCENE = hand_eye_scene("good", setup="eye-to-hand", views=15)


def fitted(scene: HandEyeScene, T_base_gripper: np.ndarray) -> tuple[Cell, Solution]:
    cell = cell_of_one(SETUP, T_base_gripper, scene.measured_T_camera_target)
    problem = cell_problem(cell, cell.placed(scene.X, scene.Z), cell.levels((1e-3, 1e-3)))
    return cell, estimate_noise(problem, floors=cell.floors()).solution


def test_noise_alone_condemns_no_view() -> None:
    cell, fit = fitted(SCENE, SCENE.robot_poses.T_base_gripper)
    statistic, _ = loop_statistics(cell, fit, 0)
    # Chi-squares of 6 degrees, a little less for the 12 fitted unknowns of 90: the mean of 15 has a sigma of 0.9.
    assert 2 < statistic.mean() < 9
    assert not inconsistent_views(cell, fit, 0).any()


def test_a_view_beyond_its_noise_is_found() -> None:
    robot = SCENE.robot_poses.T_base_gripper.copy()
    robot[6, :3, 3] += [0.0, 0.005, 0.0]  # ten times what the loop shows
    odd = inconsistent_views(*fitted(SCENE, robot), 0)
    assert np.flatnonzero(odd).tolist() == [6]


def test_a_pose_kept_out_is_predicted_worse_than_it_is_fitted_but_not_by_much() -> None:
    robot, B = SCENE.robot_poses.T_base_gripper, SCENE.measured_T_camera_target
    cell, solution = fitted(SCENE, robot)
    errors = leave_out(cell, solution)
    assert errors is not None
    X, Z = (solution.value(name)[0] for name in (SETUP.camera_transform, SETUP.target_transform))
    fit = 1e3 * np.linalg.norm(se3.local(Z, SETUP.normal_form(robot) @ X @ B)[:, 3:], axis=1)
    ratio = np.sqrt(np.mean(errors.mm**2)) / np.sqrt(np.mean(fit**2))
    assert errors.rms_px is None
    # About 1 + 6 / n for n = 15 views.
    assert 1.0 < ratio < 2.0
