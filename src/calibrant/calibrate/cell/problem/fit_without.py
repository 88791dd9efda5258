"""What a fit becomes without some of its poses: one Gauss-Newton step, at the cost of a small matrix each.

Every pose is a component of the normal equations that the others do not touch (`optimize.structure`), so that the
equations of the shared unknowns (camera and target transform, intrinsics) are a sum over the poses,

    S = R + sum_i K_i,   s = r + sum_i k_i,   K_i = H_i - Y_i^T Y_i,   k_i = g_i - Y_i^T z_i,

H_i, g_i the pose's own share in the blocks of the shared unknowns, Y_i = L_i^-1 W_i and z_i = L_i^-1 v_i its
elimination, R, r what no pose has a part in (a prior of the camera). Without the poses O the sums run over the others:
all that is computed pose by pose is computed once, and a step without O costs one solution with S - sum_O K_i.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.optimize import linear
from calibrant.optimize.linear import NormalEquations
from calibrant.optimize.problem import Values
from calibrant.optimize.solution import Solution
from calibrant.optimize.structure import SHARED


@dataclass(frozen=True, eq=False)
class PoseShares:
    """The shared unknowns' equations at a fit, S (s, s) and s (s,), and what each pose has in them.

    of_S (n, s, s), of_s (n, s): K_i and k_i; squares (n,): |z_i|^2, twice the decrease of the cost that the pose's own
    unknowns allow.
    """

    fit: Solution
    S: Array
    s: Array
    of_S: Array
    of_s: Array
    squares: Array

    def without(self, out: NDArray[np.bool_]) -> tuple[Values, float] | None:
        """The shared unknowns after one step without the poses `out` (n,), and the decrease of the cost it predicts.

        The other values are the fit's. None where the poses that are left do not determine them.
        """
        S, s = self.S - self.of_S[out].sum(axis=0), self.s - self.of_s[out].sum(axis=0)
        step = linear.solve(NormalEquations(self.fit.cost, (), (), (), S, s), 0.0)
        if step is None:
            return None
        problem = self.fit.problem
        values = list(self.fit.values)
        for i, (variable, placement) in enumerate(zip(problem.variables, problem.structure.placements)):
            if placement is not None and placement.together == SHARED:
                free = step.shared[placement.offset[:, None] + np.arange(placement.dim)]
                values[i] = variable.manifold.retract(values[i], free)
        return tuple(values), step.predicted + 0.5 * float(self.squares[~out].sum())


def pose_shares(fit: Solution, poses: str) -> PoseShares | None:
    """The shares of the instances of the variable `poses`.

    None where the equations are of another shape: unless these alone are eliminated, one a component, and every shared
    unknown has one instance, or where a component has no inverse.
    """
    problem, structure, equations = fit.problem, fit.problem.structure, fit.equations
    placement = structure.placements[problem.variable_index(poses)]
    if placement is None or placement.together != 0 or len(structure.batches) != 1:
        return None
    if any(p is not None and p.together == SHARED and len(p.offset) != 1 for p in structure.placements):
        return None
    part = linear.eliminate(equations.V[0], equations.W[0], equations.v[0], 0.0)
    if part.singular:
        return None
    Y_t = np.swapaxes(part.Y, 1, 2)
    of_S, of_s = -(Y_t @ part.Y), -(Y_t @ part.z[..., None])[..., 0]
    for k, factor in enumerate(problem.factors):
        if poses in factor.variables:
            H, g, local, columns = _shared_blocks(fit, k)
            rows = factor.indices[factor.variables.index(poses)]
            np.add.at(of_S, (rows[:, None, None], columns[:, None], columns), H[:, local[:, None], local])
            np.add.at(of_s, (rows[:, None], columns), g[:, local])
    S, s = linear.reduce_shared(equations, [part])
    return PoseShares(fit, S, s, of_S, of_s, np.sum(part.z**2, axis=1))


def _shared_blocks(fit: Solution, k: int) -> tuple[Array, Array, NDArray[np.intp], NDArray[np.intp]]:
    """H (m, f, f) and g (m, f) of a factor's edges in the free tangents; which of f are shared, and their columns."""
    problem = fit.problem
    H, g, starts = linear.in_free(fit.equations.factors[k], problem.bases(k, fit.values))
    local, columns = [np.zeros(0, dtype=np.intp)], [np.zeros(0, dtype=np.intp)]
    for v, first in zip(problem.structure.slots[k], starts):
        placement = problem.structure.placements[v]
        if placement is not None and placement.together == SHARED:
            local.append(first + np.arange(placement.dim))
            columns.append(placement.offset[0] + np.arange(placement.dim))
    return H, g, np.concatenate(local), np.concatenate(columns)
