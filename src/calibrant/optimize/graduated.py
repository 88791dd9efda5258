"""Graduated non-convexity: a robust fit that does not need a good start.

Geman-McClure's loss ignores gross errors but has a minimum for every subset of the data that agrees. Black and
Rangarajan (1996) and Yang et al. (2020, "Graduated non-convexity for robust spatial perception") start from a surrogate
that is convex over the residuals, rho(s) = m s / (m + s) with m = mu k^2 and mu = 2 max(s) / k^2, and shrink mu towards
1, each fit starting from the last. At mu = 1 points beyond k sigmas have a weight below 1/4.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.optimize.levenberg_marquardt import SolverOptions, solve
from calibrant.optimize.losses import geman_mcclure, squared
from calibrant.optimize.problem import Problem, Values
from calibrant.optimize.solution import Solution

SHRINK = 1.4
"""Yang et al.'s factor: slow enough that a fit stays in the valley of the last one."""
STEPS_BETWEEN = 3
"""Steps at every intermediate mu: its minimum is not wanted, only the next start."""


@dataclass(frozen=True, eq=False)
class Graduated:
    """The fit at mu = 1. weights: for each robust factor, the weight (N,) in 0 … 1 of every residual block."""

    solution: Solution
    weights: Mapping[str, Array]
    stages: int


def solve_graduated(
    problem: Problem,
    *,
    factors: Sequence[str],
    k: float,
    start: Values | None = None,
    sigmas: Mapping[str, float] | None = None,
    options: SolverOptions | None = None,
) -> Graduated:
    """Minimise with Geman-McClure's loss on the named factors, by graduated non-convexity.

    k: residuals of k sigmas keep a quarter of their weight. The other factors keep their own loss.
    Raises: InputError for a factor that the problem does not have, or a start without a finite cost.
    """
    known = {f.name for f in problem.factors}
    missing = [name for name in factors if name not in known]
    if missing or not factors:
        raise InputError(f"graduated fitting needs factors of the problem ({', '.join(sorted(known))}), got {missing}")
    levels = dict(problem.sigmas if sigmas is None else sigmas)
    first = solve(problem.with_losses(dict.fromkeys(factors, squared())), start=start, sigmas=levels, options=options)
    largest = max(float(np.max(_norms(first, name))) for name in factors)
    mu, values, stages = max(2 * (largest / k) ** 2, 1.0), first.values, 1
    brief = SolverOptions(max_iterations=STEPS_BETWEEN)
    while mu > 1.0:
        loss = geman_mcclure(k, mu=mu)
        values = solve(
            problem.with_losses(dict.fromkeys(factors, loss)), start=values, sigmas=levels, options=brief
        ).values
        mu, stages = max(mu / SHRINK, 1.0), stages + 1
    final = problem.with_losses(dict.fromkeys(factors, geman_mcclure(k)))
    solution = solve(final, start=values, sigmas=levels, options=options)
    return Graduated(solution, {name: solution.weights(name) for name in factors}, stages + 1)


def _norms(solution: Solution, name: str) -> Array:
    problem = solution.problem
    k = problem.factor_index(name)
    factor = problem.factors[k]
    return factor.whitened_norms(problem.gather(k, solution.values), sigma=problem.sigma(factor, solution.sigmas))
