"""Sub-pixel corners: where two straight edges cross, with the standard deviation of each.

Around a corner p the brightness is modelled by two blurred steps and a slope of light,

    I(q) = m + g . (q - p) + c E(d_a(q) / s) E(d_b(q) / s),     E(t) = erf(t / sqrt 2),

with d_a, d_b the signed distances of q from two lines through p, s the blur and c the half-contrast. The nine
parameters (x, y, two angles, log s, m, c, g) are fitted by Levenberg-Marquardt over the pixels whose grid coordinates
lie within WINDOW of the distance to the next corners. The corner's terms are even about p, as is any corner blurred
evenly, so that a wrong shape of blur does not pull it aside. The covariance of (x, y) is that of least squares,
sigma^2 (J^T J)^-1 with sigma^2 from the corner's own residuals: noise, blur and contrast all show in it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Grey = NDArray[np.uint8]

WINDOW = 0.4
"""Half width of the window over the distance to the next corner, along each of the grid's directions: the rest keeps
the next edges' blur out."""
PARAMETERS = 9
MOST_STEPS = 20
SMALL_STEP_PX = 1e-3
"""A tenth of the best standard deviation there is."""
LEAST_LOG_BLUR = math.log(0.25)
"""A pixel's own width blurs by 0.29 px; without a floor, an edge between pixel columns could sharpen for ever."""

LEAST_VARIANCE = 1 / 12
"""Of grey values: what rounding to whole levels adds. A drawing without noise is no more certain than that."""
LOG_BLUR_SIGMA = 1.0
"""Edges sharper than a pixel show only their distance over their blur: corner and blur are then known together, from
what is known of blur beforehand, a factor of e. Wherever an edge shows its blur this says nothing."""

TABLE_DENSITY = 64
TABLE_MIDDLE = 144
_TABLE = (np.arange(2 * TABLE_MIDDLE + 1) - TABLE_MIDDLE) / TABLE_DENSITY
_STEP = np.array([math.erf(t) for t in _TABLE])
"""The blurred step and its slope over t; linear between entries they are exact to 3e-5 of the contrast."""
_BELL = np.where(np.abs(_TABLE) < _TABLE[-1], np.exp(-(_TABLE**2)), 0.0)


@dataclass(frozen=True, eq=False)
class Refined:
    """uv (n, 2) pixels; sigma_px (n,) per axis; contrast and noise (n,) grey levels; blur_px (n,) 1 sigma of edges'
    blur; converged (n,)."""

    uv: Array
    sigma_px: Array
    contrast: Array
    noise: Array
    blur_px: Array
    converged: NDArray[np.bool_]


def refine(
    grey: Grey,
    uv: Array,
    steps: Array,
    dark: NDArray[np.bool_],
    *,
    radius_px: float = 6.0,
    blur_px: float = 1.0,
    zero_zone_px: float = 0.0,
) -> Refined:
    """Corners where two edges cross, near uv (n, 2).

    Args: steps (n, 4) pixels: ux, uy to the next corner along the row and vx, vy along the column; dark (n,): colour of
    the square towards both; radius_px: largest half width of the window; blur_px: the blur to start from, about the
    uncertainty of uv; zero_zone_px: half width of the square around the corner that is left out, 0 for none.
    """
    fitted, sigma = _fit(
        grey,
        np.ascontiguousarray(uv, dtype=np.float64),
        np.ascontiguousarray(steps, dtype=np.float64),
        np.ascontiguousarray(dark, dtype=np.bool_),
        float(radius_px),
        float(blur_px),
        float(zero_zone_px),
    )
    ok = np.isfinite(sigma[:, 0])
    return Refined(fitted[:, :2], sigma[:, 0], np.abs(fitted[:, 6]), sigma[:, 1], np.exp(fitted[:, 4]), ok)


