"""Errors of a robot's poses: what they do to a fit, against fits of moved poses and the fit's own covariance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibrant.arrays import Array
from calibrant.calibrate.cell.calibrate import CellFit, fit_cell
from calibrant.calibrate.cell.certainty.pose_errors import PoseErrors, pose_errors
from calibrant.calibrate.cell.fitted import fitted_transforms
from calibrant.calibrate.cell.problem.groups import robot_groups
from calibrant.calibrate.cell.problem.layout import ONLY_ROBOT, Pictures, poses_variable
from calibrant.calibrate.cell.problem.problem import cell_problem
from calibrant.data import RobotPoses
from calibrant.geometry import se3, so3
from calibrant.optimize.levenberg_marquardt import SolverOptions, solve
from calibrant.simulate.cell import make_cell, observe_cell


@pytest.fixture(scope="module")
def fit() -> CellFit:
    cell = make_cell(3, views=9)
    return fit_cell(cell.robot_poses, [Pictures("camera", "eye-in-hand", observe_cell(cell, sigma_px=0.1))])


@pytest.fixture(scope="module")
def errors(fit: CellFit) -> PoseErrors:
    found = pose_errors(fit.noise.solution, poses_variable(ONLY_ROBOT), robot_groups(ONLY_ROBOT))
    assert found is not None
    return found


def test_the_pull_is_what_moved_poses_do(fit: CellFit, errors: PoseErrors) -> None:
    solution, cell = fit.noise.solution, fit.cell
    e = np.random.default_rng(0).normal(size=(len(errors.gradient), 6)) * 3e-5
    T = np.array(errors.T_base_gripper)
    T[:, :3, :3] = so3.exp(e[:, :3]) @ T[:, :3, :3]
    T[:, :3, 3] += e[:, 3:]
    moved = replace(cell, layout=replace(cell.layout, robots={ONLY_ROBOT: RobotPoses(cell.moments(ONLY_ROBOT), T)}))
    ends = []
    for some in (cell, moved):
        problem = cell_problem(some, fitted_transforms(cell, solution), solution.sigmas)
        ends.append(solve(problem, start=solution.values, options=SolverOptions(cost_tolerance=1e-14)))
    expected = errors.moved(e[..., None])[:, 0]
    for name in (v.name for v in solution.problem.variables):
        i = solution.problem.variable_index(name)
        placement, values = solution.problem.structure.placements[i], [end.value(name) for end in ends]
        if placement is not None and placement.together == -1 and values[0].shape[-1] == 4:
            change = se3.local(values[0][0], values[1][0])
            said = expected[placement.offset[0] + np.arange(6)]
            np.testing.assert_allclose(change, said, atol=0.02 * np.abs(said).max())


def test_gradients_have_the_covariance_that_the_fit_leaves(fit: CellFit, errors: PoseErrors) -> None:
    solution, name = fit.noise.solution, poses_variable(ONLY_ROBOT)
    plain = replace(solution, around=(), beside=None)
    rotation, translation = (solution.sigmas[g] for g in robot_groups(ONLY_ROBOT))
    P = np.diag([rotation**-2] * 3 + [translation**-2] * 3)
    # g = P (pose as fitted less pose as said): P - P C P, for one pose and between two.
    for i, j in ((0, 0), (4, 4), (2, 6)):
        C = plain.joint_covariance([(name, i), (name, j)])[:6, 6:]
        expected = (P if i == j else 0 * P) - P @ C @ P
        of_fit = (errors.information[i] if i == j else 0 * P) - errors.pull[i].T @ errors.covariance @ errors.pull[j]
        scale = np.sqrt(np.outer(np.diag(P), np.diag(P)))
        np.testing.assert_allclose(of_fit / scale, expected / scale, atol=2e-3)


@pytest.mark.parametrize("of_flange", [True, False])
def test_units_are_roots_of_a_poses_own_covariance(errors: PoseErrors, of_flange: bool) -> None:
    L = errors.units(of_flange=of_flange)
    np.testing.assert_allclose(np.swapaxes(L, 1, 2) @ errors.information @ L, _same(np.eye(6), len(L)), atol=1e-6)


def _same(M: Array, n: int) -> Array:
    return np.broadcast_to(M, (n, 6, 6))
