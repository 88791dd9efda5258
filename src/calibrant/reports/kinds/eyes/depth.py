"""Results of `calibrant depth`: how far away things are that two cameras see."""

from __future__ import annotations

from calibrant.data import CalibrationResult
from calibrant.reports.parts.depths import depth_answer, depth_facts
from calibrant.reports.parts.figures import Fact
from calibrant.reports.parts.kind import Kind
from calibrant.reports.parts.numbers import plain


def _headline(result: CalibrationResult) -> list[Fact]:
    facts = depth_facts(result, frame="left camera", measured_by=("sigma_matches", "match"))
    if not facts:
        return []
    return [
        *facts,
        Fact("σ of a disparity, median", f"{plain(result.figures['sigma_disparity'].value, digits=2)} px", ""),
    ]


KIND = Kind("Depth from two pictures", _headline, depth_answer, facts=_headline, said=("matched", "rows", "certainty"))
