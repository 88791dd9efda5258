"""Sub-pixel corners by W. Foerstner's operator: the point nearest to the lines of all edges around it.

Through every pixel q runs an edge's line, orthogonal to its gradient g. The corner p minimises

    sum w (g . (p - q))^2,     N p = sum w g g^T q,     N = sum w g g^T,     w = (1 - |q - p|^2 / r^2)^2

(W. Foerstner, E. Guelch, A fast operator for detection and precise location of distinct points, 1987). The weights
follow the corner until it stays. Pixels of the zero zone around the corner say nothing of direction and may be left
out. Gradients are central differences, so a pixel's noise enters the equations of its neighbours; the covariance of p
follows by propagating it exactly, c_k being what pixel k adds to the right-hand side per grey level:

    Cov p = J^-1 (sum s_k^2 c_k c_k^T) J^-T

with s_k^2 the noise around the corner and what the raster adds on edges, and J = N but for what the weights change as
they follow. What is left of g . (p - q) would not do for s: blur makes it large near the corner, evenly to all sides,
which does not move it.
"""

from __future__ import annotations

import math

import numpy as np

from calibrant.arrays import Array, Grey
from calibrant.compiled import compiled, compiled_part
from calibrant.detection.subpixel.noise import noise_variance, raster_variance
from calibrant.detection.subpixel.refined import Refined, Zone, zone_of

MOST_STEPS = 30
FULL_STEPS = 15
"""A corner that is nearer to where it belongs with every step is there long before."""
SMALL_STEP_PX = 1e-3
"""A tenth of the best standard deviation there is."""
LEAST_HALF_PX = 2.0
"""Half width of the smallest window: with less there are no two edges in it."""


def refine(grey: Grey, uv: Array, half_px: Array, *, zero_zone_px: Zone = 0.0) -> Refined:
    """Corners near uv (n, 2). Args: half_px (n,): half widths of the windows; zero_zone_px: half
    width of the square around the corner that is left out, 0 for none, or its half widths along x and y.
    """
    fitted = _fit(
        np.ascontiguousarray(grey),
        np.ascontiguousarray(uv, np.float64),
        np.maximum(np.ascontiguousarray(half_px, np.float64), LEAST_HALF_PX),
        zone_of(zero_zone_px),
    )
    return Refined(
        fitted[:, :2], fitted[:, 2], fitted[:, 4], fitted[:, 3], np.ones(len(fitted)), np.isfinite(fitted[:, 2])
    )


@compiled_part("float64(float64, float64, float64[::1])")
def _beyond(dx, dy, zero):  # type: ignore[no-untyped-def]
    """Share of a pixel that lies beyond the zero zone, 0 to 1: at a hard edge corners jump with the raster."""
    if zero[0] <= 0.0 and zero[1] <= 0.0:
        return 1.0
    return min(1.0, max(0.0, abs(dx) - zero[0] + 0.5, abs(dy) - zero[1] + 0.5))


@compiled_part("void(uint8[:, ::1], float64, float64, float64, float64[::1], float64[::1])")
def _equations(grey, x, y, half, zero, sums):  # type: ignore[no-untyped-def]
    """Fills sums (6,): N_xx, N_xy, N_yy, N (p - start) as two, and the number of pixels."""
    h, w = grey.shape
    sums[:] = 0.0
    for v in range(max(int(y - half), 1), min(int(y + half) + 2, h - 1)):
        for u in range(max(int(x - half), 1), min(int(x + half) + 2, w - 1)):
            dx, dy = u - x, v - y
            r2 = dx * dx + dy * dy
            beyond = _beyond(dx, dy, zero)
            if r2 > half * half or beyond <= 0.0:
                continue
            weight = beyond * (1.0 - r2 / (half * half)) ** 2
            gx = 0.5 * (float(grey[v, u + 1]) - float(grey[v, u - 1]))
            gy = 0.5 * (float(grey[v + 1, u]) - float(grey[v - 1, u]))
            e = gx * dx + gy * dy
            sums[0] += weight * gx * gx
            sums[1] += weight * gx * gy
            sums[2] += weight * gy * gy
            sums[3] += weight * gx * e
            sums[4] += weight * gy * e
            sums[5] += 1.0


