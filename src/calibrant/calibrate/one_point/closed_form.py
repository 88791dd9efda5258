"""Camera and point from robot poses and measured points, without a first guess.

    R_x q_i + t_x = R_i p + t_i

is linear in (R_x, t_x, p) when R_x is taken as nine free numbers. Measured points that (nearly) lie in a plane do not
tell all nine: their coordinates along the r largest principal axes are used, R_x V_r free, r = 3 and 2. The point p
that comes out is kept, and the camera's pose is the best rigid motion of q_i onto R_i p + t_i (Kabsch 1976; Umeyama
1991). Of several starts, the one that leaves least is taken.

Gross errors: starts from many small samples are compared by the median of what they leave (least median of squares,
Rousseeuw 1984), the best are refitted to the better half of the data until that does not change (Rousseeuw and van
Driessen 1999).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array, Mask
from calibrant.geometry import se3

SAMPLE = 6
"""Poses of a sample: 18 equations for the 15 unknowns of the linear form."""
SAMPLES = 300
"""A sample of six has no gross error once in 64 where half of the poses have one: 300 all miss once in 100."""
REFITTED = 10
HALVES = 5


@dataclass(frozen=True, eq=False)
class Start:
    """T_a_camera (4, 4), the point (3,) in b, and what each pose leaves, over its distance from the camera (n,)."""

    T_a_camera: Array
    point: Array
    left: Array


def start_of(T_a_b: Array, q: Array) -> Start:
    """The best start from all poses (n, 4, 4) and measured points (n, 3)."""
    return _best(T_a_b, q, np.ones(len(q), dtype=np.bool_))


def robust_start(T_a_b: Array, q: Array, generator: np.random.Generator) -> tuple[Start, Mask]:
    """A start that gross errors in fewer than half of the poses do not bend, and the poses (n,) near to it."""
    n = len(q)
    half = (n + SAMPLE) // 2
    starts = []
    for _ in range(SAMPLES):
        chosen = np.zeros(n, dtype=np.bool_)
        chosen[generator.choice(n, size=SAMPLE, replace=False)] = True
        starts.append(_best(T_a_b, q, chosen))
    starts.sort(key=lambda s: float(np.median(s.left)))
    refitted = [_best(T_a_b, q, np.ones(n, dtype=np.bool_))]
    for start in starts[:REFITTED]:
        for _ in range(HALVES):
            start = _best(T_a_b, q, start.left <= np.sort(start.left)[half - 1])
        refitted.append(start)
    best = min(refitted, key=lambda s: float(np.sort(s.left)[:half].sum()))
    # Median of the norm of three normal numbers, with the small samples' factor of Rousseeuw and Leroy (1987).
    sigma = float(np.median(best.left)) / 1.5382 * (1 + 5 / max(3 * n - 9, 1))
    near = best.left <= max(4 * sigma, 1e-12)
    near[np.argsort(best.left)[:half]] = True
    return best, near


def _best(T_a_b: Array, q: Array, chosen: Mask) -> Start:
    T, points = T_a_b[chosen], q[chosen]
    candidates = [_aligned(T_a_b, q, chosen, p) for p in (_point(T, points, 3), _point(T, points, 2), np.zeros(3))]
    return min(candidates, key=lambda s: float(np.sum(s.left[chosen] ** 2)))


def _point(T_a_b: Array, q: Array, r: int) -> Array:
    """p (3,) by the linear form with r principal axes of the measured points."""
    centred = q - q.mean(axis=0)
    y = centred @ np.linalg.svd(centred, full_matrices=False)[2][:r].T
    n = len(q)
    A = np.zeros((n, 3, 3 * r + 6))
    for k in range(3):
        A[:, k, r * k : r * (k + 1)] = y
    A[:, :, 3 * r : 3 * r + 3] = np.eye(3)
    A[:, :, 3 * r + 3 :] = -T_a_b[:, :3, :3]
    found = np.linalg.lstsq(A.reshape(3 * n, -1), T_a_b[:, :3, 3].ravel(), rcond=1e-9)[0]
    return np.asarray(found[-3:], dtype=np.float64)


def _aligned(T_a_b: Array, q: Array, chosen: Mask, p: Array) -> Start:
    """The camera that carries the chosen measured points onto where p is."""
    where = se3.apply(T_a_b, p)
    a, b = where[chosen].mean(axis=0), q[chosen].mean(axis=0)
    U, _, Vt = np.linalg.svd((where[chosen] - a).T @ (q[chosen] - b))
    R = U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))]) @ Vt
    t = a - R @ b
    off = np.linalg.norm(q @ R.T + t - where, axis=1) / np.linalg.norm(q, axis=1)
    return Start(se3.make(R, t), p, off)
