"""Compiled centres of transforms and distances from them; `geometry.so3` and `se3` hold the readable forms, its test.

A hand-eye asks some sixty times how well twenty loops agree: NumPy's calls cost ten times the arithmetic. Every kernel
takes two milliseconds of a process to load, so that one does all of it.
"""

from __future__ import annotations

import numpy as np
from numba import types

from calibrant.compiled import compiled, compiled_part

_transforms = types.Array(types.float64, 3, "C", readonly=True)
_f2 = types.float64[:, ::1]


@compiled_part(types.UniTuple(types.float64, 3)(_transforms, types.intp, _f2))
def _rotation_between(T, i, Z):  # type: ignore[no-untyped-def]
    """log(R_i R_Z^T): the odd part up to 120 degrees, beyond through the quaternion, as `so3.log`."""
    xx = T[i, 0, 0] * Z[0, 0] + T[i, 0, 1] * Z[0, 1] + T[i, 0, 2] * Z[0, 2]
    xy = T[i, 0, 0] * Z[1, 0] + T[i, 0, 1] * Z[1, 1] + T[i, 0, 2] * Z[1, 2]
    xz = T[i, 0, 0] * Z[2, 0] + T[i, 0, 1] * Z[2, 1] + T[i, 0, 2] * Z[2, 2]
    yx = T[i, 1, 0] * Z[0, 0] + T[i, 1, 1] * Z[0, 1] + T[i, 1, 2] * Z[0, 2]
    yy = T[i, 1, 0] * Z[1, 0] + T[i, 1, 1] * Z[1, 1] + T[i, 1, 2] * Z[1, 2]
    yz = T[i, 1, 0] * Z[2, 0] + T[i, 1, 1] * Z[2, 1] + T[i, 1, 2] * Z[2, 2]
    zx = T[i, 2, 0] * Z[0, 0] + T[i, 2, 1] * Z[0, 1] + T[i, 2, 2] * Z[0, 2]
    zy = T[i, 2, 0] * Z[1, 0] + T[i, 2, 1] * Z[1, 1] + T[i, 2, 2] * Z[1, 2]
    zz = T[i, 2, 0] * Z[2, 0] + T[i, 2, 1] * Z[2, 1] + T[i, 2, 2] * Z[2, 2]
    trace = xx + yy + zz
    x, y, z = zy - yz, xz - zx, yx - xy
    if trace > 0.0:
        sine = 0.5 * np.sqrt(x * x + y * y + z * z)
        scale = 0.5 if sine < 1e-10 else 0.5 * np.arctan2(sine, 0.5 * (trace - 1.0)) / sine
        return scale * x, scale * y, scale * z
    # Shepperd: with a trace below 0 the largest of the four is one of the diagonal.
    if xx >= yy and xx >= zz:
        w, x, y, z = x, 1.0 + 2.0 * xx - trace, xy + yx, xz + zx
    elif yy >= zz:
        w, x, y, z = y, xy + yx, 1.0 + 2.0 * yy - trace, yz + zy
    else:
        w, x, y, z = z, xz + zx, yz + zy, 1.0 + 2.0 * zz - trace
    sine = np.sqrt(x * x + y * y + z * z)
    scale = (2.0 if w >= 0.0 else -2.0) * np.arctan2(sine, abs(w)) / sine
    return scale * x, scale * y, scale * z


@compiled(types.void(_transforms, _f2, types.boolean, _f2, _f2))
def centre(T, Z, median, length, sums):  # type: ignore[no-untyped-def]
    """Z (4, 4), a start, becomes the mean of T (n, 4, 4), or where the sum of distances to them is least.

    length (2, n): angles, radians, and distances from there; sums (2, 4): room to work in. The mean is that of rotation
    vectors (Karcher) and of places; the median weights them by 1 / length, lengths below rounding taken as rounding
    (Weiszfeld), and settles with a thousandth of the typical length: a median of n lengths is uncertain by far more.
    """
    n, settled = T.shape[0], False
    for step in range(31 if median else 51):
        for c in range(2):
            for k in range(4):
                sums[c, k] = 0.0
        for i in range(n):
            x, y, z = _rotation_between(T, i, Z)
            for c in range(2):
                if c == 1:
                    x, y, z = T[i, 0, 3] - Z[0, 3], T[i, 1, 3] - Z[1, 3], T[i, 2, 3] - Z[2, 3]
                length[c, i] = np.sqrt(x * x + y * y + z * z)
                weight = 1.0 / max(length[c, i], 1e-12) if median else 1.0
                sums[c, 0] += weight * x
                sums[c, 1] += weight * y
                sums[c, 2] += weight * z
                sums[c, 3] += weight
        if settled or step == (30 if median else 50):
            break
        settled = True
        for c in range(2):
            x, y, z = sums[c, 0] / sums[c, 3], sums[c, 1] / sums[c, 3], sums[c, 2] / sums[c, 3]
            s = x * x + y * y + z * z
            if median:
                bound, shorter, below, above = 1e3 * np.sqrt(s), 0, 0.0, np.inf
                for i in range(n):
                    if length[c, i] < bound:
                        shorter, below = shorter + 1, max(below, length[c, i])
                    else:
                        above = min(above, length[c, i])
                # The median length, without sorting: of an even number it is between the two about the middle.
                settled = settled and (2 * shorter < n or (2 * shorter == n and below + above >= 2.0 * bound))
            elif c == 0:
                settled = s < 1e-28
            if c == 1:
                Z[0, 3], Z[1, 3], Z[2, 3] = Z[0, 3] + x, Z[1, 3] + y, Z[2, 3] + z
                continue
            angle = max(np.sqrt(s), 1e-12)
            a, b = np.sin(angle) / angle, 2.0 * np.sin(0.5 * angle) * np.sin(0.5 * angle) / (angle * angle)
            for k in range(3):  # Rodrigues' formula
                u, v, w = Z[0, k], Z[1, k], Z[2, k]
                cx, cy, cz = y * w - z * v, z * u - x * w, x * v - y * u
                Z[0, k] = u + a * cx + b * (y * cz - z * cy)
                Z[1, k] = v + a * cy + b * (z * cx - x * cz)
                Z[2, k] = w + a * cz + b * (x * cy - y * cx)