@njit(
    "float64(uint8[:, ::1], float64[::1], int64[:, ::1], int64, float64[:, ::1], float64[::1])",
    cache=True,
    nogil=True,
    error_model="numpy",
    fastmath={"contract", "reassoc", "arcp", "nsz"},
)
def _normal_equations(grey, p, pixels, count, JtJ, Jtr):  # type: ignore[no-untyped-def]
    """Fills J^T J (9, 9) and J^T r (9,) over pixels (count, 2); returns the sum of squared residuals."""
    x, y, m, c, gx, gy = p[0], p[1], p[5], p[6], p[7], p[8]
    ca, sa, cb, sb = math.cos(p[2]), math.sin(p[2]), math.cos(p[3]), math.sin(p[3])
    blur = math.exp(p[4])
    scale = 1.0 / (math.sqrt(2.0) * blur)
    slope = math.sqrt(2.0 / math.pi) / blur
    JtJ[:] = 0.0
    Jtr[:] = 0.0
    J = np.empty(PARAMETERS)
    total = 0.0
    for k in range(count):
        u, v = pixels[k, 0], pixels[k, 1]
        dx, dy = u - x, v - y
        da, db = ca * dy - sa * dx, cb * dy - sb * dx
        ta, tb = da * scale, db * scale
        # Beyond the table, over 3 standard deviations of blur, a step is flat to one part in 400.
        ka = min(max(int(ta * TABLE_DENSITY + TABLE_MIDDLE), 0), 2 * TABLE_MIDDLE - 1)
        kb = min(max(int(tb * TABLE_DENSITY + TABLE_MIDDLE), 0), 2 * TABLE_MIDDLE - 1)
        fa = min(max(ta * TABLE_DENSITY + TABLE_MIDDLE - ka, 0.0), 1.0)
        fb = min(max(tb * TABLE_DENSITY + TABLE_MIDDLE - kb, 0.0), 1.0)
        ea = _STEP[ka] + fa * (_STEP[ka + 1] - _STEP[ka])
        eb = _STEP[kb] + fb * (_STEP[kb + 1] - _STEP[kb])
        ga = slope * (_BELL[ka] + fa * (_BELL[ka + 1] - _BELL[ka]))
        gb = slope * (_BELL[kb] + fb * (_BELL[kb + 1] - _BELL[kb]))
        residual = grey[v, u] - (m + gx * dx + gy * dy + c * ea * eb)
        total += residual * residual
        wa, wb = c * ga * eb, c * gb * ea
        J[0] = wa * sa + wb * sb - gx
        J[1] = -wa * ca - wb * cb - gy
        J[2] = -wa * (ca * dx + sa * dy)
        J[3] = -wb * (cb * dx + sb * dy)
        J[4] = -wa * da - wb * db
        J[5] = 1.0
        J[6] = ea * eb
        J[7] = dx
        J[8] = dy
        for i in range(PARAMETERS):
            Jtr[i] += J[i] * residual
            for j in range(i + 1):
                JtJ[i, j] += J[i] * J[j]
    for i in range(PARAMETERS):
        for j in range(i):
            JtJ[j, i] = JtJ[i, j]
    return total


@njit("int64(int64, int64, float64[::1], float64[::1], float64, float64, int64[:, ::1])", cache=True, nogil=True)
def _window(h, w, centre, step, radius, zero, pixels):  # type: ignore[no-untyped-def]
    """Fills the pixels (count, 2) within the window around a centre; returns their count."""
    det = step[0] * step[3] - step[1] * step[2]
    count = 0
    if det == 0.0:  # a corner so alone that the grid's directions are not known there
        return count
    for v in range(max(int(centre[1] - radius), 0), min(int(centre[1] + radius) + 2, h)):
        for u in range(max(int(centre[0] - radius), 0), min(int(centre[0] + radius) + 2, w)):
            dx, dy = u - centre[0], v - centre[1]
            if abs(dx) < zero and abs(dy) < zero:
                continue
            a = (dx * step[3] - dy * step[2]) / det
            b = (dy * step[0] - dx * step[1]) / det
            if abs(a) <= WINDOW and abs(b) <= WINDOW and dx * dx + dy * dy <= radius * radius:
                pixels[count, 0] = u
                pixels[count, 1] = v
                count += 1
    return count


@njit("void(uint8[:, ::1], int64[:, ::1], int64, float64[::1], float64[::1], boolean, float64[::1])", cache=True)
def _start(grey, pixels, count, centre, step, dark, p):  # type: ignore[no-untyped-def]
    """Fills parameters 0-3 and 5-8: edges along the grid's directions, brightness from the window's pixels."""
    p[:] = 0.0
    p[0], p[1] = centre[0], centre[1]
    p[2], p[3] = math.atan2(step[1], step[0]), math.atan2(step[3], step[2])
    low, high = 255.0, 0.0
    for k in range(count):
        value = float(grey[pixels[k, 1], pixels[k, 0]])
        low, high = min(low, value), max(high, value)
        p[5] += value / count
    # Between the axes d_a > 0 and d_b < 0: there the model is dark when c is above 0.
    p[6] = 0.5 * (high - low) * (1.0 if dark else -1.0)


