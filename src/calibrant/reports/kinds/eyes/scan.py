"""Results of `calibrant scan`: a scene measured by the patterns of a projector."""

from __future__ import annotations

from calibrant.data import CalibrationResult
from calibrant.reports.parts.depths import depth_answer, depth_facts
from calibrant.reports.parts.figures import Fact
from calibrant.reports.parts.kind import Kind
from calibrant.reports.parts.numbers import plain


def _headline(result: CalibrationResult) -> list[Fact]:
    facts = depth_facts(result, frame="camera", measured_by=("sigma_pixels", "pixels"))
    if not facts:
        return []
    across = f"{plain(result.figures['across'].value, digits=2)} σ"
    return [*facts, Fact("off the epipolar lines", across, "RMS; 1 by noise alone")]


KIND = Kind("Scan", _headline, depth_answer, facts=_headline, said=("scanned", "epipolar", "certainty"))
