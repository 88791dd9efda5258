"""Errors of what a robot's joints and free geometry say of its poses, against fits of moved readings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibrant.calibrate.cell.calibrate import CellFit, fit_cell
from calibrant.calibrate.cell.certainty.pose_errors import PoseErrors, pose_errors
from calibrant.calibrate.cell.fitted import fitted_transforms
from calibrant.calibrate.cell.problem.groups import geometry_variable, robot_groups
from calibrant.calibrate.cell.problem.joint_offsets import JointReadings
from calibrant.calibrate.cell.problem.layout import ONLY_ROBOT, Pictures, poses_variable
from calibrant.calibrate.cell.problem.problem import cell_problem
from calibrant.geometry import se3
from calibrant.optimize.levenberg_marquardt import SolverOptions, solve
from calibrant.robots.arms import arm
from calibrant.robots.geometry import ParametricChain
from calibrant.robots.inverse import solve_inverse
from calibrant.simulate.scenes import grid, gripper_poses, look_at_board, observe, standard_camera, standard_mounting


@pytest.fixture(scope="module")
def fit() -> CellFit:
    rng, chain = np.random.default_rng(4), arm("ur5e")
    assert isinstance(chain, ParametricChain)
    camera, points = standard_camera(), grid(9, 7, 0.02)
    X, Z = standard_mounting("eye-in-hand")
    B = look_at_board(camera, points, 60, rng=rng, distance=(0.35, 0.65), tilt_deg=40)
    start = np.array([0.2, -1.6, 1.8, -1.8, -1.57, 0.3]) + rng.uniform(-0.4, 0.4, (60, 6))
    found = solve_inverse(chain, gripper_poses("eye-in-hand", X, Z, B), start)
    q = found.q[found.reached][:14]
    seen = observe(camera, points, se3.inverse(X) @ se3.inverse(chain.forward(q)) @ Z, sigma_px=0.1, rng=rng)
    readings = JointReadings.from_values(q + rng.normal(scale=2e-4, size=q.shape), chain)
    return fit_cell(readings.poses, [Pictures("camera", "eye-in-hand", seen)], joints=readings)


@pytest.fixture(scope="module")
def errors(fit: CellFit) -> PoseErrors:
    found = pose_errors(fit.noise.solution, poses_variable(ONLY_ROBOT), robot_groups(ONLY_ROBOT))
    assert found is not None
    return found


def test_the_pull_is_what_moved_readings_do(fit: CellFit, errors: PoseErrors) -> None:
    solution, cell = fit.noise.solution, fit.cell
    free = cell.free[ONLY_ROBOT]
    step = np.random.default_rng(0).normal(size=free.readings.q.shape) * 3e-5
    moved = replace(free, readings=replace(free.readings, q=free.readings.q + step))
    model = free.at(solution.value(geometry_variable(ONLY_ROBOT))[0])
    e = (model.joint_jacobian(free.readings.q, np.zeros_like(step)) @ step[..., None])[..., 0]
    ends = []
    for some in (cell, replace(cell, free={ONLY_ROBOT: moved})):
        problem = cell_problem(some, fitted_transforms(cell, solution), solution.sigmas)
        ends.append(solve(problem, start=solution.values, options=SolverOptions(cost_tolerance=1e-14)))
    expected = errors.moved(e[..., None])[:, 0]
    compared = 0
    for name in (v.name for v in solution.problem.variables):
        placement = solution.problem.structure.placements[solution.problem.variable_index(name)]
        values = [end.value(name) for end in ends]
        if placement is not None and placement.together == -1 and values[0].shape[-1] == 4:
            change = se3.local(values[0][0], values[1][0])
            said = expected[placement.offset[0] + np.arange(6)]
            np.testing.assert_allclose(change, said, atol=0.02 * np.abs(said).max())
            compared += 1
    assert compared == 2


def test_what_is_left_has_the_covariance_that_the_fit_leaves(errors: PoseErrors) -> None:
    # Gradients of a fit are of no more degrees of freedom than it leaves, and none are negative.
    n, s, _ = errors.pull.shape
    across = np.swapaxes(errors.pull, 1, 2).reshape(6 * n, s)
    left = -across @ errors.covariance @ across.T
    for i in range(n):
        left[6 * i : 6 * i + 6, 6 * i : 6 * i + 6] += errors.information[i]
    scale = 1 / np.sqrt(np.diag(left))
    values = np.linalg.eigvalsh(left * scale[:, None] * scale)
    assert values[0] > -1e-6 * values[-1]
