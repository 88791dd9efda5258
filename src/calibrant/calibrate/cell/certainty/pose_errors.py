"""What errors of a robot's poses do to a cell: the loop's own residuals, pose by pose, and their pull.

Pose i is what the robot said, with the normal block P_i of its noise, and what the images say of it. With V, W the
blocks of its component and E its columns there, an error e_i of what was said moves the shared unknowns by

    d = -C_s sum_i G_i e_i,     G_i = W^T V^-1 E P_i,

and leaves in the gradient g_i of its term, with e_i of covariance T_i, that of robot and image together,

    cov(g_i, g_j) = T_i^-1 [i = j] - G_i^T C_s G_j,     T_i^-1 = P_i - P_i E^T V^-1 E P_i,

since what a least-squares fit finds is uncorrelated with what it leaves. All in the units of T_i, of which
`PoseErrors.units` holds a square root, residuals and pull are free of the robot's and the images' size.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array
from calibrant.optimize.solution import Solution
from calibrant.optimize.structure import SHARED

_LEAST_KNOWN = 1e-9
"""Share of the best known direction's information below which a direction of a pose is not known at all."""


@dataclass(frozen=True, eq=False)
class PoseErrors:
    """Gradients g (n, 6) of a robot's poses, information (n, 6, 6) T^-1, pull (n, s, 6) G, and the poses T (n, 4, 4).

    covariance (s, s): C_s of the fit.
    """

    T_base_gripper: Array
    gradient: Array
    information: Array
    pull: Array
    covariance: Array

    def units(self, *, of_flange: bool) -> Array:
        """L_i (n, 6, 6), T_i = L_i L_i^T, by the axes of the flange or of the base: alike there is one error."""
        if not of_flange:
            return _square_roots(self.information)
        R = _turned(self.T_base_gripper)
        return np.asarray(R @ _square_roots(np.swapaxes(R, 1, 2) @ self.information @ R))

    def moved(self, errors: Array) -> Array:
        """Shift (s, k) of the shared unknowns by k patterns of errors (n, 6, k) of all poses."""
        n, s, _ = self.pull.shape
        return np.asarray(
            -self.covariance @ np.swapaxes(self.pull, 1, 2).reshape(6 * n, s).T @ errors.reshape(6 * n, -1)
        )


def pose_errors(solution: Solution, poses: str, groups: Collection[str]) -> PoseErrors | None:
    """The errors of the instances of the variable `poses`, whose noise groups these are.

    None where nothing is said of the poses by themselves (their joints are free).
    """
    problem = solution.problem
    i = problem.variable_index(poses)
    placement, variable = problem.structure.placements[i], problem.variables[i]
    P, g = np.zeros((variable.count, 6, 6)), np.zeros((variable.count, 6))
    for k, factor in enumerate(problem.factors):
        if factor.noise in groups and factor.variables == (poses,):
            blocks = solution.equations.factors[k]
            np.add.at(P, factor.indices[0], blocks.H)
            np.add.at(g, factor.indices[0], blocks.g)
    if placement is None or not P.any():
        return None
    s = len(solution.equations.S)
    pull, information = np.zeros((variable.count, s, 6)), P.copy()
    columns = placement.offset[:, None] + np.arange(6)
    for batch in np.unique(placement.batch).tolist():
        mine = placement.batch == batch
        if batch == SHARED:
            pull[mine] = -np.eye(s)[columns[mine]].transpose(0, 2, 1) @ P[mine]
            continue
        rows, own = placement.row[mine], columns[mine]
        into = np.take_along_axis(solution.component_inverses[batch][rows], own[:, None, :], axis=2) @ P[mine]
        pull[mine] = np.swapaxes(solution.equations.W[batch][rows], 1, 2) @ into
        information[mine] -= P[mine] @ np.take_along_axis(into, own[:, :, None], axis=1)
    return PoseErrors(variable.values, g, information, pull, solution.shared_covariance)


def _turned(T: Array) -> Array:
    """(n, 6, 6) from the axes of the flange to those of the base, rotation and translation alike."""
    out = np.zeros((len(T), 6, 6))
    out[:, :3, :3] = out[:, 3:, 3:] = T[:, :3, :3]
    return out


def _square_roots(information: Array) -> Array:
    """Symmetric square roots (n, 6, 6) of the inverses; directions that nothing is known of have no unit."""
    unit = 1 / np.sqrt(np.maximum(np.einsum("nii->ni", information), np.finfo(float).tiny))
    # Radians and metres differ by any factor: eigenvalues are compared without their units.
    shared = np.median(unit, axis=0)
    values, axes = np.linalg.eigh(information * shared[:, None] * shared)
    known = values > _LEAST_KNOWN * values[:, -1:]
    roots = np.where(known, 1 / np.sqrt(np.where(known, values, 1.0)), 0.0)
    return np.asarray(shared[:, None] * (axes * roots[:, None, :]) @ np.swapaxes(axes, 1, 2))
