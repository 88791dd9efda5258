"""Results of `calibrant detect`: what was seen in images."""

from __future__ import annotations

from calibrant.data import CalibrationResult
from calibrant.reports.parts.figures import Fact
from calibrant.reports.parts.kind import Kind


def _headline(result: CalibrationResult) -> list[Fact]:
    seen = result.observations
    if seen is None:
        return []
    images = len(seen.views) + len(seen.missed)
    facts = [Fact("target found", f"in {len(seen.views)} of {images} images"), Fact("points", str(_points(result)))]
    return facts if seen.target is None else [*facts, Fact("target", seen.target)]


def _points(result: CalibrationResult) -> int:
    return sum(map(len, result.observations.views)) if result.observations is not None else 0


KIND = Kind("Observations", _headline)
