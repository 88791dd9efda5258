"""What errors of a robot's poses do to a cell: the loop's own residuals, pose by pose, and their pull.

Pose i is what the robot said, or what its geometry makes of the joints that were read, with the block P_i of its noise,
and what the images say of it. With V, W the blocks of its component, and B_i, B_i,s the columns by which the terms of
what was said couple the pose to the component and to the shared unknowns (of a pose that was said, P_i at its own place
and nothing; else the joints' errors and the robot's geometry too), an error e_i of what was said moves the latter by

    d = -C_s sum_i G_i e_i,     G_i = W^T V^-1 B_i - B_i,s,

and leaves in the gradient g_i of its terms, with e_i of covariance T_i, that of robot and image together,

    cov(g_i, g_j) = T_i^-1 [i = j] - G_i^T C_s G_j,     T_i^-1 = P_i - B_i^T V^-1 B_i,

since what a least-squares fit finds is uncorrelated with what it leaves. All in the units of T_i, of which
`PoseErrors.units` holds a square root, residuals and pull are free of the robot's and the images' size.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array, Indices
from calibrant.optimize.factors import FactorBlocks
from calibrant.optimize.problem import Problem
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
    """The errors of what was said of the instances of the variable `poses`, whose noise groups these are.

    None where nothing is said of them.
    """
    problem = solution.problem
    values = problem.variables[problem.variable_index(poses)].values  # as they were said
    P, g = np.zeros((len(values), 6, 6)), np.zeros((len(values), 6))
    coupled = _Coupled.none(problem, len(values))
    for k, factor in enumerate(problem.factors):
        if factor.noise in groups and factor.variables[:1] == (poses,):
            blocks = solution.equations.factors[k]
            np.add.at(P, factor.indices[0], blocks.H[:, :6, :6])
            np.add.at(g, factor.indices[0], blocks.g[:, :6])
            coupled.add(solution, k, blocks)
    if not P.any() or problem.structure.placements[problem.variable_index(poses)] is None:
        return None
    pull, information = -coupled.shared, P
    for batch in np.unique(coupled.batch[coupled.batch != SHARED]).tolist():
        mine = coupled.batch == batch
        rows = coupled.row[mine]
        inverse, W = solution.component_inverses[batch][rows], solution.equations.W[batch][rows]
        B = coupled.own[mine, : inverse.shape[1]]
        through = inverse @ B
        pull[mine] += np.swapaxes(W, 1, 2) @ through
        information[mine] -= np.swapaxes(B, 1, 2) @ through
    return PoseErrors(values, g, information, pull, solution.shared_covariance)


@dataclass(frozen=True, eq=False)
class _Coupled:
    """B_i (n, b, 6) and B_i,s (n, s, 6), filled as terms are added; batch and row (n,): the component of each pose."""

    own: Array
    shared: Array
    batch: Indices
    row: Indices

    @classmethod
    def none(cls, problem: Problem, n: int) -> _Coupled:
        largest = max((size for size, _ in problem.structure.batches), default=0)
        shared = np.zeros((n, problem.structure.shared, 6))
        return cls(np.zeros((n, largest, 6)), shared, np.full(n, SHARED), np.zeros(n, dtype=np.int64))

    def add(self, solution: Solution, k: int, blocks: FactorBlocks) -> None:
        """The terms of factor k, whose first unknown is the pose."""
        problem = solution.problem
        factor, pose = problem.factors[k], problem.factors[k].indices[0]
        bases = problem.bases(k, solution.values)
        for name, at, columns, basis in zip(factor.variables, factor.indices, blocks.pieces, bases):
            place = problem.structure.placements[problem.variable_index(name)]
            if place is None:
                continue
            H = blocks.H[:, columns, :6]
            H = H if basis is None else np.swapaxes(basis, -1, -2) @ H
            into = place.offset[at][:, None] + np.arange(place.dim)
            dense = place.batch[at] == SHARED
            np.add.at(self.shared, (pose[dense, None], into[dense]), H[dense])
            np.add.at(self.own, (pose[~dense, None], into[~dense]), H[~dense])
            self.batch[pose[~dense]], self.row[pose[~dense]] = place.batch[at][~dense], place.row[at][~dense]


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
