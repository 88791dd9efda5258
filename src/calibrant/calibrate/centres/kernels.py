"""Compiled centres of transforms and distances from them; `geometry.so3` and `se3` hold the readable forms, its test.

A hand-eye asks some sixty times how well twenty loops agree: NumPy's calls cost ten times the arithmetic.
"""

from __future__ import annotations

import numpy as np
from numba import types

from calibrant.compiled import compiled, compiled_part

_transforms = types.Array(types.float64, 3, "C", readonly=True)
_constant = types.Array(types.float64, 2, "C", readonly=True)
_transform = types.float64[:, ::1]
_numbers = types.float64[::1]


@compiled_part(types.UniTuple(types.float64, 3)(_transforms, types.intp, types.intp, _constant))
def _row(T, i, r, centre):  # type: ignore[no-untyped-def]
    """Row r of R_i R_centre^T."""
    a, b, c = T[i, r, 0], T[i, r, 1], T[i, r, 2]
    return (
        a * centre[0, 0] + b * centre[0, 1] + c * centre[0, 2],
        a * centre[1, 0] + b * centre[1, 1] + c * centre[1, 2],
        a * centre[2, 0] + b * centre[2, 1] + c * centre[2, 2],
    )


@compiled_part(types.UniTuple(types.float64, 3)(_transforms, types.intp, _constant))
def _rotation_between(T, i, centre):  # type: ignore[no-untyped-def]
    """log(R_i R_centre^T): the odd part up to 120 degrees, beyond through the quaternion, as `so3.log`."""
    xx, xy, xz = _row(T, i, 0, centre)
    yx, yy, yz = _row(T, i, 1, centre)
    zx, zy, zz = _row(T, i, 2, centre)
    trace = xx + yy + zz
    cosine = 0.5 * (trace - 1.0)
    x, y, z = zy - yz, xz - zx, yx - xy
    if cosine > -0.5:
        sine = 0.5 * np.sqrt(x * x + y * y + z * z)
        scale = 0.5 if sine < 1e-10 else 0.5 * np.arctan2(sine, cosine) / sine
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


@compiled_part(types.void(_transform, types.float64, types.float64, types.float64))
def _turn(centre, x, y, z):  # type: ignore[no-untyped-def]
    """R <- exp((x, y, z)) R, Rodrigues' formula as in `so3.exp`."""
    s = x * x + y * y + z * z
    if s < 1e-8:
        a, b = 1.0 - s / 6.0, 0.5 - s / 24.0
    else:
        angle = np.sqrt(s)
        half = np.sin(0.5 * angle)
        a, b = np.sin(angle) / angle, 2.0 * half * half / s
    for c in range(3):
        u, v, w = centre[0, c], centre[1, c], centre[2, c]
        cx, cy, cz = y * w - z * v, z * u - x * w, x * v - y * u
        centre[0, c] = u + a * cx + b * (y * cz - z * cy)
        centre[1, c] = v + a * cy + b * (z * cx - x * cz)
        centre[2, c] = w + a * cz + b * (x * cy - y * cx)


@compiled(types.void(_transforms, _transform))
def mean_rotation(T, centre):  # type: ignore[no-untyped-def]
    """The rotation of centre, a start, becomes the Karcher mean of those of T, as `so3.mean`; (3, 3) or (4, 4) both."""
    n = T.shape[0]
    for _ in range(50):
        x, y, z = 0.0, 0.0, 0.0
        for i in range(n):
            u, v, w = _rotation_between(T, i, centre)
            x, y, z = x + u, y + v, z + w
        x, y, z = x / n, y / n, z / n
        _turn(centre, x, y, z)
        if np.sqrt(x * x + y * y + z * z) < 1e-14:
            break


@compiled_part(types.boolean(_numbers, types.float64))
def _at_most_median(values, bound):  # type: ignore[no-untyped-def]
    """Is `bound` at most the median? Without sorting: of an even number the two about the middle may lie around it."""
    n = values.shape[0]
    above, below_it, above_it = 0, 0.0, np.inf
    for i in range(n):
        if values[i] >= bound:
            above += 1
            above_it = min(above_it, values[i])
        else:
            below_it = max(below_it, values[i])
    if n % 2 == 0 and above == n // 2:
        return 0.5 * (below_it + above_it) >= bound
    return above > n // 2


@compiled(types.void(_transforms, _transform, _numbers, _numbers))
def median_transform(T, centre, angles, distances):  # type: ignore[no-untyped-def]
    """centre (4, 4), a start, moves to where the sums of angles and of distances to T (n, 4, 4) are least.

    Weiszfeld's iteration: the mean of vectors weighted by 1 / length, lengths below rounding taken as rounding. It
    settles with a thousandth of the typical length: a median of n lengths is uncertain by far more.
    angles, distances (n,): room to work in.
    """
    for _ in range(30):  # linear convergence
        x, y, z, of_turns = 0.0, 0.0, 0.0, 0.0
        a, b, c, of_moves = 0.0, 0.0, 0.0, 0.0
        for i in range(T.shape[0]):
            u, v, w = _rotation_between(T, i, centre)
            angles[i] = np.sqrt(u * u + v * v + w * w)
            weight = 1.0 / max(angles[i], 1e-12)
            x, y, z, of_turns = x + weight * u, y + weight * v, z + weight * w, of_turns + weight
            u, v, w = T[i, 0, 3] - centre[0, 3], T[i, 1, 3] - centre[1, 3], T[i, 2, 3] - centre[2, 3]
            distances[i] = np.sqrt(u * u + v * v + w * w)
            weight = 1.0 / max(distances[i], 1e-12)
            a, b, c, of_moves = a + weight * u, b + weight * v, c + weight * w, of_moves + weight
        x, y, z = x / of_turns, y / of_turns, z / of_turns
        a, b, c = a / of_moves, b / of_moves, c / of_moves
        _turn(centre, x, y, z)
        centre[0, 3] += a
        centre[1, 3] += b
        centre[2, 3] += c
        turned = _at_most_median(angles, 1e3 * np.sqrt(x * x + y * y + z * z))
        if turned and _at_most_median(distances, 1e3 * np.sqrt(a * a + b * b + c * c)):
            break


@compiled(types.void(_transforms, _constant, _numbers, _numbers))
def deviations(T, centre, mm, deg):  # type: ignore[no-untyped-def]
    """Millimetres and degrees (n,) from centre (4, 4) to T (n, 4, 4), as `se3.deviation`."""
    for i in range(T.shape[0]):
        x, y, z = _rotation_between(T, i, centre)
        deg[i] = np.sqrt(x * x + y * y + z * z) * 180.0 / np.pi
        x, y, z = T[i, 0, 3] - centre[0, 3], T[i, 1, 3] - centre[1, 3], T[i, 2, 3] - centre[2, 3]
        mm[i] = 1e3 * np.sqrt(x * x + y * y + z * z)
