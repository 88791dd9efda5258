"""Did the touched point move while it was touched? One tip, and a point before and another from some touch on:

    R_i p + t_i = c_1 (i < k),  c_2 (i >= k)

Every k is tried. Three unknowns more must lower the sum of squares by more than chance would, all k counted (F test,
Bonferroni), and by more than three unknowns that take out the worst single touch: that one slipped, nothing moved.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array
from calibrant.data import RobotPoses
from calibrant.optimize.chances import f_tail

LEAST_TOUCHES = 6
"""Six touches leave nine numbers beyond the nine unknowns of two points."""
LEAST_PART = 2
"""A single touch elsewhere slipped."""
CONVINCING = 1e-3
"""Chance of a false alarm, all places counted: touches that are good are refused once in a thousand tools."""


@dataclass(frozen=True)
class MovedPoint:
    """first: the touch from which on the point is elsewhere, mm away; sigma_mm: of a touch with two points; p."""

    first: int
    mm: float
    sigma_mm: float
    p: float


def moved_point(T_base_flange: RobotPoses | ArrayLike) -> MovedPoint | None:
    """Where the touched point moved, from poses (n, 4, 4) in the order of touching; None where nothing says so."""
    poses = T_base_flange if isinstance(T_base_flange, RobotPoses) else RobotPoses.from_matrices(T_base_flange)
    n = len(poses)
    if n < LEAST_TOUCHES:
        return None
    R, t = poses.T_base_gripper[:, :3, :3], poses.T_base_gripper[:, :3, 3]
    one = np.zeros(n, dtype=np.intp)
    before, _ = _squares(R, t, one)
    slipped = min(_squares(R, t, np.where(np.arange(n) == i, 1, 0))[0] for i in range(n))
    splits = [(*_squares(R, t, (np.arange(n) >= k).astype(np.intp)), k) for k in range(LEAST_PART, n - LEAST_PART + 1)]
    after, points, first = min(splits, key=lambda s: s[0])
    if after >= slipped:
        return None
    spare = 3 * n - 9
    F = (before - after) / 3 / max(after / spare, np.finfo(float).tiny)
    p = min(1.0, len(splits) * float(f_tail(3, spare, F)))
    if p > CONVINCING:
        return None
    return MovedPoint(first, float(1e3 * np.linalg.norm(points[1] - points[0])), float(1e3 * np.sqrt(after / spare)), p)


def _squares(R: Array, t: Array, part: np.ndarray) -> tuple[float, Array]:
    """Sum of squares, m^2, of one tip and a point for each part (n,), and the points."""
    parts = int(part.max()) + 1
    spread, moved = R.copy(), t.copy()
    for k in range(parts):
        spread[part == k] -= R[part == k].mean(axis=0)
        moved[part == k] -= t[part == k].mean(axis=0)
    p = np.linalg.lstsq(spread.reshape(-1, 3), -moved.ravel(), rcond=None)[0]
    left = spread @ p + moved
    tips = R @ p + t
    return float(np.sum(left**2)), np.array([tips[part == k].mean(axis=0) for k in range(parts)])
