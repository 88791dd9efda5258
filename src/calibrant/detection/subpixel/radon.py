"""Sub-pixel corners by a localised Radon transform: where the lightest and darkest lines through it differ most.

At a chessboard's corner a line can run through two light squares and another through two dark ones; beside it each is
cut short. With f(q, a) the mean brightness on a line of half length r through q at angle a,

    R(q) = (max_a f - min_a f)^2,     p = the vertex of the paraboloid fitted to R around its maximum

(A. Duda, U. Frese, Accurate Detection and Localization of Checkerboard Corners for Calibration, BMVC 2018). Lines are
means of many pixels, which is what holds against noise. The places where R is computed follow the corner until it
stays, so that neither the pixels' raster nor the paraboloid's shape pulls it aside. All places share the two angles of
the corner itself: the grey values are even about it, so that R is too at any angles, and choosing anew at every place
would follow the noise. p is then linear in the grey values, and its covariance that of their noise
and of what the raster adds on edges.
"""

from __future__ import annotations

import math

import numpy as np

from calibrant.arrays import Array, Grey
from calibrant.compiled import compiled, compiled_part
from calibrant.detection.subpixel.noise import noise_variance, raster_variance
from calibrant.detection.subpixel.refined import Refined

ANGLES = 36
"""Every 5 degrees: the lightest line may lie anywhere within its squares."""
PLACES = 5
LEAST_SPACING_PX = 0.75
SPACING = 0.15
"""R is computed at 5x5 places, so far apart, over the lines' half length but no less than blur: R falls off over about
that length, and the further apart the places, the less a pixel's noise moves the vertex."""
MOST_STEPS = 12
SMALL_STEP_PX = 2e-3
LEAST_HALF_PX = 3.0
"""Half length of the shortest line: below it blur hides the squares."""
ALIKE = 3
"""A line's angle is judged with those of so many to each side: their means differ by noise alone within a square."""

