"""What the doctor says: a finding with its confidence, its evidence, and the repair it proposes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from calibrant.data import Check, Measured
from calibrant.data.results import Status
from calibrant.diagnose.doctor.evidence.case import Case
from calibrant.diagnose.doctor.evidence.loop import Evidence, Loop

Repair = Callable[[Case], Case]


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

    @property
    def loops(self) -> tuple[Loop | None, Loop | None]:
        """The loop before the repair and after it; None where the evidence is another."""
        return (None, None) if self.evidence is None else (self.evidence.before, self.evidence.after)
