"""What the doctor says: a finding with its confidence, its evidence, and the repair it proposes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from calibrant.data import Check, Measured
from calibrant.data.results import Status

if TYPE_CHECKING:
    from calibrant.diagnose.conventions.hypotheses import Alternative
    from calibrant.diagnose.doctor.case import Case

Repair = Callable[["Case"], "Case"]


@dataclass(frozen=True)
class Loop:
    """Spread of the loop A_i X B_i about what the views that agree say: rms over all views used."""

    mm: float
    deg: float

    @classmethod
    def of(cls, hypothesis: Alternative) -> Loop:
        """The loop as a notation of the poses closes it."""
        return cls(hypothesis.loop_rms_mm, hypothesis.loop_rms_deg)

    @property
    def text(self) -> str:
        """The loop in words."""
        return f"{self.mm:.3g} mm / {self.deg:.2g} deg"


@dataclass(frozen=True)
class Evidence:
    """The loop as the data stand, and with the fault taken out."""

    before: Loop
    after: Loop

    @property
    def text(self) -> str:
        """Both in words."""
        return f"the loop closes to {self.after.text} instead of {self.before.text}"


@dataclass(frozen=True, eq=False)
class Finding:
    """One fault, or one question answered with "no fault".

    confidence: 1 - p, p the chance of such evidence from data without the fault, all hypotheses of its kind counted.
    views: ids of the views or poses concerned. measured: the figure found, with its sigma. repair: a pure function on
    the case, None when only a person can cure it; what it does stands in `proposal`. gain: how much more likely the
    repaired data are, in nats (ln).
    """

    name: str
    status: Status
    message: str
    confidence: float = 1.0
    evidence: Evidence | None = None
    views: tuple[str, ...] = ()
    measured: Measured | None = None
    proposal: str = ""
    repair: Repair | None = None
    gain: float = 0.0

    @property
    def check(self) -> Check:
        """The finding as a check of a result; its value is the measured figure, else the confidence."""
        text = self.message if not self.proposal else f"{self.message}; {self.proposal}"
        return Check(self.name, self.status, text, self.measured.value if self.measured else self.confidence)
