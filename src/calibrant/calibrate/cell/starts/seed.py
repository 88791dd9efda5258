"""The closed-form start: every solver on the same poses, the most consistent one chosen, gross outliers set aside."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.calibrate.cell.starts.robust import robust_fit
from calibrant.calibrate.reprojection.outliers import median
from calibrant.calibrate.solvers.loop_errors import (
    LoopConsistency,
    LoopErrors,
    consistency_of,
    loop_consistency,
    loop_errors,
)
from calibrant.calibrate.solvers.registry import SOLVERS
from calibrant.calibrate.solvers.relative import pose_pairs, sample
from calibrant.calibrate.solvers.setup import SETUPS, Setup
from calibrant.cancel import checkpoint
from calibrant.data import Check, MethodResult
from calibrant.errors import RefusedError
from calibrant.optimize.chances import MAXWELL_MEDIAN

GROSS_SIGMAS = 8.0
"""A view this far from where the others put the target is a fault, not noise: P = 1e-13 for Gaussian noise, and the
views differ in certainty by factors of two."""
GROSS_FLOOR = (1e-6, 1e-5)
"""Metres and radians below which a spread is rounding and nothing is called gross."""
MOST_GROSS = 1 / 3
"""At most this share of the views may be set aside: beyond it the fault is not in single views."""

SETUP_RATIO = 3.0
"""The other setup is the right one when its loop is this many times more consistent: noise moves the ratio of two loops
over the same poses by tens of per cent, a wrong setup by factors of ten and more."""

LONG_SESSION = 200
"""Poses beyond which single views hardly pull a closed form."""
MOST_FOR_START = 60
"""Poses of a longer session that a start is solved from: their 1770 motions put it within a fraction of the noise of a
single pose, from where the refinement over all poses ends at the same place. It is judged by all of them."""
SEEDING = tuple(name for name in SOLVERS if name != "convex")
"""Methods that a start is chosen from. The convex one costs as much as all others together, and its optimum, where it
can prove it, is theirs to well below the noise."""


@dataclass(frozen=True, eq=False)
class Seed:
    """A start: X, Z and the solver that gave them; keep (n,) views that agree; the loop of the kept ones."""

    X: Array
    Z: Array
    method: str
    keep: NDArray[np.bool_]
    loop: LoopConsistency


def best_seed(A: Array, B: Array, *, certainty: Array | None = None) -> Seed:
    """X and Z of the solver whose loop is the most consistent, gross outliers set aside.

    First those that a consensus finds, then one by one what the solvers still find.

    certainty (n,), >= 1: how much less certain each view is than a typical one; its deviation counts for less.
    Raises: RefusedError when no solver gives an answer; its message holds every solver's reason.
    """
    factor = np.ones(len(A)) if certainty is None else np.maximum(certainty, 1.0)
    limit = int(MOST_GROSS * len(A))
    keep = _without_gross(A, B, factor, limit)
    while True:
        X, Z, method = _most_consistent(A[keep], B[keep])
        loop = loop_consistency(A[keep], B[keep], X)
        worst = _worst(loop, factor[keep])
        if worst is None or len(A) - keep.sum() >= limit or keep.sum() <= 4:
            return Seed(X, Z, method, keep, loop)
        keep[np.flatnonzero(keep)[worst]] = False


def _without_gross(A: Array, B: Array, certainty: Array, limit: int) -> NDArray[np.bool_]:
    """Views that a consensus does not find gross; all of them where more than `limit` would go.

    Closed forms are pulled by every wrong view: with several, each round of all solvers would find one.
    """
    everything = np.ones(len(A), dtype=bool)
    if limit == 0 or len(A) > LONG_SESSION:
        return everything
    loop = loop_consistency(A, B, robust_fit(A, B, certainty=certainty).X)
    gross = _ratios(loop, certainty) > GROSS_SIGMAS
    return everything if gross.sum() > limit or len(A) - gross.sum() < 4 else ~gross


def seed_of_all(A: Array, B: Array) -> Seed:
    """X and Z of the solver whose loop is the most consistent over all views: enough to compare hypotheses by medians.

    Raises: RefusedError as `best_seed`.
    """
    X, Z, method = _most_consistent(A, B)
    return Seed(X, Z, method, np.ones(len(A), dtype=bool), loop_consistency(A, B, X))


def _most_consistent(A: Array, B: Array) -> tuple[Array, Array, str]:
    best: tuple[float, Array, Array, str] | None = None
    rows = sample(len(A), MOST_FOR_START if len(A) > LONG_SESSION else len(A))
    pairs = pose_pairs(A[rows], B[rows])
    refusals = []
    for name in SEEDING:
        checkpoint()
        try:
            X = SOLVERS[name].solve_pairs(pairs).X
        except RefusedError as error:
            refusals.append(str(error))
            continue
        loop = consistency_of(pairs, X)
        if best is None or loop.score < best[0]:
            best = (loop.score, X, loop.Z, name)
    if best is None:
        raise RefusedError(refusals[0])
    return best[1], best[2], best[3]


def _worst(loop: LoopConsistency, certainty: Array) -> int | None:
    """Index of the view that deviates most, when that is gross."""
    combined = _ratios(loop, certainty)
    worst = int(np.argmax(combined))
    return worst if combined[worst] > GROSS_SIGMAS else None


def _ratios(loop: LoopConsistency, certainty: Array) -> Array:
    """Deviation of each view over what is typical, the larger of distance and angle."""
    ratios = []
    for deviations, floor in ((loop.view_mm, 1e3 * GROSS_FLOOR[0]), (loop.view_deg, np.rad2deg(GROSS_FLOOR[1]))):
        sigma = max(median(deviations) / MAXWELL_MEDIAN, floor)
        ratios.append(deviations / (sigma * certainty))
    return np.asarray(np.maximum(*ratios), dtype=np.float64)


def compare_methods(A: Array, B: Array) -> dict[str, MethodResult]:
    """Every closed-form solver on the same poses: its X and loop, or why it has none."""
    table = {}
    pairs = pose_pairs(A, B)
    for name, solver in SOLVERS.items():
        checkpoint()
        try:
            found = solver.solve_pairs(pairs)
        except RefusedError as error:
            table[name] = MethodResult(None, None, None, str(error))
            continue
        table[name] = _method_result(found.X, found.loop)
    return table


def method_result(A: Array, B: Array, X: Array) -> MethodResult:
    """A method's row of the table."""
    return _method_result(X, loop_errors(A, B, X))


