"""The loop A_i X B_i as the doctor compares it: before a fault is taken out, and after."""

from __future__ import annotations

from dataclasses import dataclass

from calibrant.diagnose.conventions.hypotheses import Alternative


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
