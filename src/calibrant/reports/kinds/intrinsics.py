"""Results of `calibrant intrinsics`: a camera."""

from __future__ import annotations

from calibrant.data import CalibrationResult
from calibrant.data.details import BentTarget, FreeTarget, ModelChoice, RollingShutter
from calibrant.reports.parts.blocks import Column, TextTable
from calibrant.reports.parts.figures import Fact, noise_facts
from calibrant.reports.parts.kind import Kind
from calibrant.reports.parts.numbers import plain, with_sigma
from calibrant.reports.parts.phrases import errors, focal_facts, focal_known, used


def _headline(result: CalibrationResult) -> list[Fact]:
    noise = errors(result, "RMS error", "pixel noise, 1σ", "held-out error")
    return [*focal_facts(result), *noise, *used(result)]


def _facts(result: CalibrationResult) -> list[Fact]:
    """Errors and noise, and the shape of a target that was not taken as flat."""
    facts = noise_facts(result)
    bent, free = result.detail(BentTarget), result.detail(FreeTarget)
    if bent is not None:
        parts = [with_sigma(b, s, unit="mm") for b, s in zip(bent.bend_mm, bent.bend_sigma_mm)]
        parts.append(with_sigma(bent.twist_mm, bent.twist_sigma_mm, unit="mm"))
        facts.append(Fact("the target's sag", ", ".join(parts), "across columns, across rows, twist, ± 1σ"))
    if free is not None:
        off, flat = (plain(v, digits=2) for v in (free.out_of_plane_rms_mm, free.in_plane_rms_mm))
        text = f"{off} mm out of its plane, {flat} mm in it"
        facts.append(Fact("the target's points", text, f"RMS; most {plain(free.largest_mm, digits=2)} mm"))
    shutter = result.detail(RollingShutter)
    if shutter is not None:
        size = with_sigma(shutter.typical_px, shutter.typical_sigma_px, unit="px")
        facts.append(Fact("motion during readout", size, "RMS over views, ± 1σ"))
    return facts


def _tables(result: CalibrationResult) -> list[TextTable]:
    """The models between which the data chose, and how each view moved while it was read."""
    return [*_models(result), *_motions(result)]


def _motions(result: CalibrationResult) -> list[TextTable]:
    shutter = result.detail(RollingShutter)
    if shutter is None:
        return []
    columns = (Column("view"), Column("right px", True), Column("down px", True))
    rows = tuple(
        (name.rsplit("/", 1)[-1], *(with_sigma(x, s) for x, s in zip(view.px, view.sigma_px)))
        for name, view in shutter.views.items()
    )
    return [TextTable("Motion during readout", columns, rows, "Of the board's middle, first row to last, ± 1σ.")]


def _models(result: CalibrationResult) -> list[TextTable]:
    choice = result.detail(ModelChoice)
    if choice is None:
        return []
    columns = (Column("model"), Column("free", True), Column("RMS px", True), Column("held-out px", True), Column(""))
    rows = tuple(
        (c.model, str(c.free or ""), _pixels(c.rms_px), _pixels(c.held_out_px), c.reason or "")
        for c in choice.candidates
    )
    return [TextTable("Models tried", columns, rows, "The errors on views kept out of the fit decide.")]


def _pixels(value: float | None) -> str:
    return "–" if value is None else plain(value, digits=3)


KIND = Kind("Camera calibration", _headline, focal_known, _facts, tables=_tables)
