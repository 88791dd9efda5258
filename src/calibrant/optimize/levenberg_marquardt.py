"""Levenberg-Marquardt with gain-ratio damping.

Each iteration solves (H + lambda diag H) d = -g, compares the cost's true decrease with the model's prediction, and
adapts lambda by Nielsen's rule (Madsen, Nielsen, Tingleff 2004, "Methods for non-linear least squares problems", eq.
2.21): a good step multiplies lambda by max(1/10, 1 - (2 gain - 1)^3), a bad one by nu = 2, 4, 8, ... diag H makes the
steps independent of units.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

import numpy as np

from calibrant.cancel import checkpoint
from calibrant.errors import InputError
from calibrant.optimize import linear
from calibrant.optimize.linear import NormalEquations
from calibrant.optimize.problem import Problem, Values
from calibrant.optimize.solution import Solution


class Status(Enum):
    """Why the iteration ended, with the words that a person reads."""

    COST = "converged: the next step would not lower the cost"
    STEP = "converged: the step is below rounding"
    ERROR = "converged: the next step would lower the error by less than was asked for"
    STALLED = "stalled: no step lowers the cost any more"
    MAX_ITERATIONS = "stopped at the iteration limit before it converged"

    @property
    def converged(self) -> bool:
        return self in (Status.COST, Status.STEP, Status.ERROR)


@dataclass(frozen=True)
class SolverOptions:
    """When to stop. cost_tolerance: relative predicted decrease of the cost; norm_tolerance: predicted decrease of the
    residuals' norm, in their own unit; initial_damping: lambda at the start."""

    max_iterations: int = 100
    cost_tolerance: float = 1e-10
    norm_tolerance: float = 0.0
    initial_damping: float = 1e-4


CLOSE_ENOUGH = SolverOptions(cost_tolerance=1e-7)
"""A fit this close to its end is off by 1e-3 of its own sigma (cost of n residuals, n up to 1e5)."""
MAX_DAMPING = 1e16
"""At this damping a step is 1e-16 of the gradient step: nothing that rounding would not swallow."""


def solve(
    problem: Problem,
    *,
    start: Values | None = None,
    sigmas: Mapping[str, float] | None = None,
    options: SolverOptions | None = None,
) -> Solution:
    """Minimise the problem from `start` (the variables' own values by default) with the given noise levels.

    Returns a Solution with its status; a solve that did not converge says so there.
    Raises: InputError when the start has no finite cost (a point behind the camera, NaN in the data).
    """
    chosen = options or SolverOptions()
    levels = dict(problem.sigmas if sigmas is None else sigmas)
    values = problem.start if start is None else start
    equations = problem.linearize(values, levels)
    if not np.isfinite(equations.cost):
        raise InputError(_not_finite(problem, values))
    return _iterate(problem, values, equations, levels, chosen)


def solve_again(solution: Solution, sigmas: Mapping[str, float], *, options: SolverOptions | None = None) -> Solution:
    """Continue from a solution with other noise levels, without evaluating again what is known there."""
    levels = dict(sigmas)
    equations = solution.problem.reweigh(solution.equations, solution.values, dict(solution.sigmas), levels)
    return _iterate(solution.problem, solution.values, equations, levels, options or SolverOptions())


def _iterate(
    problem: Problem,
    values: Values,
    equations: NormalEquations,
    levels: Mapping[str, float],
    chosen: SolverOptions,
) -> Solution:
    history = [equations.cost]
    damping, growth = chosen.initial_damping, 2.0
    status = Status.MAX_ITERATIONS
    for _ in range(chosen.max_iterations):
        outcome = _advance(problem, values, equations, levels, damping, growth, chosen)
        damping, growth = outcome.damping, outcome.growth
        if outcome.values is not None and outcome.equations is not None:
            values, equations = outcome.values, outcome.equations
            history.append(equations.cost)
        if outcome.status is not None:
            status = outcome.status
            break
    return Solution(
        problem=problem,
        values=values,
        sigmas=levels,
        equations=equations,
        converged=status.converged or (status is Status.STALLED and _is_flat(equations, chosen)),
        status=status.name.lower(),
        message=status.value,
        history=tuple(history),
    )


@dataclass(frozen=True, eq=False)
class _Outcome:
    values: Values | None
    equations: NormalEquations | None
    damping: float
    growth: float
    status: Status | None


def _norm_decrease(cost: float, predicted: float) -> float:
    """By how much the norm of the residuals is to fall: the cost is half its square."""
    return float(np.sqrt(2 * cost) - np.sqrt(2 * max(cost - predicted, 0.0)))


def _advance(
    problem: Problem,
    values: Values,
    equations: NormalEquations,
    levels: Mapping[str, float],
    damping: float,
    growth: float,
    options: SolverOptions,
) -> _Outcome:
    """Raise the damping until a step lowers the cost, or end."""
    while damping < MAX_DAMPING:
        checkpoint()
        step = linear.solve(equations, damping)
        if step is None or not np.isfinite(step.predicted):
            damping, growth = max(damping, 1e-12) * growth, growth * 2
            continue
        # Residuals are in sigmas: a predicted decrease of 1e-20 is a step of 1e-10 sigma.
        if step.predicted <= options.cost_tolerance * equations.cost + 1e-20:
            return _Outcome(None, None, damping, growth, Status.COST)
        if options.norm_tolerance and _norm_decrease(equations.cost, step.predicted) <= options.norm_tolerance:
            return _Outcome(None, None, damping, growth, Status.ERROR)
        moved = problem.retract(values, step)
        trial = problem.linearize(moved, levels)
        gain = (equations.cost - trial.cost) / step.predicted
        if np.isfinite(trial.cost) and gain > 0:
            damping = max(damping * max(0.1, 1 - (2 * gain - 1) ** 3), 1e-15)
            # Below 1e-16 of the cost the difference of two costs is rounding.
            ended = equations.cost - trial.cost <= 1e-16 * equations.cost
            return _Outcome(moved, trial, damping, 2.0, Status.STEP if ended else None)
        if step.predicted <= 1e-13 * equations.cost:
            return _Outcome(None, None, damping, growth, Status.STEP)
        damping, growth = max(damping, 1e-12) * growth, growth * 2
    return _Outcome(None, None, damping, growth, Status.STALLED)


def _is_flat(equations: NormalEquations, options: SolverOptions) -> bool:
    """True when an undamped step predicts no decrease worth having: stalled at the minimum."""
    step = linear.solve(equations, 1e-12)
    return step is not None and step.predicted <= 1e-8 * equations.cost + 1e-20


def _not_finite(problem: Problem, values: Values) -> str:
    """Which factor and edge has no finite residual at the start."""
    for k, factor in enumerate(problem.factors):
        r = factor.residuals(*problem.gather(k, values))
        bad = np.flatnonzero(~np.isfinite(r).all(axis=-1))
        if len(bad):
            offsets = factor.row_offsets
            edge = int(bad[0]) if offsets is None else int(np.searchsorted(offsets, bad[0], side="right") - 1)
            where = ", ".join(
                problem.variables[v].label(int(i[edge])) for v, i in zip(problem.structure.slots[k], factor.indices)
            )
            return (
                f"the start of the calibration has no finite residual in {factor.name!r} ({where}): a point lies "
                "behind the camera, or the data hold NaN; give a better start or leave this view out"
            )
    return "the cost at the start is not finite; check the data for NaN and infinite values"
