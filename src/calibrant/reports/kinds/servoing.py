"""Results of `calibrant servo`: a pose that was taught, and a run that led there."""

from __future__ import annotations

from math import isfinite

from calibrant.data import CalibrationResult
from calibrant.data.details import ServoTrace
from calibrant.reports.parts.blocks import Column, TextTable
from calibrant.reports.parts.figures import Fact
from calibrant.reports.parts.kind import Kind
from calibrant.reports.parts.numbers import plain, sigma_text, with_sigma

SHOWN = 12
"""Rows of a run's table: what happened far away is told by a few."""


def _taught(result: CalibrationResult) -> list[Fact]:
    facts = []
    for name, what in (("wanted position", "mm"), ("wanted turn", "deg")):
        figure = result.figures.get(name)
        if figure is not None and isfinite(figure.sigma):
            facts.append(Fact(name, f"± {sigma_text(figure.sigma)} {what}", "as the features tell it, worst direction"))
    if "features" in result.figures:
        facts.append(Fact("features", plain(result.figures["features"].value), ""))
    if "distance" in result.figures:
        facts.append(Fact("distance", f"{plain(result.figures['distance'].value)} mm", "of the features"))
    return facts


def _taught_answer(result: CalibrationResult) -> str:
    figure = result.figures.get("wanted position")
    return "" if figure is None else f"The wanted pose is known to {sigma_text(figure.sigma)} mm (1σ, worst direction)."


def _arrived(result: CalibrationResult) -> list[Fact]:
    facts = []
    for name, unit in (("remaining distance", "mm"), ("remaining turn", "deg")):
        figure = result.figures.get(name)
        if figure is not None:
            facts.append(Fact(name, f"{with_sigma(figure.value, figure.sigma)} {unit}", "mean of pictures at rest"))
    for name, unit in (("pictures", ""), ("time", "s")):
        if name in result.figures:
            facts.append(Fact(name, f"{plain(result.figures[name].value)} {unit}".strip(), ""))
    return facts


def _arrived_answer(result: CalibrationResult) -> str:
    figure = result.figures.get("remaining distance")
    return "" if figure is None else f"{with_sigma(figure.value, figure.sigma)} mm remain to the taught pose (1σ)."


def _way(result: CalibrationResult) -> list[TextTable]:
    trace = result.detail(ServoTrace)
    if trace is None or not trace.samples:
        return []
    count = len(trace.samples)
    rows = sorted({round(k * (count - 1) / (SHOWN - 1)) for k in range(SHOWN)})
    columns = [Column(n, True) for n in ("t [s]", "error [px]", "remain [mm]", "[deg]", "gain [1/s]", "held by")]
    cells = []
    for k in rows:
        s = trace.samples[k]
        cells.append(
            [
                f"{s.time_s:.1f}",
                f"{s.error_px:.2f}",
                f"{s.mm:.2f}",
                f"{s.deg:.3f}",
                f"{s.gain:.1f}",
                ", ".join(s.held_by),
            ]
        )
    return [TextTable(f"The way, by {trace.control} control", tuple(columns), tuple(map(tuple, cells)))]


TARGET = Kind("Taught pose", _taught, _taught_answer, _taught, said=("stability",))
RUN = Kind("Servoing", _arrived, _arrived_answer, _arrived, tables=_way, said=("stability", "arrived"))
