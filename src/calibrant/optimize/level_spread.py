"""What it costs that noise levels are estimated: how well they are known, and the covariance averaged over that.

With J in units of the noise and R = I - J C J^T, the restricted likelihood of the log variances has the information

    F_kl = 1/2 M_kl,    M_kl = trace(E_k R E_l R) = tr(H_k C H_l C),    M_kk = r_k - sum_l M_kl,

E_k the residuals of group k, H_k its share of the normal matrix, r_k its redundancy (Koch 1999, section 3.6.3; Searle,
Casella and McCulloch 1992, "Variance components", section 6.6). Groups that move the same residuals know each
other's levels badly: the off-diagonal terms (`noise_shares` gives M). C at the estimated levels is too small on
average, because a level may as well be higher. It is averaged over precisions 1 / sigma_k^2 moved along the
eigenvectors u_j of M by -+ sqrt(2 / m_j),

    C + sum_j (C_j+ + C_j-) / 2 - C.

For one group of nu residuals to spare that is nu / (nu - 2) C, the variance of Student's t, exactly. It is never below
C: an inverse is a convex function of the matrix.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calibrant.arrays import Array
from calibrant.optimize.solution import Solution

WELL_KNOWN = 1000.0
"""Directions that rest on more numbers are not averaged over: they add less than a thousandth to a sigma."""
LEAST_FREEDOM = 5.0
"""Directions that rest on fewer numbers are averaged as if on five: two groups that share one noise between them, whose
sum is known and does not change along it."""


def averaged(solution: Solution, M: Array, groups: Sequence[str]) -> Solution:
    """The solution with its covariances averaged over the levels of the groups, which M (K, K) says how well known."""
    around = []
    values, vectors = np.linalg.eigh(M)
    for m, u in zip(values, vectors.T):
        if m > WELL_KNOWN:
            continue
        step = np.sqrt(2 / max(float(m), LEAST_FREEDOM))
        for sign in (1.0, -1.0):
            moved = {g: solution.sigmas[g] / np.sqrt(1 + sign * step * part) for g, part in zip(groups, u)}
            around.append((0.5, _solution_at(solution, {**solution.sigmas, **moved})))
    if not around:
        return solution
    return replace(solution, around=((1.0 - 0.5 * len(around), _solution_at(solution, dict(solution.sigmas))), *around))


def level_deviations(M: Array) -> Array:
    """1 sigma (K,) of each level relative to itself: half that of its log variance, 2 M^-1."""
    values, vectors = np.linalg.eigh(M)
    return np.sqrt(0.5 * (vectors**2 @ (1 / np.maximum(values, 1e-12))))


def _solution_at(solution: Solution, levels: dict[str, float]) -> Solution:
    """The same values under other noise levels."""
    equations = solution.problem.reweigh(solution.equations, solution.values, dict(solution.sigmas), levels)
    return replace(solution, sigmas=levels, equations=equations, around=())
