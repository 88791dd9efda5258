"""Results of `calibrant rig`: where cameras that are fixed to each other stand, who saw what together, their clocks."""

from __future__ import annotations

from calibrant.data import CalibrationResult
from calibrant.data.details import CameraClocks, SharedMoments
from calibrant.reports.parts.blocks import Column, TextTable
from calibrant.reports.parts.figures import Fact, noise_facts
from calibrant.reports.parts.kind import Kind
from calibrant.reports.parts.numbers import plain, sigma_text, with_sigma
from calibrant.reports.parts.phrases import errors, focal_known, transform_facts, used

_MOST_IN_HEAD = 4
"""Cameras whose places stand in the few figures at the head; the tables have all."""


def _places(result: CalibrationResult) -> list[Fact]:
    root = next(iter(result.transforms)).parent if result.transforms else ""
    return transform_facts([t for t in result.transforms if t.parent == root][:_MOST_IN_HEAD])


def _held_out(result: CalibrationResult) -> list[Fact]:
    figure = result.figures.get("held-out RMS")
    if figure is None:
        return []
    there = result.figures.get("RMS there in the fit")
    note = "one moment of ten, left out" + ("" if there is None else f"; {plain(there.value, digits=3)} px in the fit")
    return [Fact("held-out RMS", f"{plain(figure.value, digits=3)} px", note)]


def _headline(result: CalibrationResult) -> list[Fact]:
    return [*_places(result), *errors(result, "RMS error"), *_held_out(result), *used(result)]


def _facts(result: CalibrationResult) -> list[Fact]:
    return [*noise_facts(result), *_held_out(result)]


def _answer(result: CalibrationResult) -> str:
    """The camera whose place is known least."""
    sigma = [(t.sigma_translation_mm, t.sigma_rotation_deg, t) for t in result.transforms if t.child in result.cameras]
    known = [(float(mm.max()), float(deg.max()), t) for mm, deg, t in sigma if mm is not None and deg is not None]
    if not known:
        return focal_known(result)
    mm, deg, worst = max(known, key=lambda k: k[0])
    where = f"{worst.child} stands in {worst.parent} to {sigma_text(mm)} mm and {sigma_text(deg)} deg"
    return f"{where} (1σ, worst axis)" + (", the others better." if len(known) > 1 else ".")


def _tables(result: CalibrationResult) -> list[TextTable]:
    return [*_shared(result), *_clocks(result)]


def _shared(result: CalibrationResult) -> list[TextTable]:
    found = result.detail(SharedMoments)
    if found is None:
        return []
    columns = (Column("camera"), *(Column(name, True) for name in found.cameras))
    rows = tuple((name, *(str(n) for n in row)) for name, row in zip(found.cameras, found.counts))
    return [TextTable("Moments seen together", columns, rows, "On the diagonal, moments that the camera saw at all.")]


def _clocks(result: CalibrationResult) -> list[TextTable]:
    found = result.detail(CameraClocks)
    if found is None:
        return []
    kinds = [
        (name, [(getattr(c, key), getattr(c, f"{key[:-3]}_sigma_ms")) for c in found.clocks])
        for name, key in (("late by, ms", "offset_ms"), ("readout, ms", "readout_ms"))
    ]
    shown = [(name, values) for name, values in kinds if any(v is not None for v, _ in values)]
    columns = (Column("camera"), *(Column(name, True) for name, _ in shown))
    cells = [[_value(*values[k]) for _, values in shown] for k in range(len(found.clocks))]
    rows = tuple((c.camera, *row) for c, row in zip(found.clocks, cells))
    note = f"Against {found.reference}; ± 1σ. Readout: from a picture's first row to its last."
    return [TextTable("Clocks", columns, rows, note)]


def _value(value: float | None, sigma: float | None) -> str:
    if value is None:
        return ""
    return with_sigma(value, sigma) if sigma is not None else plain(value, digits=3)


KIND = Kind("Rig calibration", _headline, _answer, _facts, tables=_tables, said=("matching", "times"))
