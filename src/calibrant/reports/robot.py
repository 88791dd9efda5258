"""What `kinematics` identified, as the report shows it: corrections of parameters, or the axes of a free model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibrant.data import CalibrationResult
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
    """The geometry that a kinematic calibration found, None for results of other kinds."""
    if result.kind != "kinematics":
        return None
    axes = tuple(_axis(row) for row in result.options.get("axes", ()))
    rows = [p for p in result.options.get("parameters", ()) if p["group"] not in SHOWN_AS_TRANSFORMS]
    # Of a free model the parameters are steps from an arbitrary start: its axes are what they mean.
    fitted = [] if axes else [p for p in rows if p.get("sigma") is not None]
    redundant = tuple(p["name"] for p in rows if str(p.get("reason", "")).startswith("redundant"))
    return Geometry(tuple(_correction(p) for p in fitted), axes, redundant)


def _correction(row: dict[str, object]) -> Figure:
    unit = str(row["unit"])
    shown, factor = _SHOWN_UNITS.get(unit, (unit, 1.0))
    value, sigma = float(str(row["correction"])), float(str(row["sigma"]))
    return Figure(str(row["name"]), factor * value, factor * sigma, shown)


def _axis(row: dict[str, object]) -> Axis:
    direction = ", ".join(f"{v:.6f}" for v in np.asarray(row["direction"], np.float64))
    tilt, shift = (
        None if row[key] is None else float(str(row[key])) for key in ("sigma_direction_deg", "sigma_point_mm")
    )
    point = ", ".join(value_text(1e3 * float(v), shift) for v in np.asarray(row["point"], np.float64))
    # A sliding axis has a direction and no place.
    placed = row["kind"] == "revolute"
    return Axis(
        str(row["joint"]), direction, sigma_text(tilt), point if placed else "–", sigma_text(shift) if placed else "–"
    )
