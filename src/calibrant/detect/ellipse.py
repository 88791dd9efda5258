"""Sub-pixel ellipses: a blurred elliptical edge fitted to the grey values, with the standard deviation of its centre.

Around a spot at p the brightness is modelled by

    I(q) = m + g . (q - p) + c E(d(q) / s),     E(t) = erf(t / sqrt 2),     d = (rho - 1) / |grad rho|,
    rho = |A (q - p)|,  A = [[a, 0], [b, c2]]

with d the distance from the outline to first order and s the blur. The ten parameters (x, y, a, b, c2, log s, m, c, g)
are fitted by Levenberg-Marquardt over a band along the outline. The model is even about p, as is a spot blurred evenly,
so that an outline of the wrong shape does not pull the centre aside. The covariance of (x, y) is that of least squares
with sigma from the spot's own residuals.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from calibrant.detect.spots import Spots

Array = NDArray[np.float64]
Grey = NDArray[np.uint8]

PARAMETERS = 10
MOST_STEPS = 15
SMALL_STEP_PX = 1e-3
BLURS = 3.0
"""Half width of the band over the blur: beyond it an edge is flat."""
BAND_PX = 4.0
LEAST_LOG_BLUR, MOST_LOG_BLUR = math.log(0.25), math.log(20.0)
"""A pixel's own width blurs by 0.29 px; an edge of 20 px is none."""


@dataclass(frozen=True, eq=False)
class Ellipses:
    """uv (n, 2) px: centres; sigma_px (n,) per axis, infinite where the fit failed; shape (n, 2, 2) px^2 as in `Spots`;
    contrast (n,): half the difference of paper and ink, positive for dark spots; noise (n,), both grey levels;
    blur_px (n,)."""

    uv: Array
    sigma_px: Array
    shape: Array
    contrast: Array
    noise: Array
    blur_px: Array


def refine_spots(grey: Grey, spots: Spots, *, room: Array, blur_px: float = 1.0) -> Ellipses:
    """Ellipses at rough ones. Args: room (n,): how far the window may reach, in half axes (1: the outline itself)."""
    parameters, sigma = _fit(
        np.ascontiguousarray(grey), spots.uv, np.ascontiguousarray(_roots(spots.shape)), room, float(blur_px), BAND_PX
    )
    blur = np.exp(parameters[:, 5])
    ok = np.isfinite(sigma[:, 0])
    typical = float(np.median(blur[ok])) if ok.any() else blur_px
    if BLURS * typical > 1.2 * BAND_PX:
        parameters, sigma = _fit(
            np.ascontiguousarray(grey), spots.uv, np.ascontiguousarray(_roots(spots.shape)), room, typical,
            BLURS * typical,
        )  # fmt: skip
    A = np.zeros((len(parameters), 2, 2))
    A[:, 0, 0], A[:, 1, 0], A[:, 1, 1] = parameters[:, 2], parameters[:, 3], parameters[:, 4]
    shape = np.asarray(np.linalg.inv(np.swapaxes(A, 1, 2) @ A + 1e-12 * np.eye(2)), np.float64)
    return Ellipses(parameters[:, :2], sigma[:, 0], shape, parameters[:, 7], sigma[:, 1], np.exp(parameters[:, 5]))


def _roots(shape: Array) -> Array:
    """(a, b, c2), (n, 3), of A^T A = shape^-1 with A = [[a, 0], [b, c2]]."""
    P = np.linalg.inv(shape)
    c2 = np.sqrt(P[:, 1, 1])
    b = P[:, 0, 1] / c2
    return np.stack([np.sqrt(np.maximum(P[:, 0, 0] - b**2, 1e-12)), b, c2], axis=1)


@njit(
    "float64(uint8[:, ::1], float64[::1], int64[:, ::1], int64, float64[:, ::1], float64[::1])",
    cache=True,
    nogil=True,
    error_model="numpy",
    fastmath={"contract", "reassoc", "arcp", "nsz"},
)
def _normal_equations(grey, p, pixels, count, JtJ, Jtr):  # type: ignore[no-untyped-def]
    """Fills J^T J (10, 10) and J^T r (10,) over pixels (count, 2); returns the sum of squared residuals."""
    a, b, c2, m, c, gx, gy = p[2], p[3], p[4], p[6], p[7], p[8], p[9]
    blur = math.exp(p[5])
    slope = math.sqrt(2.0 / math.pi) / blur
    JtJ[:] = 0.0
    Jtr[:] = 0.0
    J = np.empty(PARAMETERS)
    total = 0.0
    for k in range(count):
        u, v = pixels[k, 0], pixels[k, 1]
        dx, dy = u - p[0], v - p[1]
        y1, y2 = a * dx, b * dx + c2 * dy
        rho = max(math.sqrt(y1 * y1 + y2 * y2), 1e-6)
        nx, ny = (a * y1 + b * y2) / rho, c2 * y2 / rho
        steep = max(math.sqrt(nx * nx + ny * ny), 1e-9)
        t = (rho - 1.0) / (steep * blur)
        e = math.erf(t * 0.7071067811865476)
        residual = grey[v, u] - (m + gx * dx + gy * dy + c * e)
        total += residual * residual
        w = c * slope * math.exp(-0.5 * t * t) if abs(t) < 6.0 else 0.0
        J[0] = -w * nx / steep - gx
        J[1] = -w * ny / steep - gy
        J[2] = w * y1 * dx / (rho * steep)
        J[3] = w * y2 * dx / (rho * steep)
        J[4] = w * y2 * dy / (rho * steep)
        J[5] = -w * t * blur
        J[6] = 1.0
        J[7] = e
        J[8] = dx
        J[9] = dy
        for i in range(PARAMETERS):
            Jtr[i] += J[i] * residual
            for j in range(i + 1):
                JtJ[i, j] += J[i] * J[j]
    for i in range(PARAMETERS):
        for j in range(i):
            JtJ[j, i] = JtJ[i, j]
    return total


