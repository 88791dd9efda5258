"""A camera that is late by an unknown time, before all else is known: the lateness under which its poses agree."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.cell.moments.sightings import relative
from calibrant.calibrate.cell.moments.swept import swept
from calibrant.calibrate.cell.starts.medoid import robust_mean
from calibrant.geometry import se3

LATENESS = np.linspace(-2.0, 2.0, 41)
"""Steps between moments that a clock is tried late by: more is another numbering of the frames."""


def scatter(D: Array) -> float:
    """Median distance of D (n, 4, 4) from the place that most agree on; a radian counts as a metre."""
    mm, deg = se3.deviation(np.broadcast_to(robust_mean(D), D.shape), D)
    return float(np.median(1e-3 * mm + np.deg2rad(deg)))


def led_back(T_a: Array, T_b: Array, moments: Sequence[str], times: Mapping[str, float]) -> Array:
    """T_b (n, 4, 4) when camera a took its pictures, by the target's motion and the lateness of the least scatter."""
    _, late = swept(moments, T_b, times)
    ways = [se3.retract(T_b, -2 * steps * late) for steps in LATENESS]  # what is swept is half a step
    return min(ways, key=lambda way: scatter(relative(T_a, way)))
