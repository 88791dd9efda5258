"""A camera that is late by an unknown time, before all else is known: the lateness under which its poses agree."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.cell.moments.sightings import relative
from calibrant.calibrate.cell.moments.swept import swept
from calibrant.calibrate.cell.starts.medoid import robust_mean
from calibrant.geometry import se3

LATENESS = np.linspace(-2.0, 2.0, 41)
"""Steps between moments that a clock is tried late by: more is another numbering of the frames."""
SHARPER = 0.4
"""Scatter at the lateness found over that without one, from which a camera is late: the least of 41 that differ by
chance stays above nine tenths."""


@dataclass(frozen=True, eq=False)
class Led:
    """T_b (n, 4, 4) when camera a took its pictures; seconds that b is late by; scatter: of the pairs then over that
    without."""

    T_b: Array
    seconds: float
    scatter: float

    @property
    def late(self) -> bool:
        """Whether pairs agree far better at that lateness."""
        return self.scatter < SHARPER


def distances(D: Array, place: Array) -> Array:
    """Distance (n,) of each of D (n, 4, 4) from a place; a radian counts as a metre."""
    mm, deg = se3.deviation(np.broadcast_to(place, D.shape), D)
    return np.asarray(1e-3 * mm + np.deg2rad(deg))


def scatter(D: Array) -> float:
    """Median distance of D (n, 4, 4) from the place that most agree on."""
    return float(np.median(distances(D, robust_mean(D))))


def led_back(T_a: Array, T_b: Array, moments: Sequence[str], times: Mapping[str, float]) -> Led:
    """Camera b's poses led back by the target's motion and the lateness of the least scatter."""
    _, late = swept(moments, T_b, times)
    ways = [se3.retract(T_b, -2 * steps * late) for steps in LATENESS]  # what is swept is half a step
    found = [scatter(relative(T_a, way)) for way in ways]
    best, before = int(np.argmin(found)), found[len(LATENESS) // 2]
    known = [times[m] for m in moments if m in times]
    seconds = float(LATENESS[best] * np.median(np.diff(np.sort(known)))) if len(known) > 1 else 0.0
    return Led(ways[best], seconds, found[best] / before if before > 0 else 1.0)