@njit("int64(int64, int64, float64[::1], float64, float64, int64[:, ::1])", cache=True, nogil=True)
def _band(h, w, p, band, room, pixels):  # type: ignore[no-untyped-def]
    """Fills the pixels (count, 2) within `band` px of the outline and within `room` half axes; returns their count."""
    a, b, c2 = p[2], p[3], p[4]
    # Half extents of the ellipse along x and y: roots of the diagonal of (A^T A)^-1.
    det = abs(a * c2)
    reach_x = math.sqrt(b * b + c2 * c2) / det + band + 1.0
    reach_y = abs(a) / det + band + 1.0
    count = 0
    for v in range(max(int(p[1] - reach_y), 0), min(int(p[1] + reach_y) + 2, h)):
        for u in range(max(int(p[0] - reach_x), 0), min(int(p[0] + reach_x) + 2, w)):
            dx, dy = u - p[0], v - p[1]
            y1, y2 = a * dx, b * dx + c2 * dy
            rho = math.sqrt(y1 * y1 + y2 * y2)
            nx, ny = a * y1 + b * y2, c2 * y2
            steep = math.sqrt(nx * nx + ny * ny) / max(rho, 1e-9)
            if rho <= room and abs(rho - 1.0) <= band * max(steep, 1e-9) and count < len(pixels):
                pixels[count, 0] = u
                pixels[count, 1] = v
                count += 1
    return count


@njit(
    "float64(uint8[:, ::1], int64[:, ::1], int64, float64[::1], float64[:, ::1])",
    cache=True,
    nogil=True,
    error_model="numpy",
)
def _descend(grey, pixels, count, p, JtJ):  # type: ignore[no-untyped-def]
    """Levenberg-Marquardt on p, in place; fills J^T J there; returns the sum of squared residuals."""
    Jtr, trial_JtJ, trial_Jtr = np.empty(PARAMETERS), np.empty((PARAMETERS, PARAMETERS)), np.empty(PARAMETERS)
    cost = _normal_equations(grey, p, pixels, count, JtJ, Jtr)
    damping = 1e-3
    damped = np.empty((PARAMETERS, PARAMETERS))
    for _ in range(MOST_STEPS):
        damped[:] = JtJ
        for i in range(PARAMETERS):
            # The small term keeps a spot without contrast from a singular matrix; it fails its tests later.
            damped[i, i] += damping * JtJ[i, i] + 1e-9
        delta = np.linalg.solve(damped, Jtr)
        trial = p + delta
        trial[5] = min(max(trial[5], LEAST_LOG_BLUR), MOST_LOG_BLUR)
        trial_cost = _normal_equations(grey, trial, pixels, count, trial_JtJ, trial_Jtr)
        moved = abs(delta[0]) + abs(delta[1])
        if trial_cost < cost:
            gain = cost - trial_cost
            p[:] = trial
            cost = trial_cost
            JtJ[:] = trial_JtJ
            Jtr[:] = trial_Jtr
            damping *= 0.1
            if moved < SMALL_STEP_PX and gain < 1e-3 * cost:
                break
        else:
            damping *= 10.0
            if damping > 1e6 or moved < 0.1 * SMALL_STEP_PX:
                break
    return cost


@njit(
    "UniTuple(float64[:, ::1], 2)(uint8[:, ::1], float64[:, ::1], float64[:, ::1], float64[::1], float64, float64)",
    cache=True,
    nogil=True,
    error_model="numpy",
)
def _fit(grey, uv, roots, room, blur, band):  # type: ignore[no-untyped-def]
    """Parameters (n, 10), and (n, 2): standard deviation per axis in px (infinite where it failed) and of grey."""
    h, w = grey.shape
    n = len(uv)
    fitted = np.zeros((n, PARAMETERS))
    sigma = np.full((n, 2), np.inf)
    JtJ = np.empty((PARAMETERS, PARAMETERS))
    for i in range(n):
        p = fitted[i]
        p[0], p[1] = uv[i, 0], uv[i, 1]
        p[2:5] = roots[i]
        p[5] = math.log(blur)
        radius = 1.0 / min(abs(p[2]), abs(p[4]))
        side = 2 * int(radius + abs(p[3] / (p[2] * p[4])) + band) + 6
        pixels = np.empty((side * side, 2), np.int64)
        count = _band(h, w, p, band, room[i], pixels)
        # Fewer pixels than this do not carry ten parameters with any certainty left.
        if count < 3 * PARAMETERS:
            continue
        low, high = 255.0, 0.0
        for k in range(count):
            value = float(grey[pixels[k, 1], pixels[k, 0]])
            low, high = min(low, value), max(high, value)
        p[6], p[7] = 0.5 * (low + high), 0.5 * (high - low)
        cost = _descend(grey, pixels, count, p, JtJ)
        variance = cost / (count - PARAMETERS)
        for k in range(PARAMETERS):
            JtJ[k, k] *= 1.0 + 1e-12
            JtJ[k, k] += 1e-12
        cofactors = np.linalg.inv(JtJ)
        spread = 0.5 * variance * (cofactors[0, 0] + cofactors[1, 1])
        moved = math.hypot(p[0] - uv[i, 0], p[1] - uv[i, 1])
        sigma[i, 1] = math.sqrt(variance)
        if spread > 0.0 and moved < 0.5 * radius + 1.0 and p[7] > 0.0 and p[2] * p[4] > 0.0:
            sigma[i, 0] = math.sqrt(spread)
    return fitted, sigma
