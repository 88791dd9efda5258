"""What `kinematics` identified, as the report shows it: corrections of parameters, or the axes of a free model."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibrant.data import CalibrationResult
from calibrant.data.details import JointAxes, JointAxis, RobotParameter, RobotParameters
from calibrant.reports.numbers import Figure, sigma_text, value_text

SHOWN_AS_TRANSFORMS = ("base", "tool")
"""Groups of parameters whose result is a transform of the page's own."""
_SHOWN_UNITS = {"m": ("mm", 1e3), "rad": ("deg", 180 / np.pi)}


@dataclass(frozen=True)
class Axis:
    """A row of the table of axes, as text: direction without unit, point in mm, 1 sigma of tilt and shift."""

    joint: str
    direction: str
    sigma_deg: str
    point: str
    sigma_mm: str


@dataclass(frozen=True)
class Geometry:
    """A robot's geometry: corrections that were identified, axes of a free model, what the data cannot tell apart."""

    corrections: tuple[Figure, ...]
    axes: tuple[Axis, ...]
    redundant: tuple[str, ...]


def geometry(result: CalibrationResult) -> Geometry | None:
    """The geometry that was found of a robot, None for a result without."""
    parameters, found = result.detail(RobotParameters), result.detail(JointAxes)
    if parameters is None:
        return None
    axes = tuple(_axis(axis) for axis in found.axes) if found is not None else ()
    several = len(parameters.robots) > 1
    rows = [
        replace(p, name=f"{robot}: {p.name}") if several else p
        for robot, mine in parameters.robots.items()
        for p in mine
        if p.group not in SHOWN_AS_TRANSFORMS
    ]
    # Of a free model the parameters are steps from an arbitrary start: its axes are what they mean.
    fitted = () if axes else tuple(_correction(p, p.sigma) for p in rows if p.sigma is not None)
    redundant = tuple(p.name for p in rows if (p.reason or "").startswith("redundant"))
    return Geometry(fitted, axes, redundant)


def _correction(p: RobotParameter, sigma: float) -> Figure:
    shown, factor = _SHOWN_UNITS.get(p.unit, (p.unit, 1.0))
    return Figure(p.name, factor * p.correction, factor * sigma, shown)


def _axis(axis: JointAxis) -> Axis:
    direction = ", ".join(f"{v:.6f}" for v in axis.direction)
    point = ", ".join(value_text(1e3 * v, axis.sigma_point_mm) for v in axis.point)
    # A sliding axis has a direction and no place.
    placed, shift = axis.kind == "revolute", sigma_text(axis.sigma_point_mm)
    return Axis(
        axis.joint, direction, sigma_text(axis.sigma_direction_deg), point if placed else "–", shift if placed else "–"
    )
