"""Noise levels from the data: variance components by redundancies.

Each noise group k (pixels, robot rotation, robot translation) has n_k residuals with unknown standard deviation
sigma_k. At the solution, with H_k the group's share of the normal matrix and C its inverse,

    sigma_k^2 <- v_k^T v_k / r_k,     r_k = n_k - trace(H_k C),

v_k the unweighted residuals (Foerstner 1979; Koch 1999, "Parameter estimation and hypothesis testing in linear models",
sec. 3.6). r_k is the number of residuals that are left to tell the noise, sum r_k = residuals - unknowns. Iterated to a
fixed point this is the restricted maximum likelihood estimate; its own deviation is sigma_k / sqrt(2 r_k).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrant.optimize.factors import EXACT
from calibrant.optimize.levenberg_marquardt import SolverOptions, solve, solve_again
from calibrant.optimize.linear import in_free
from calibrant.optimize.problem import Problem, Values
from calibrant.optimize.solution import Solution
from calibrant.optimize.structure import SHARED

Array = NDArray[np.float64]

MAX_ROUNDS = 60
TOLERANCE = 1e-3
"""Relative change of every sigma that ends the rounds: far below the estimates' own deviation, 1 / sqrt(2 r)."""
MINIMUM_REDUNDANCY = 1.0
"""A group with less than one residual to spare cannot tell its noise: its level stays where it is."""


@dataclass(frozen=True)
class NoiseLevel:
    """sigma of a group in its residuals' unit, its own 1 sigma, and the redundancy it rests on.

    at_floor: the data are consistent with less noise than the floor given, or with none.
    """

    sigma: float
    deviation: float
    redundancy: float
    at_floor: bool = False

    @property
    def determined(self) -> bool:
        """False when the group had nothing to spare and kept its starting level."""
        return self.redundancy >= MINIMUM_REDUNDANCY


@dataclass(frozen=True, eq=False)
class NoiseEstimate:
    """The solution at the estimated levels; settled: the levels stopped changing within the rounds allowed."""

    solution: Solution
    levels: Mapping[str, NoiseLevel]
    rounds: int
    settled: bool


def redundancies(solution: Solution) -> dict[str, tuple[float, float, int]]:
    """For each noise group: sum of squared residuals (unit weights), redundancy r_k, number of residuals n_k."""
    problem, levels = solution.problem, solution.sigmas
    out: dict[str, tuple[float, float, int]] = {}
    for k, factor in enumerate(problem.factors):
        if factor.noise == EXACT:
            continue
        sigma = problem.sigma(factor, levels)
        if factor.loss.is_plain:
            squares = 2 * solution.equations.factors[k].cost * sigma**2
        else:
            norms = factor.whitened_norms(problem.gather(k, solution.values), sigma=sigma)
            squares = float(np.sum(factor.loss.evaluate(norms**2)[1] * norms**2)) * sigma**2
        trace = _trace(solution, k)
        before = out.get(factor.noise, (0.0, 0.0, 0))
        out[factor.noise] = (
            before[0] + squares,
            before[1] + factor.residual_count - trace,
            before[2] + factor.residual_count,
        )
    return out


def _trace(solution: Solution, k: int) -> float:
    """trace(H_k C) of one factor, edge by edge."""
    problem = solution.problem
    factor, blocks = problem.factors[k], solution.equations.factors[k]
    bases = problem.bases(k, solution.values)
    slots = problem.structure.slots[k]
    total = 0.0
    for (a, b), H in blocks.hessian.items():
        C = _edge_covariance(solution, slots[a], factor.indices[a], slots[b], factor.indices[b])
        if C is None:
            continue
        share = float(np.sum(in_free(H, bases[a], bases[b]) * C))
        total += share if a == b else 2 * share
    return total


