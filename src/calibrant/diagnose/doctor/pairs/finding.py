"""What the doctor says of a pair of cameras, and what undoes it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array, Mask
from calibrant.calibrate.cell.moments.pairs import PairPoses, off
from calibrant.data import Measured, Observations
from calibrant.data.results import Status
from calibrant.diagnose.doctor.evidence.loop import Loop
from calibrant.diagnose.doctor.evidence.significance import confidence, ratio_test
from calibrant.diagnose.doctor.pairs.case import PairCase, loop_of

Repair = Callable[[Observations], Observations]


@dataclass(frozen=True, eq=False)
class PairFinding:
    """A fault of a pair's pictures. confidence: 1 - p, p the chance of such evidence without the fault.

    before, after: the loop, None where the fault leaves it; views: ids; measured: the figure found; proposal, repair:
    what undoes it, in words (options of `calibrant stereo`) and done to the views.
    """

    name: str
    status: Status
    message: str
    confidence: float
    before: Loop | None = None
    after: Loop | None = None
    views: tuple[str, ...] = ()
    measured: Measured | None = None
    proposal: str = ""
    repair: Repair | None = None

    @property
    def text(self) -> str:
        """Message and cure."""
        return f"{self.message}; {self.proposal}" if self.proposal else self.message

    @property
    def loops(self) -> tuple[Loop | None, Loop | None]:
        """The loop before the repair and after it."""
        return self.before, self.after


@dataclass(frozen=True, eq=False)
class Judged:
    """A hypothesis: pairs as they are under it, and the place they then agree on; fits: how many do; p: the chance of
    so much better agreement of those concerned."""

    found: PairPoses
    fits: int
    p: float
    loop: Loop


def judged(case: PairCase, tried: PairPoses, place: Array, wrong: Mask, concerned: Mask, hypotheses: int) -> Judged:
    """A hypothesis against the pairs as given. concerned (n,): the tried pairs that it changes."""
    fits = ~wrong
    if not concerned.any():
        return Judged(tried, 0, 1.0, case.loop)
    contradicting = case.wrong if case.wrong.any() else np.ones(len(case), dtype=bool)
    before = float(np.median(off(case.found, case.place)[contradicting]))
    after = float(np.median(off(tried, place)[concerned]))
    p = ratio_test(before, after, 6 * int(concerned.sum()), hypotheses=hypotheses)
    return Judged(tried, int(fits.sum()), p, loop_of(tried.take(*(np.flatnonzero(fits),) * 2), place))


def sure(p: float) -> float:
    """1 - p, never a certainty."""
    return confidence(p)


def listed(names: list[str], most: int = 6) -> str:
    """Names, not too many."""
    return ", ".join(names[:most]) + (f" … ({len(names)})" if len(names) > most else "")