_X, _Y = (m.ravel().astype(np.float64) for m in np.meshgrid(*2 * [np.arange(PLACES) - PLACES // 2]))
_PARABOLOID = np.ascontiguousarray(np.linalg.pinv(np.column_stack([np.ones_like(_X), _X, _Y, _X**2, _X * _Y, _Y**2])))
"""Its coefficients (6,) from the values at the places (25,)."""
_COS = np.cos(np.pi * np.arange(ANGLES) / ANGLES)
_SIN = np.sin(np.pi * np.arange(ANGLES) / ANGLES)


def refine(grey: Grey, uv: Array, half_px: Array) -> Refined:
    """Corners near uv (n, 2). Args: half_px (n,): half lengths of the lines, within the squares around."""
    fitted = _fit(
        np.ascontiguousarray(grey),
        np.ascontiguousarray(uv, np.float64),
        np.maximum(np.ascontiguousarray(half_px, np.float64), LEAST_HALF_PX),
    )
    return Refined(
        fitted[:, :2], fitted[:, 2], fitted[:, 4], fitted[:, 3], np.ones(len(fitted)), np.isfinite(fitted[:, 2])
    )


@compiled_part("float64(uint8[:, ::1], float64, float64)")
def _bilinear(grey, u, v):  # type: ignore[no-untyped-def]
    i, j = int(u), int(v)
    a, b = u - i, v - j
    top = grey[j, i] * (1.0 - a) + grey[j, i + 1] * a
    low = grey[j + 1, i] * (1.0 - a) + grey[j + 1, i + 1] * a
    return top * (1.0 - b) + low * b


@compiled_part("void(float64[:, :, ::1], float64, float64, float64, float64)")
def _spread_bilinear(share, u, v, along_x, along_y):  # type: ignore[no-untyped-def]
    """Adds a sample's share (along_x, along_y) to the four pixels around it."""
    i, j = int(u), int(v)
    a, b = u - i, v - j
    for dj in range(2):
        for di in range(2):
            weight = (a if di else 1.0 - a) * (b if dj else 1.0 - b)
            share[j + dj, i + di, 0] += weight * along_x
            share[j + dj, i + di, 1] += weight * along_y


@compiled_part("float64(uint8[:, ::1], float64, float64, int64, int64)")
def _line(grey, x, y, half, angle):  # type: ignore[no-untyped-def]
    """Mean brightness of the line through a point."""
    total = 0.0
    for s in range(-half, half + 1):
        total += _bilinear(grey, x + s * _COS[angle], y + s * _SIN[angle])
    return total / (2 * half + 1)


@compiled_part("UniTuple(int64, 2)(uint8[:, ::1], float64, float64, int64)")
def _angles(grey, x, y, half):  # type: ignore[no-untyped-def]
    """Angles of the lightest and the darkest line through a point."""
    f = np.empty(ANGLES)
    for k in range(ANGLES):
        f[k] = _line(grey, x, y, half, k)
    lightest, darkest, high, low = 0, 0, -1.0, 1e9
    for k in range(ANGLES):
        mean = 0.0
        for d in range(-ALIKE, ALIKE + 1):
            mean += f[(k + d) % ANGLES]
        if mean > high:
            lightest, high = k, mean
        if mean < low:
            darkest, low = k, mean
    return lightest, darkest


@compiled_part("boolean(uint8[:, ::1], float64, float64, int64, float64, int64, int64, float64[::1])")
def _vertex(grey, x, y, half, spacing, lightest, darkest, row):  # type: ignore[no-untyped-def]
    """Fills row with the step to the vertex of R's paraboloid around (x, y) and its curvatures; False without one."""
    c = np.zeros(6)
    for n in range(len(_X)):
        px, py = x + spacing * _X[n], y + spacing * _Y[n]
        difference = _line(grey, px, py, half, lightest) - _line(grey, px, py, half, darkest)
        for k in range(6):
            c[k] += _PARABOLOID[k, n] * difference**2
    # From steps of the places to pixels.
    for k in range(1, 6):
        c[k] /= spacing if k < 3 else spacing**2
    det = 4.0 * c[3] * c[5] - c[4] ** 2
    if c[3] >= 0.0 or det <= 0.0:
        return False
    row[0] = (c[4] * c[2] - 2.0 * c[5] * c[1]) / det
    row[1] = (c[4] * c[1] - 2.0 * c[3] * c[2]) / det
    row[2], row[3], row[4] = 2.0 * c[3], c[4], 2.0 * c[5]
    return True


@compiled_part("float64(uint8[:, ::1], float64, float64, int64, float64, int64, int64, float64[::1], float64)")
def _spread(grey, x, y, half, spacing, lightest, darkest, row, variance):  # type: ignore[no-untyped-def]
    """Variance of the vertex per axis, px^2, for noise of a variance."""
    reach = half + int(0.5 * PLACES * spacing) + 3
    u0, v0 = int(x) - reach, int(y) - reach
    share = np.zeros((2 * reach + 2, 2 * reach + 2, 2))
    det = row[2] * row[4] - row[3] ** 2
    for n in range(len(_X)):
        px, py = x + spacing * _X[n], y + spacing * _Y[n]
        difference = _line(grey, px, py, half, lightest) - _line(grey, px, py, half, darkest)
        # dR = 2 (light - dark) (d light - d dark), and the vertex is -H^-1 (c1, c2).
        gain = 2.0 * difference / (2 * half + 1)
        bx, by = _PARABOLOID[1, n] / spacing, _PARABOLOID[2, n] / spacing
        gx = -(row[4] * bx - row[3] * by) / det * gain
        gy = -(row[2] * by - row[3] * bx) / det * gain
        for sign, k in ((1.0, lightest), (-1.0, darkest)):
            for s in range(-half, half + 1):
                _spread_bilinear(share, px + s * _COS[k] - u0, py + s * _SIN[k] - v0, sign * gx, sign * gy)
    # The corner is where the step to the vertex vanishes: noise that moves the vertex by d moves it by K^-1 d, with -K
    # the step's derivative, as R is no paraboloid.
    K, beside = np.empty((2, 2)), np.zeros(5)
    for axis in range(2):
        K[0, axis], K[1, axis] = 0.0, 0.0
        for side in (-0.5, 0.5):
            u = x + (side * spacing if axis == 0 else 0.0)
            v = y + (side * spacing if axis == 1 else 0.0)
            if not _vertex(grey, u, v, half, spacing, lightest, darkest, beside):
                return np.inf
            K[0, axis] -= 2.0 * side * beside[0] / spacing
            K[1, axis] -= 2.0 * side * beside[1] / spacing
    det = K[0, 0] * K[1, 1] - K[0, 1] * K[1, 0]
    if det <= 0.0:
        return np.inf
    total = 0.0
    for j in range(share.shape[0]):
        for i in range(share.shape[1]):
            a, b = share[j, i, 0], share[j, i, 1]
            of_pixel = variance + raster_variance(grey, u0 + i, v0 + j)
            total += of_pixel * ((K[1, 1] * a - K[0, 1] * b) ** 2 + (K[0, 0] * b - K[1, 0] * a) ** 2)
    return 0.5 * total / det**2


@compiled("float64[:, ::1](uint8[:, ::1], float64[:, ::1], float64[::1])")
def _fit(grey, uv, half_px):  # type: ignore[no-untyped-def]
    """Rows (n, 5): x, y, sigma per axis (infinite where it failed), noise and half contrast, grey levels."""
    h, w = grey.shape
    out = np.empty((len(uv), 5))
    row = np.zeros(5)
    for i in range(len(uv)):
        x, y = uv[i, 0], uv[i, 1]
        half = int(half_px[i])
        spacing = max(LEAST_SPACING_PX, SPACING * half)
        out[i, 0], out[i, 1], out[i, 2], out[i, 3], out[i, 4] = x, y, np.inf, np.inf, 0.0
        reach, moved, lightest, darkest = half + 0.5 * PLACES * spacing + 4.0, np.inf, 0, 0
        for _ in range(MOST_STEPS):
            # Lines must stay in the picture, those of the next step as well.
            if x < reach or y < reach or x > w - 2 - reach or y > h - 2 - reach:
                moved = np.inf
                break
            lightest, darkest = _angles(grey, x, y, half)
            if not _vertex(grey, x, y, half, spacing, lightest, darkest, row):
                moved = np.inf
                break
            dx, dy = row[0], row[1]
            moved = math.hypot(dx, dy)
            # Beyond the places around, the paraboloid is a guess.
            shrink = min(1.0, spacing / max(moved, 1e-9))
            x, y = x + shrink * dx, y + shrink * dy
            if moved < SMALL_STEP_PX or math.hypot(x - uv[i, 0], y - uv[i, 1]) > half:
                break
        if moved > 0.05 or math.hypot(x - uv[i, 0], y - uv[i, 1]) > half:
            continue
        variance = noise_variance(grey, int(x + 0.5), int(y + 0.5), half)
        difference = _line(grey, x, y, half, lightest) - _line(grey, x, y, half, darkest)
        out[i, 0], out[i, 1] = x, y
        out[i, 3], out[i, 4] = math.sqrt(variance), 0.5 * difference
        out[i, 2] = math.sqrt(_spread(grey, x, y, half, spacing, lightest, darkest, row, variance))
    return out
