"""Hand-eye from pose pairs: the noise of robot and target apart, and a covariance that tells the truth."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.calibrate.cell.problem.groups import measured_groups, robot_groups, scale_variable
from calibrant.calibrate.cell.problem.problem import cell_of_one, cell_problem
from calibrant.calibrate.solvers.setup import SETUPS
from calibrant.geometry import se3
from calibrant.optimize.levenberg_marquardt import solve
from calibrant.optimize.noise import estimate_noise
from calibrant.simulate.scenes import hand_eye_scene
from calibrant.simulate.truth import chi_square

FLANGE_ROTATION, TARGET_TRANSLATION = robot_groups("robot")
TARGET_ROTATION, _ = measured_groups("camera")
START = {TARGET_ROTATION: 1e-3, TARGET_TRANSLATION: 1e-3, FLANGE_ROTATION: 0.5e-3}


@pytest.mark.parametrize("setup", SETUPS)
def test_exact_pairs_give_the_truth(setup: str) -> None:
    scene = hand_eye_scene("exact", setup=setup)
    start = se3.retract(scene.X, np.full(6, 0.01)), se3.retract(scene.Z, np.full(6, -0.01))
    poses, pairs = scene.robot_poses.T_base_gripper, scene.measured_T_camera_target
    cell = cell_of_one(SETUPS[setup], poses, pairs)
    solution = solve(cell_problem(cell, cell.placed(*start), START, free_sizes=("target",)))
    assert solution.converged
    np.testing.assert_allclose(solution.value(SETUPS[setup].camera_transform)[0], scene.X, atol=1e-8)
    np.testing.assert_allclose(solution.value(SETUPS[setup].target_transform)[0], scene.Z, atol=1e-8)
    assert 1 + solution.value(scale_variable("target"))[0, 0] == pytest.approx(1, abs=1e-8)


@pytest.mark.statistics
def test_normalised_error_and_noise_of_a_camera_in_the_hand() -> None:
    """0.2 degrees at the flange move a target 0.5 m away by 1.7 mm: as much as all other noise of the scene.

    With the robot's noise put on the target the normalised error averages 8. The mean of 80 chi-squares of 6 degrees of
    freedom is 6 -+ 0.39.
    """
    errors, levels = [], []
    setup = SETUPS["eye-in-hand"]
    for seed in range(80):
        scene = hand_eye_scene("noisy", seed=seed)
        cell = cell_of_one(setup, scene.robot_poses.T_base_gripper, scene.measured_T_camera_target)
        found = estimate_noise(cell_problem(cell, cell.placed(scene.X, scene.Z), START))
        assert found.settled
        e = se3.local(scene.X, found.solution.value(setup.camera_transform)[0])
        errors.append(chi_square(e, found.solution.covariance(setup.camera_transform)))
        levels.append([found.levels[g].sigma for g in (FLANGE_ROTATION, TARGET_ROTATION, TARGET_TRANSLATION)])
    assert np.mean(errors) == pytest.approx(6, abs=3 * np.sqrt(12 / 80))
    flange, target, position = np.median(levels, axis=0)
    assert flange == pytest.approx(np.deg2rad(0.2), rel=0.15)
    assert target == pytest.approx(np.deg2rad(0.1), rel=0.15)  # `scenes._scene` puts 0.2 sigma_px degrees on a board
    assert position == pytest.approx(1e-3 * np.hypot(1.0, 0.5) / np.sqrt(2), rel=0.15)  # 1 mm and 0.5 mm share a level
