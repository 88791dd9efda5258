"""Faults that all views share: a column of the scores beside the lens, its size, and whether it is real and matters.

Several faults leave a little of each other in every single estimate. The one that explains most is taken first, the
others are asked beside it, until none is left that is beyond chance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array, Indices
from calibrant.calibrate.review.view_scores import (
    Estimate,
    ViewScores,
    estimate,
    kept_columns,
    lens_shift,
)
from calibrant.optimize.chances import chi2_tail, f_tail

CHANCE = 1e-3
"""One false finding in a thousand sets whose views err alike; it warns only where it moves the camera as well."""
HELD = 0.05
"""From here on what is beyond white noise is no longer taken for the views' scatter alone."""
MATTERS = 1.0
"""Squared shift of the lens over its sigma, per parameter: from here on a fault takes more than the sigma stated."""


@dataclass(frozen=True, eq=False)
class Fault:
    """A column found beside the lens: its estimate and where in it, its covariance from the views' scatter, how much of
    it the lens does not have already (0 to 1; 0 where it is within noise), the chance of as much without it, by how
    much it moves the lens's parameters (k,), and the square of that of (fx, fy, cx, cy) over their sigma, per
    parameter."""

    found: Estimate
    own: Indices
    covariance: Array
    independent: float
    chance: float
    moved: Array
    shift: float

    @property
    def value(self) -> Array:
        return self.found.value[self.own]

    @property
    def sigma(self) -> Array:
        return np.sqrt(np.diag(self.covariance))

    @property
    def real(self) -> bool:
        return self.chance < CHANCE

    @property
    def held(self) -> bool:
        """Whether it may be real, beyond white noise as it is: then sigma holds it without a word."""
        return self.chance < HELD

    @property
    def matters(self) -> bool:
        """Whether it moves the lens by more than what else is uncertain of it."""
        return self.shift >= MATTERS

    @property
    def squares(self) -> float:
        """How much of the weighted squares it explains."""
        return self.found.chi_square(self.own)


def fault(scores: ViewScores, name: str, *, beside: Sequence[str] = ()) -> Fault | None:
    """A column's estimate; None where the views do not determine it, or not without one of them."""
    columns, own = kept_columns(scores, *beside, name)
    mine = own[-len(scores.columns[name]) :]
    found = estimate(scores, columns)
    if found is None:
        return None
    n, q = len(scores), len(mine)
    value, covariance = found.value[mine], found.covariance[np.ix_(mine, mine)]
    chance = chi2_tail(q, found.chi_square(mine))
    shift, independent = np.zeros(len(scores.lens)), 0.0
    if chance < CHANCE:  # beyond white noise: is it beyond what the views scatter?
        left_out = estimate(scores, columns, leave_out=True)
        if left_out is None or left_out.moved is None:
            return None
        moved = left_out.moved[:, mine]
        covariance = (n - 1) / n * moved.T @ moved
        if n - q < 1 or np.linalg.matrix_rank(covariance) < q:
            return None
        statistic = float(value @ np.linalg.solve(covariance, value)) * (n - q) / (q * (n - 1))
        chance = max(float(f_tail(q, n - q, statistic)), chance)
        others = columns[np.isin(columns, columns[mine], invert=True)]
        before = estimate(scores, others)
        if before is not None:
            shift = found.value[: len(shift)] - before.value[: len(shift)]
        left = np.linalg.inv(found.covariance[np.ix_(mine, mine)]) * scores.sigma_px**2
        independent = float(np.min(np.diag(left) / np.diag(scores.together)[columns[mine]]))
    moved_by = lens_shift(scores, shift) if shift.any() else 0.0
    return Fault(found, mine, covariance, independent, chance, shift, moved_by)


@dataclass(frozen=True, eq=False)
class Found:
    """What was asked by name, each beside the others that are real; None where the views do not determine it."""

    by_name: dict[str, Fault | None]

    @property
    def real(self) -> tuple[str, ...]:
        return tuple(name for name, f in self.by_name.items() if f is not None and f.real)


def faults(scores: ViewScores, names: Sequence[str]) -> Found:
    """The faults of these names, the strongest first and the others beside it."""
    found = {name: fault(scores, name) for name in names}
    taken: list[str] = []
    while True:
        open_ = [(f.squares, name) for name, f in found.items() if f is not None and f.real and name not in taken]
        if not open_:
            break
        taken.append(max(open_)[1])
        for name in names:
            beside = tuple(t for t in taken if t != name)
            if beside:
                found[name] = fault(scores, name, beside=beside) or found[name]
    return Found(found)
