"""Results of `calibrant tool touch` and `tool seen`: where a tool's tip is."""

from __future__ import annotations

from calibrant.data import CalibrationResult
from calibrant.data.details import TouchedPoint
from calibrant.reports.parts.blocks import Column, TextTable
from calibrant.reports.parts.figures import Fact, noise_facts
from calibrant.reports.parts.kind import Kind
from calibrant.reports.parts.numbers import plain
from calibrant.reports.parts.phrases import errors, first_transform, transform_facts, used

ROWS = "poses"


def _headline(result: CalibrationResult) -> list[Fact]:
    return [
        *transform_facts(result.transforms[:1]),
        *errors(result, "RMS error", "held-out error"),
        *used(result, ROWS),
    ]


def _facts(result: CalibrationResult) -> list[Fact]:
    touched = result.detail(TouchedPoint)
    if touched is None:
        return noise_facts(result, rows=ROWS)
    where = ", ".join(f"{c:.2f}" for c in touched.point_mm)
    return [*noise_facts(result, rows=ROWS), Fact("touched point", f"{where} mm", "x, y, z in the base frame")]


def _tables(result: CalibrationResult) -> list[TextTable]:
    touched = result.detail(TouchedPoint)
    if touched is None:
        return []
    rows = tuple((name, plain(off, digits=3)) for name, off in touched.off_mm.items())
    return [TextTable("How far each touch puts the tip from the point", (Column("pose"), Column("mm", True)), rows)]


KIND = Kind("Tool calibration", _headline, first_transform, _facts, ROWS, _tables)