@compiled_part("float64(uint8[:, ::1], float64, float64, float64, float64[::1], float64)")
def _spread(grey, x, y, half, zero, variance):  # type: ignore[no-untyped-def]
    """Variance of the corner per axis, px^2, for noise of a variance."""
    h, w = grey.shape
    u0, v0 = max(int(x - half), 1) - 1, max(int(y - half), 1) - 1
    u1, v1 = min(int(x + half) + 2, w - 1) + 1, min(int(y + half) + 2, h - 1) + 1
    share = np.zeros((v1 - v0, u1 - u0, 2))
    for v in range(v0 + 1, v1 - 1):
        for u in range(u0 + 1, u1 - 1):
            dx, dy = u - x, v - y
            r2 = dx * dx + dy * dy
            beyond = _beyond(dx, dy, zero)
            if r2 > half * half or beyond <= 0.0:
                continue
            weight = beyond * (1.0 - r2 / (half * half)) ** 2
            gx = 0.5 * (float(grey[v, u + 1]) - float(grey[v, u - 1]))
            gy = 0.5 * (float(grey[v + 1, u]) - float(grey[v - 1, u]))
            j, i = v - v0, u - u0
            # d(g (g . r)) = dg (g . r) + g (dg . r), with dg half the difference of the neighbours' noise.
            half_weight, e = 0.5 * weight, gx * dx + gy * dy
            for axis in range(2):
                g = gx if axis == 0 else gy
                across = half_weight * (g * dx + (e if axis == 0 else 0.0))
                down = half_weight * (g * dy + (e if axis == 1 else 0.0))
                share[j, i + 1, axis] += across
                share[j, i - 1, axis] -= across
                share[j + 1, i, axis] += down
                share[j - 1, i, axis] -= down
    xx, xy, yy = 0.0, 0.0, 0.0
    for j in range(v1 - v0):
        for i in range(u1 - u0):
            of_pixel = variance + raster_variance(grey, u0 + i, v0 + j)
            xx += of_pixel * share[j, i, 0] ** 2
            xy += of_pixel * share[j, i, 0] * share[j, i, 1]
            yy += of_pixel * share[j, i, 1] ** 2
    # The corner is where the right-hand side vanishes; noise that adds d to it moves the corner by J^-1 d, with -J the
    # derivative of the right-hand side: N, and what moving the weights changes.
    J, beside = np.empty((2, 2)), np.empty(6)
    for axis in range(2):
        J[0, axis], J[1, axis] = 0.0, 0.0
        for side in (-0.5, 0.5):
            _equations(grey, x + (side if axis == 0 else 0.0), y + (side if axis == 1 else 0.0), half, zero, beside)
            J[0, axis] -= 2.0 * side * beside[3]
            J[1, axis] -= 2.0 * side * beside[4]
    det = J[0, 0] * J[1, 1] - J[0, 1] * J[1, 0]
    if det <= 0.0:
        return np.inf
    var_x = (J[1, 1] ** 2 * xx - 2.0 * J[1, 1] * J[0, 1] * xy + J[0, 1] ** 2 * yy) / det**2
    var_y = (J[1, 0] ** 2 * xx - 2.0 * J[1, 0] * J[0, 0] * xy + J[0, 0] ** 2 * yy) / det**2
    return 0.5 * (var_x + var_y)


@compiled("float64[:, ::1](uint8[:, ::1], float64[:, ::1], float64[::1], float64[::1])")
def _fit(grey, uv, half, zero):  # type: ignore[no-untyped-def]
    """Rows (n, 5): x, y, sigma per axis (infinite where it failed), noise and half contrast, grey levels."""
    h, w = grey.shape
    out = np.empty((len(uv), 5))
    sums = np.empty(6)
    for i in range(len(uv)):
        x, y = uv[i, 0], uv[i, 1]
        out[i, 2], out[i, 3], out[i, 4] = np.inf, np.inf, 0.0
        moved, whole = np.inf, 0.0
        for k in range(MOST_STEPS):
            _equations(grey, x, y, half[i], zero, sums)
            det = sums[0] * sums[2] - sums[1] ** 2
            # Two edges: the smaller eigenvalue of N is no small part of the larger (det over squared trace).
            if sums[5] < 8 or det < 1e-3 * (sums[0] + sums[2]) ** 2:
                break
            dx = (sums[2] * sums[3] - sums[1] * sums[4]) / det
            dy = (sums[0] * sums[4] - sums[1] * sums[3]) / det
            # Pixels that enter and leave the zero zone can make it swing between two places: then it ends between.
            share = 1.0 if k < FULL_STEPS else 1.0 / (k - FULL_STEPS + 2)
            x, y = x + share * dx, y + share * dy
            whole = math.hypot(dx, dy)
            moved = share * whole
            if moved < SMALL_STEP_PX or not math.hypot(x - uv[i, 0], y - uv[i, 1]) < half[i]:
                break
        out[i, 0], out[i, 1] = x, y
        if moved > 0.05 or not math.hypot(x - uv[i, 0], y - uv[i, 1]) < half[i]:
            continue
        _equations(grey, x, y, half[i], zero, sums)
        # Second differences reach one pixel further.
        u, v = int(x + 0.5), int(y + 0.5)
        reach = min(int(half[i]) + 2, u - 1, v - 1, w - 2 - u, h - 2 - v)
        if reach < 2:
            continue
        variance = noise_variance(grey, u, v, reach)
        low, high = 255.0, 0.0
        for row in range(v - reach, v + reach + 1):
            for column in range(u - reach, u + reach + 1):
                low, high = min(low, float(grey[row, column])), max(high, float(grey[row, column]))
        spread = _spread(grey, x, y, half[i], zero, variance)
        out[i, 3], out[i, 4] = math.sqrt(variance), 0.5 * (high - low)
        if spread > 0.0:
            out[i, 2] = math.sqrt(spread + (0.5 * whole) ** 2)
    return out
