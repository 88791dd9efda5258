"""A robot's geometry as it was identified: corrections of parameters, or the axes of a free model, as tables."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibrant.data import CalibrationResult
from calibrant.data.details import JointAxes, JointAxis, RobotParameter, RobotParameters
from calibrant.reports.parts.blocks import Column, TextTable
from calibrant.reports.parts.numbers import Figure, sigma_text, value_text

_SHOWN_AS_TRANSFORMS = ("base", "tool")
"""Groups of parameters whose result is a transform of the page's own."""
_SHOWN_UNITS = {"m": ("mm", 1e3), "rad": ("deg", 180 / np.pi)}


def robot_tables(result: CalibrationResult) -> list[TextTable]:
    """What was found of a robot's geometry; nothing for a result without."""
    parameters, found = result.detail(RobotParameters), result.detail(JointAxes)
    if parameters is None:
        return []
    several = len(parameters.robots) > 1
    rows = [
        replace(p, name=f"{robot}: {p.name}") if several else p
        for robot, mine in parameters.robots.items()
        for p in mine
        if p.group not in _SHOWN_AS_TRANSFORMS
    ]
    redundant = [p.name for p in rows if (p.reason or "").startswith("redundant")]
    note = f"Not fitted, since others act in the same way: {', '.join(redundant)}." if redundant else ""
    # Of a free model the parameters are steps from an arbitrary start: its axes are what they mean.
    if found is not None:
        return [_axes_table(found, note)]
    return [_corrections([p for p in rows if p.sigma is not None], note)]


def _corrections(rows: list[RobotParameter], note: str) -> TextTable:
    columns = (Column("parameter"), *(Column(n, number=True) for n in ("correction", "± 1σ", "± 3σ")), Column("unit"))
    texts = tuple((f.name, f.value_text, f.sigma_text(), f.sigma_text(3), f.unit) for f in map(_figure, rows))
    return TextTable("The robot's geometry: corrections to what was given", columns, texts, note)


def _figure(p: RobotParameter) -> Figure:
    shown, factor = _SHOWN_UNITS.get(p.unit, (p.unit, 1.0))
    return Figure(p.name, factor * p.correction, None if p.sigma is None else factor * p.sigma, shown)


def _axes_table(found: JointAxes, note: str) -> TextTable:
    columns = (
        Column("joint"), Column("direction x, y, z"), Column("± 1σ, deg", number=True), Column("point x, y, z, mm"),
        Column("± 1σ, mm", number=True),
    )  # fmt: skip
    return TextTable("Axes in the measuring frame", columns, tuple(map(_axis, found.axes)), note)


def _axis(axis: JointAxis) -> tuple[str, ...]:
    direction = ", ".join(f"{v:.6f}" for v in axis.direction)
    point = ", ".join(value_text(1e3 * v, axis.sigma_point_mm) for v in axis.point)
    # A sliding axis has a direction and no place.
    placed, shift = axis.kind == "revolute", sigma_text(axis.sigma_point_mm)
    tilt = sigma_text(axis.sigma_direction_deg)
    return axis.joint, direction, tilt, point if placed else "–", shift if placed else "–"