def _edge_covariance(solution: Solution, a: int, i: NDArray[np.int64], b: int, j: NDArray[np.int64]) -> Array | None:
    """Covariance (m, free_a, free_b) between instances i of variable a and j of variable b; None for constants."""
    p, q = solution.problem.structure.placements[a], solution.problem.structure.placements[b]
    if p is None or q is None:
        return None
    blocks = solution.blocks
    out = np.empty((len(i), p.dim, q.dim))
    rows, columns = p.offset[i][:, None] + np.arange(p.dim), q.offset[j][:, None] + np.arange(q.dim)
    batch_a, batch_b = p.batch[i], q.batch[j]
    for pa, pb in {(int(x), int(y)) for x, y in zip(batch_a, batch_b)}:
        m = (batch_a == pa) & (batch_b == pb)
        r, c = rows[m][:, :, None], columns[m][:, None, :]
        if pa == SHARED and pb == SHARED:
            out[m] = blocks.shared[r, c]
        elif pb == SHARED:
            out[m] = blocks.cross[pa][p.row[i[m]][:, None, None], r, c]
        elif pa == SHARED:
            out[m] = np.swapaxes(
                blocks.cross[pb][q.row[j[m]][:, None, None], columns[m][:, :, None], rows[m][:, None, :]], -1, -2
            )
        else:
            # An edge's eliminated instances share a component by construction.
            out[m] = blocks.own[pa][p.row[i[m]][:, None, None], r, c]
    return out


def estimate_noise(
    problem: Problem,
    *,
    start: Values | None = None,
    sigmas: Mapping[str, float] | None = None,
    floors: Mapping[str, float] | None = None,
    options: SolverOptions | None = None,
) -> NoiseEstimate:
    """Solve the problem and its noise levels together, from a guess of the levels.

    floors: smallest level of each group worth telling from zero, in its unit; without one a group that fits exactly
    would shrink without end. Raises: RefusedError when the problem is not determined.
    """
    levels = dict(problem.sigmas if sigmas is None else sigmas)
    lowest = {g: (floors or {}).get(g, 0.0) for g in problem.noise_groups}
    solution = solve(problem, start=start, sigmas=levels, options=options)
    estimate: dict[str, NoiseLevel] = {}
    settled, rounds = False, 0
    previous: dict[str, float] = {}
    while not settled and rounds < MAX_ROUNDS:
        rounds += 1
        estimate = _update(redundancies(solution), levels, lowest)
        change = {g: float(np.log(e.sigma / levels.get(g, 1.0))) for g, e in estimate.items()}
        settled = max(abs(c) for c in change.values()) < TOLERANCE
        ahead = {} if settled else {g: _extrapolation(c, previous.get(g)) for g, c in change.items()}
        levels = {**levels, **{g: max(e.sigma * np.exp(ahead.get(g, 0.0)), lowest[g]) for g, e in estimate.items()}}
        solution = solve_again(solution, levels, options=options)
        # After a jump the next change is not part of the geometric series any more.
        previous = {g: c for g, c in change.items() if ahead.get(g, 0.0) == 0.0}
    return NoiseEstimate(solution, estimate, rounds, settled)


def _extrapolation(change: float, before: float | None) -> float:
    """What is left of a geometric series of changes (Aitken): change q / (1 - q), q the last ratio.

    The plain iteration converges linearly, slowly where a group's redundancy is small. q is capped at 0.9, so that a
    chance ratio near 1 cannot throw a level away.
    """
    if before is None or before == 0.0 or not 0.2 < change / before < 1.0:
        return 0.0
    q = min(change / before, 0.9)
    return change * q / (1 - q)


def _update(
    parts: Mapping[str, tuple[float, float, int]], levels: Mapping[str, float], lowest: Mapping[str, float]
) -> dict[str, NoiseLevel]:
    out = {}
    for group, (squares, redundancy, _) in parts.items():
        current = levels.get(group, 1.0)
        if redundancy < MINIMUM_REDUNDANCY:
            out[group] = NoiseLevel(current, float("inf"), float(redundancy))
            continue
        sigma = float(np.sqrt(squares / redundancy))
        floor = lowest[group]
        out[group] = NoiseLevel(max(sigma, floor), sigma / np.sqrt(2 * redundancy), float(redundancy), sigma <= floor)
    return out
