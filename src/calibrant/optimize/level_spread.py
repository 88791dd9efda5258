"""What it costs that noise levels are estimated: how well they are known, and the covariance averaged over that.

With J in units of the noise and R = I - J C J^T, the restricted likelihood of the log variances has the information

    F_kl = 1/2 M_kl,    M_kl = trace(E_k R E_l R) = tr(H_k C H_l C),    M_kk = r_k - sum_l M_kl,

E_k the residuals of group k, H_k its share of the normal matrix, r_k its redundancy (Koch 1999, section 3.6.3; Searle,
Casella and McCulloch 1992, "Variance components", section 6.6). Groups that move the same residuals know each other's
levels badly: the off-diagonal terms. C at the estimated levels is too small on average, because a level may as well be
higher. It is averaged over precisions 1 / sigma_k^2 moved along the eigenvectors u_j of M by -+ sqrt(2 / m_j),

    C + sum_j (C_j+ + C_j-) / 2 - C.

For one group of nu residuals to spare that is nu / (nu - 2) C, the variance of Student's t, exactly. It is never below
C: an inverse is a convex function of the matrix.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calibrant.optimize.linear import in_free
from calibrant.optimize.solution import Solution
from calibrant.optimize.structure import SHARED, Placement

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

MOST_UNKNOWNS = 800
"""Unknowns up to which the dense inverse is taken: a tenth of a second. Beyond, there are hundreds of measurements, and
the levels are known so well that averaging over them adds less than a percent."""
LEAST_FREEDOM = 5.0
"""Directions that rest on fewer numbers are averaged as if on five: two groups that share one noise between them, whose
sum is known and does not change along it."""


def level_information(solution: Solution, groups: Sequence[str]) -> Array | None:
    """M (K, K) of the noise groups asked for; None for a problem too large for its dense inverse."""
    problem = solution.problem
    if not groups or problem.free_count > MOST_UNKNOWNS:
        return None
    shares = {g: np.zeros((problem.free_count,) * 2) for g in problem.noise_groups}
    total = np.zeros((problem.free_count,) * 2)
    counts = dict.fromkeys(problem.noise_groups, 0)
    for k, factor in enumerate(problem.factors):
        H = _dense(solution, k)
        total += H
        if factor.noise in shares:
            shares[factor.noise] += H
            counts[factor.noise] += factor.residual_count
    scale = 1 / np.sqrt(np.diag(total))
    C = np.linalg.inv(total * scale[:, None] * scale) * scale[:, None] * scale
    products = [shares[g] @ C for g in groups]
    M = np.array([[np.sum(a * b.T) for b in products] for a in products])
    M += np.diag([counts[g] - 2 * np.trace(p) for g, p in zip(groups, products)])
    return M


def averaged(solution: Solution, M: Array, groups: Sequence[str]) -> Solution:
    """The solution with its covariances averaged over the levels of the groups, which M (K, K) says how well known."""
    around = []
    for m, u in zip(*np.linalg.eigh(M)):
        step = np.sqrt(2 / max(float(m), LEAST_FREEDOM))
        for sign in (1.0, -1.0):
            moved = {g: solution.sigmas[g] / np.sqrt(1 + sign * step * part) for g, part in zip(groups, u)}
            around.append((0.5, _at(solution, {**solution.sigmas, **moved})))
    return replace(solution, around=((1.0 - len(groups), _at(solution, dict(solution.sigmas))), *around))


def level_deviations(M: Array) -> Array:
    """1 sigma (K,) of each level relative to itself: half that of its log variance, 2 M^-1."""
    values, vectors = np.linalg.eigh(M)
    return np.sqrt(0.5 * (vectors**2 @ (1 / np.maximum(values, 1e-12))))


def _at(solution: Solution, levels: dict[str, float]) -> Solution:
    """The same values under other noise levels."""
    equations = solution.problem.reweigh(solution.equations, solution.values, dict(solution.sigmas), levels)
    return replace(solution, sigmas=levels, equations=equations, around=())


def _dense(solution: Solution, k: int) -> Array:
    """Share (n, n) of factor k in the normal matrix of all free unknowns: components first, shared ones last."""
    problem = solution.problem
    factor, blocks = problem.factors[k], solution.equations.factors[k]
    bases, slots = problem.bases(k, solution.values), problem.structure.slots[k]
    placements = problem.structure.placements
    H = np.zeros((problem.free_count,) * 2)
    for (a, b), block in blocks.hessian.items():
        p, q = placements[slots[a]], placements[slots[b]]
        if p is None or q is None:
            continue
        rows, columns = _columns(solution, p, factor.indices[a]), _columns(solution, q, factor.indices[b])
        free = in_free(block, bases[a], bases[b])
        np.add.at(H, (rows[:, :, None], columns[:, None, :]), free)
        if a != b:
            np.add.at(H, (columns[:, :, None], rows[:, None, :]), np.swapaxes(free, -1, -2))
    return H


def _columns(solution: Solution, p: Placement, instances: Indices) -> Indices:
    """Columns (m, dim) of instances of a variable among all free unknowns."""
    batches = solution.problem.structure.batches
    first = np.concatenate([[0], np.cumsum([size * count for size, count in batches])]).astype(np.int64)
    sizes = np.array([*(size for size, _ in batches), 0], dtype=np.int64)
    # The shared unknowns come after the last component; they have no row.
    batch = np.where(p.batch[instances] == SHARED, len(batches), p.batch[instances])
    start = first[batch] + np.where(batch == len(batches), 0, p.row[instances]) * sizes[batch] + p.offset[instances]
    return np.asarray(start[:, None] + np.arange(p.dim), dtype=np.int64)