def _method_result(X: Array, loop: LoopErrors) -> MethodResult:
    return MethodResult(X, loop.rms_mm, loop.rms_deg)


def mean_of_methods(A: Array, B: Array, table: Mapping[str, MethodResult]) -> MethodResult:
    """The mean transform over the methods that answered (document 004's practice), with its loop."""
    from calibrant.geometry import se3

    answers = [m.matrix for m in table.values() if m.matrix is not None]
    if not answers:
        return MethodResult(None, None, None, "no method gave an answer")
    return method_result(A, B, se3.mean(np.stack(answers)))


def setup_check(setup: Setup, seed: Seed, other: Seed | None) -> Check:
    """Does the other setup explain the data better? `other` is None when it has no solution at all."""
    alternative = next(s for s in SETUPS.values() if s.name != setup.name)
    if other is None:
        return Check("setup", "ok", f"only {setup.name} explains the poses")
    ratio = seed.loop.score / max(other.loop.score, 1e-12)
    figures = (
        f"loop {seed.loop.median_mm:.3g} mm / {seed.loop.median_deg:.2g} deg as {setup.name}, "
        f"{other.loop.median_mm:.3g} mm / {other.loop.median_deg:.2g} deg as {alternative.name} (medians)"
    )
    if ratio > SETUP_RATIO:
        message = (
            f"the data fit {alternative.description}, not {setup.name}: {figures}; use --setup {alternative.name}, "
            "or check whether the poses are inverted"
        )
        return Check("setup", "fail", message, float(ratio))
    if ratio > 1 / SETUP_RATIO:
        return Check(
            "setup", "warn", f"both setups fit about equally well, the data do not tell which it is: {figures}", ratio
        )
    return Check("setup", "ok", figures, float(ratio))
