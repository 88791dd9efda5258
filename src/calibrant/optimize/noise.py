"""Noise levels from the data: variance components by redundancies.

Each noise group k (pixels, robot rotation, robot translation) has n_k residuals with unknown standard deviation
sigma_k. At the solution, with H_k the group's share of the normal matrix and C its inverse,

    sigma_k^2 <- v_k^T v_k / r_k,     r_k = n_k - trace(H_k C),

v_k the unweighted residuals (Foerstner 1979; Koch 1999, "Parameter estimation and hypothesis testing in linear models",
sec. 3.6). r_k is the number of residuals that are left to tell the noise, sum r_k = residuals - unknowns. Iterated to a
fixed point this is the restricted maximum likelihood estimate; its own deviation is sigma_k / sqrt(2 r_k) for one
group, and larger where groups compete for the same residuals (`level_spread`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from calibrant.optimize import level_spread
from calibrant.optimize.factors import EXACT
from calibrant.optimize.levenberg_marquardt import SolverOptions, solve, solve_again
from calibrant.optimize.problem import Problem, Values
from calibrant.optimize.solution import Solution

MAX_ROUNDS = 60
TOLERANCE = 1e-3
"""Relative change of every sigma that ends the rounds: far below the estimates' own deviation, 1 / sqrt(2 r)."""
LONGEST_STEP = 2.0
"""Change of a log level in a round, a factor of 7: a level that goes to zero goes there in steps."""
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
    """The solution at the estimated levels, its covariances averaged over what the levels are uncertain by.

    settled: the levels stopped changing within the rounds allowed.
    """

    solution: Solution
    levels: Mapping[str, NoiseLevel]
    rounds: int
    settled: bool


def redundancies(solution: Solution) -> dict[str, tuple[float, float, int]]:
    """For each noise group: sum of squared residuals (unit weights), redundancy r_k, number of residuals n_k."""
    problem, levels = solution.problem, solution.sigmas
    shares = solution.noise_shares
    out = {g: (0.0, float(n - t), int(n)) for g, n, t in zip(shares.groups, shares.counts, shares.traces)}
    for k, factor in enumerate(problem.factors):
        if factor.noise == EXACT:
            continue
        sigma = problem.sigma(factor, levels)
        if factor.loss.is_plain:
            squares = 2 * solution.equations.factors[k].cost * sigma**2
        else:
            norms = factor.whitened_norms(problem.gather(k, solution.values), sigma=sigma)
            squares = float(np.sum(factor.loss.evaluate(norms**2)[1] * norms**2)) * sigma**2
        before, freedom, count = out[factor.noise]
        out[factor.noise] = (before + squares, freedom, count)
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
    settled, rounds, share = False, 0, 1.0
    before: dict[str, float] = {}
    while not settled and rounds < MAX_ROUNDS:
        rounds += 1
        parts = redundancies(solution)
        estimate = _update(parts, levels, lowest)
        change = _scoring_step(solution, parts, estimate)
        settled = all(abs(c) < TOLERANCE for c in change.values())
        # Steps that turn back overshoot: a level that is hardly known is curved more than its information says.
        back = sum(c * before.get(g, 0.0) for g, c in change.items()) < 0
        share = share / 2 if back else min(1.0, 1.2 * share)
        before = change
        moved = {g: max(levels.get(g, 1.0) * np.exp(share * c), lowest[g]) for g, c in change.items()}
        levels = {**levels, **moved}
        solution = solve_again(solution, levels, options=options)
    return with_spread(NoiseEstimate(solution, estimate, rounds, settled))


def _scoring_step(
    solution: Solution, parts: Mapping[str, tuple[float, float, int]], estimate: Mapping[str, NoiseLevel]
) -> dict[str, float]:
    """Changes of the log levels by Fisher's scoring, d log sigma = 1/2 M^-1 (v^T v / sigma^2 - r).

    The plain iteration sigma^2 <- v^T v / r takes tens of rounds where groups compete, or where one goes to zero.
    """
    levels = solution.sigmas
    falling = {g for g, e in estimate.items() if np.log(e.sigma / levels.get(g, 1.0)) <= -TOLERANCE}
    # A level at its floor that would fall further stays there; the others are settled around it.
    moving = [g for g, e in estimate.items() if e.determined and not (e.at_floor and g not in falling)]
    if not moving:
        return {}
    M = solution.noise_shares.information(tuple(moving))
    surplus = np.array([parts[g][0] / solution.sigmas.get(g, 1.0) ** 2 - parts[g][1] for g in moving])
    # Least squares: of two groups that the residuals cannot tell apart, both move alike.
    step = 0.5 * np.linalg.lstsq(M, surplus, rcond=1e-6)[0]
    return {g: float(np.clip(c, -LONGEST_STEP, LONGEST_STEP)) for g, c in zip(moving, step)}


def with_spread(found: NoiseEstimate) -> NoiseEstimate:
    """The estimate with deviations of the levels that know of each other, and covariances averaged over them."""
    groups = [g for g, level in found.levels.items() if level.determined]
    M = found.solution.noise_shares.information(tuple(groups))
    relative = dict(zip(groups, level_spread.level_deviations(M)))
    levels = {
        g: replace(level, deviation=float(level.sigma * relative[g])) if g in relative else level
        for g, level in found.levels.items()
    }
    return replace(found, solution=level_spread.averaged(found.solution, M, groups), levels=levels)


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
