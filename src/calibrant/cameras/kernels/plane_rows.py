"""Compiled inverse of polynomial distortion in the plane (k1 k2 p1 p2 k3), for the models that contain it.

Functions here are inlined into the compiled forms of other files, whose caches know only their own file's age: after a
change here, touch brown_rays, unified_rays, inverse_brown_rows and division_rows.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from calibrant.cameras.kernels.contract import FAST

BLOCK = 256
"""Pixels solved together: their scratch rows (12 kB) stay in the first-level cache."""
TABLE = 1024
"""Entries of the first guess: linear between them it is good to 1e-5, two Newton steps from rounding."""


@njit(cache=True, nogil=True, error_model="numpy")
def radius_limit(k1, k2, k3):  # type: ignore[no-untyped-def]
    """First r with d(r g)/dr = 1 + 3 k1 s + 5 k2 s^2 + 7 k3 s^3 = 0, s = r^2; inf when there is none.

    Between the extrema of the cubic it is monotone, so that bisection finds the first change of sign.
    """
    a, b, c = 3.0 * k1, 5.0 * k2, 7.0 * k3
    stops = np.array([np.inf, np.inf, np.inf])
    found = 0
    if c != 0.0:
        root = b * b - 3.0 * a * c
        if root > 0.0:
            root = np.sqrt(root)
            for e in sorted([(-b - root) / (3.0 * c), (-b + root) / (3.0 * c)]):
                if e > 0.0:
                    stops[found] = e
                    found += 1
    elif b != 0.0 and -a / (2.0 * b) > 0.0:
        stops[found] = -a / (2.0 * b)
    low = 0.0
    for high in stops:
        if not np.isfinite(high):
            high = max(1.0, 2.0 * low)
            while high < 1e12 and 1.0 + high * (a + high * (b + high * c)) > 0.0:
                high *= 2.0
        if not 1.0 + high * (a + high * (b + high * c)) > 0.0:
            for _ in range(100):
                middle = 0.5 * (low + high)
                if 1.0 + middle * (a + middle * (b + middle * c)) > 0.0:
                    low = middle
                else:
                    high = middle
            return np.sqrt(low)
        low = high
        if high >= 1e12:
            break
    return np.inf


@njit(cache=True, nogil=True, error_model="numpy")
def _slack(k1, k2, k3, p, r):  # type: ignore[no-untyped-def]
    s = r * r
    across, along = 1.0 + s * (k1 + s * (k2 + s * k3)), 1.0 + s * (3.0 * k1 + s * (5.0 * k2 + s * 7.0 * k3))
    return min(across, along) - 6.0 * p * r


@njit(cache=True, nogil=True, error_model="numpy")
def disc(k1, k2, k3, p):  # type: ignore[no-untyped-def]
    """Radius up to which min(g, d(r g)/dr) > 6 |p| r, as `plane_distortion.radius_limit`; scanned in the angle."""
    if p == 0.0:
        return radius_limit(k1, k2, k3)
    low = 0.0
    for i in range(1, 2000):
        high = np.tan(0.5 * np.pi * i / 2000)
        if not _slack(k1, k2, k3, p, high) > 0.0:
            for _ in range(60):
                middle = 0.5 * (low + high)
                if _slack(k1, k2, k3, p, middle) > 0.0:
                    low = middle
                else:
                    high = middle
            return low
        low = high
    return np.inf


@njit(cache=True, nogil=True, error_model="numpy")
def radial_inverse(k1, k2, k3, limit, rd):  # type: ignore[no-untyped-def]
    """r in [0, limit) with r g(r^2) = rd, Newton's method within a bracket; just below `limit` when rd is beyond it."""
    low, high = 0.0, 0.9999 * limit
    if not np.isfinite(high):
        high = 2.0 * rd + 1.0
        for _ in range(30):
            if high * (1.0 + high * high * (k1 + high * high * (k2 + high * high * k3))) >= rd:
                break
            high *= 2.0
    r = min(rd, high)
    for _ in range(100):
        s = r * r
        error = r * (1.0 + s * (k1 + s * (k2 + s * k3))) - rd
        if error < 0.0:
            low = r
        else:
            high = r
        trial = r - error / (1.0 + s * (3.0 * k1 + s * (5.0 * k2 + s * 7.0 * k3)))
        if not (trial >= low and trial <= high):
            trial = 0.5 * (low + high)
        if abs(trial - r) <= 1e-14 * (1.0 + r):
            return trial
        r = trial
    return r


@njit(cache=True, nogil=True, error_model="numpy")
def guess_table(k1, k2, k3, limit, largest):  # type: ignore[no-untyped-def]
    """r / rd over rd^2 from 0 to `largest`, (TABLE + 1,)."""
    table = np.empty(TABLE + 1)
    table[0] = 1.0
    for i in range(1, TABLE + 1):
        rd = np.sqrt(largest * i / TABLE)
        table[i] = radial_inverse(k1, k2, k3, limit, rd) / rd
    return table


@njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")
def invert_block(k1, k2, p1, p2, k3, table, per_step, limit, n, xd, yd, x, y, good):  # type: ignore[no-untyped-def]
    """Ideal x, y of distorted xd, yd (each (>= n,)); good: 1 where the root is certain, before the fold.

    All pixels take the same steps, without branches, so that the loop vectorises; they stop when the last step of
    every one squares to less than rounding.
    """
    for i in range(n):
        at = min((xd[i] * xd[i] + yd[i] * yd[i]) * per_step, TABLE - 1e-9)
        j = int(at)
        scale = table[j] + (at - j) * (table[j + 1] - table[j])
        x[i], y[i] = xd[i] * scale, yd[i] * scale
    for _ in range(12):
        moved = 0.0
        for i in range(n):
            a, b = x[i], y[i]
            a2, b2, ab2 = a * a, b * b, 2.0 * a * b
            s = a2 + b2
            g = 1.0 + s * (k1 + s * (k2 + s * k3))
            h = 2.0 * k1 + s * (4.0 * k2 + s * 6.0 * k3)
            ex = a * g + p1 * ab2 + p2 * (s + 2.0 * a2) - xd[i]
            ey = b * g + p1 * (s + 2.0 * b2) + p2 * ab2 - yd[i]
            xx = g + h * a2 + 2.0 * p1 * b + 6.0 * p2 * a
            xy = 0.5 * h * ab2 + 2.0 * p1 * a + 2.0 * p2 * b
            yy = g + h * b2 + 6.0 * p1 * b + 2.0 * p2 * a
            det = xx * yy - xy * xy
            inverse = 1.0 / det
            dx, dy = (yy * ex - xy * ey) * inverse, (xx * ey - xy * ex) * inverse
            step = dx * dx + dy * dy
            x[i], y[i] = a - dx, b - dy
            good[i] = 1.0 if (det > 0.0 and step < 1e-14 and s < limit * limit) else 0.0
            moved += step
        if moved < 1e-14:  # the last step is below 1e-7, the error after it below 1e-14
            break