@njit("void(float64[:, ::1], float64, float64[:, ::1])", cache=True, nogil=True)
def _factor(A, damping, L):  # type: ignore[no-untyped-def]
    """Fills L with the lower Cholesky factor of A + damping diag(A)."""
    for i in range(PARAMETERS):
        for j in range(i + 1):
            total = A[i, j]
            if i == j:
                # The small term keeps a corner without contrast from a root of zero; it fails its tests later.
                total += damping * A[i, i] + 1e-9
            for k in range(j):
                total -= L[i, k] * L[j, k]
            L[i, j] = math.sqrt(max(total, 1e-12)) if i == j else total / L[j, j]


@njit("void(float64[:, ::1], float64[::1], float64[::1])", cache=True, nogil=True)
def _solve(L, b, x):  # type: ignore[no-untyped-def]
    """Fills x with the solution of L L^T x = b."""
    for i in range(PARAMETERS):
        total = b[i]
        for k in range(i):
            total -= L[i, k] * x[k]
        x[i] = total / L[i, i]
    for i in range(PARAMETERS - 1, -1, -1):
        total = x[i]
        for k in range(i + 1, PARAMETERS):
            total -= L[k, i] * x[k]
        x[i] = total / L[i, i]


@njit(
    "float64(uint8[:, ::1], int64[:, ::1], int64, float64[::1], float64, float64[:, ::1])",
    cache=True,
    nogil=True,
    error_model="numpy",
)
def _descend(grey, pixels, count, p, most_blur, JtJ):  # type: ignore[no-untyped-def]
    """Levenberg-Marquardt on p, in place; fills J^T J there; returns the sum of squared residuals."""
    Jtr, trial_JtJ, trial_Jtr = np.empty(PARAMETERS), np.empty((PARAMETERS, PARAMETERS)), np.empty(PARAMETERS)
    cost = _normal_equations(grey, p, pixels, count, JtJ, Jtr)
    damping = 1e-3
    L, delta, trial = np.empty((PARAMETERS, PARAMETERS)), np.empty(PARAMETERS), np.empty(PARAMETERS)
    for _ in range(MOST_STEPS):
        _factor(JtJ, damping, L)
        _solve(L, Jtr, delta)
        trial[:] = p + delta
        trial[4] = min(max(trial[4], LEAST_LOG_BLUR), math.log(most_blur))
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
    "UniTuple(float64[:, ::1], 2)(uint8[:, ::1], float64[:, ::1], float64[:, ::1], boolean[::1], float64, float64, "
    "float64)",
    cache=True,
    nogil=True,
    error_model="numpy",
)
def _fit(grey, uv, steps, dark, radius, blur, zero):  # type: ignore[no-untyped-def]
    """Parameters (n, 9), and (n, 2): standard deviation per axis in px (infinite where it failed) and of grey."""
    h, w = grey.shape
    n = len(uv)
    fitted = np.zeros((n, PARAMETERS))
    sigma = np.full((n, 2), np.inf)
    side = 2 * int(radius) + 4
    pixels = np.empty((side * side, 2), np.int64)
    JtJ, L = np.empty((PARAMETERS, PARAMETERS)), np.empty((PARAMETERS, PARAMETERS))
    unit, column = np.empty(PARAMETERS), np.empty(PARAMETERS)
    for i in range(n):
        p, step = fitted[i], steps[i]
        count = _window(h, w, uv[i], step, radius, zero, pixels)
        _start(grey, pixels, count, uv[i], step, dark[i], p)
        p[4] = math.log(blur)
        # Fewer pixels than this do not carry nine parameters with any certainty left.
        if count < 3 * PARAMETERS:
            continue
        cost = _descend(grey, pixels, count, p, radius, JtJ)
        variance = max(cost / (count - PARAMETERS), LEAST_VARIANCE)
        JtJ[4, 4] += variance / LOG_BLUR_SIGMA**2
        _factor(JtJ, 0.0, L)
        spread = 0.0
        for axis in range(2):
            unit[:] = 0.0
            unit[axis] = 1.0
            _solve(L, unit, column)
            spread += 0.5 * variance * column[axis]
        # A fit that runs half its window away has left the corner it began at for something else.
        limit = min(WINDOW * min(math.hypot(step[0], step[1]), math.hypot(step[2], step[3])), 0.5 * radius)
        moved = math.hypot(p[0] - uv[i, 0], p[1] - uv[i, 1])
        sigma[i, 1] = math.sqrt(variance)
        # Nor is anything known of one whose deviation is as large.
        if 0.0 < spread < limit * limit and moved < limit and (p[6] > 0.0) == dark[i]:
            sigma[i, 0] = math.sqrt(spread)
    return fitted, sigma
