"""Where the calibration has the target's points: as given, bent or free, or where a moving view's rows saw them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calibrant.arrays import Array
from calibrant.data import CalibrationResult, View
from calibrant.data.details import BentTarget, FreeTarget, RollingShutter
from calibrant.geometry import so3


def target_points(result: CalibrationResult, views: Sequence[View]) -> list[Array]:
    """Points (n, 3) metres of each view, target frame, on the target's shape and where it was when its row was read.

    Args: views, all of one target.
    """
    shutter = result.detail(RollingShutter)
    if shutter is not None:
        return [_when_read(shutter, v) for v in views]
    return points_on(result.detail(FreeTarget) or result.detail(BentTarget), views)


def readout_time(rows: Array, height: int) -> Array:
    """When rows (n,) of an image are read, -1/2 … 1/2 of the readout: pixel centres are whole numbers."""
    return np.asarray((rows + 0.5) / height - 0.5)


def in_motion(points: Array, centre: Array, motion: Array, time: Array) -> Array:
    """Points (n, 3) that turn about centre (n or 1, 3), which moves, at times (n,): exp(s omega) (p - c) + c + s v.

    Args: motion (n or 1, 6), omega and v over one unit of time, radians and metres.
    """
    s = time[:, None]
    arm = (so3.exp(s * motion[:, :3]) @ (points - centre)[:, :, None])[:, :, 0]
    return np.asarray(arm + centre + s * motion[:, 3:])


def _when_read(shutter: RollingShutter, view: View) -> Array:
    motion = shutter.views.get(view.id)
    if motion is None:
        return view.points
    x = np.array([[*motion.turn_rad, *motion.shift_m]])
    return in_motion(view.points, np.array([motion.centre_m]), x, readout_time(view.uv[:, 1], shutter.rows))


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
