"""Results of `calibrant locate`: where an object is in the camera's frame, and the poses that look the same."""

from __future__ import annotations

from calibrant.data import CalibrationResult
from calibrant.data.details import LocatedObject
from calibrant.reports.parts.figures import Fact
from calibrant.reports.parts.kind import Kind
from calibrant.reports.parts.phrases import first_transform, placed


def _headline(result: CalibrationResult) -> list[Fact]:
    found = result.detail(LocatedObject)
    if found is None:
        return placed(result)
    u, v = found.segment_px
    return [
        Fact("object", found.words, found.name),
        *placed(result),
        Fact("seen at", f"{u:.1f}, {v:.1f} px", f"{found.area_px} px, {100 * found.overlap:.0f} % as drawn"),
        Fact("poses that look the same", str(len(found.symmetries)), "the one given and its symmetries"),
    ]


KIND = Kind("Object pose", _headline, first_transform, said=("undetermined", "seen"))
