"""Where the calibration has the target's points: as given, or bent or free where their places were estimated too."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calibrant.arrays import Array
from calibrant.data import CalibrationResult, View
from calibrant.data.details import BentTarget, FreeTarget


def target_points(result: CalibrationResult, views: Sequence[View]) -> list[Array]:
    """Points (n, 3) metres of each view, target frame, on the target's shape. Args: views, all of one target."""
    return points_on(result.detail(FreeTarget) or result.detail(BentTarget), views)


def points_on(shape: FreeTarget | BentTarget | None, views: Sequence[View]) -> list[Array]:
    """Points (n, 3) metres of each view, target frame, on a shape that was estimated; None is the one given."""
    if isinstance(shape, FreeTarget):
        return [v.points + 1e-3 * _moved(shape, v) for v in views]
    if shape is not None and views:
        every = np.concatenate([v.points[:, :2] for v in views])
        low, high = every.min(axis=0), every.max(axis=0)
        return [v.points + 1e-3 * _sag(shape, across(v.points[:, :2], low, high)) for v in views]
    return [v.points for v in views]


def _moved(free: FreeTarget, view: View) -> Array:
    none = (0.0, 0.0, 0.0)
    return np.array([free.deviation_mm.get(str(i), none) for i in view.point_ids.tolist()]).reshape(-1, 3)


def _sag(bent: BentTarget, places: Array) -> Array:
    x, y = places.T
    height = bent.bend_mm[0] * (1 - x**2) + bent.bend_mm[1] * (1 - y**2) + bent.twist_mm * x * y
    return np.column_stack([np.zeros((len(places), 2)), height])


def across(xy: Array, low: Array, high: Array) -> Array:
    """Places on the board (N, 2) from -1 to 1 along each of its axes, which reach from low to high (2,)."""
    return 2 * (xy - low) / np.maximum(high - low, np.finfo(float).tiny) - 1
