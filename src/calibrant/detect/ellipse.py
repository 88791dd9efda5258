"""Sub-pixel ellipses: a blurred elliptical edge fitted to the grey values, with the standard deviation of its centre.

Around a spot at p the scene is ink inside the outline and paper outside, under light that changes by gamma per pixel:
(1 + gamma . r) (m + c sgn d) with r = q - p. Blurred by a Gaussian of sigma s it reads

    I(q) = I_0 + (1 + gamma . r) (m + c E(d / s)) + c (gamma . n) s^2 E'(d / s),     E(t) = erf(t / sqrt 2),
    d = (rho - 1) / |grad rho|,     rho = |A r|,     A = [[a, 0], [b, c2]],     n = grad rho / |grad rho|

with I_0 the grey value of darkness, d the distance from the outline to first order and ' the derivative by d. The last
term is what blur adds where the light changes: it moves every edge to the bright side of the picture, by gamma s^2. The
ten parameters (x, y, a, b, c2, log s, m, c, gamma) are fitted by Levenberg-Marquardt, first to a part of the pixels
around the rough outline, then to all around the fitted one. But for gamma's, the terms are even about p, as is a spot
blurred evenly, so that an outline of the wrong shape does not pull the centre aside.

The covariance of (x, y) is that of least squares, V = s^2 (J^T J)^-1 with s^2 from the spot's own residuals, if these
are noise. They are not noise alone: pixels, demosaicing and resizing make an edge's profile depend on where it falls
between pixels, and d is approximate. So the outline is cut into short arcs, each taken with the one opposite, whose
errors do not depend on those of others; and with g_q the share of pixel q in (x, y) per grey level, each pair's sum of
g_q r_q is compared with what noise would give there (K.-Y. Liang, S. Zeger, Longitudinal data analysis using
generalized linear models, Biometrika 1986). The ratio, taken over all spots of a picture since raster and blur are the
same there, multiplies V: below 1 where misfits cancel across the edge or the spot.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from calibrant.detect.blurred_step import step_and_bell
from calibrant.detect.spots import Spots

Array = NDArray[np.float64]
Grey = NDArray[np.uint8]

PARAMETERS = 10
MOST_STEPS = 15
SMALL_STEP_PX, ROUGH_STEP_PX = 1e-3, 2e-2
"""Of the centre, when a fit is done: a fourth of the best standard deviation there is; and of the fit before that."""
BLURS = 3.0
"""Half width of the band over the blur: beyond it an edge is flat."""
FIRST_BAND_PX = 4.0
LEAST_BAND_PX = 2.5
"""A rough outline is off by a pixel; a sharp edge still wants a pixel or two of ink and paper on its sides."""
THINNED = 3
"""Of how many pixels the first fit takes one: it is good to a hundredth of a pixel."""
ARC_PX = 3.0
"""Length of an arc whose errors are taken as one: pixels further apart do not share the raster's effect on an edge."""
LEAST_ARCS = 150
"""Over all spots: the ratio of variances is then known to a tenth, by two axes each. With fewer it is taken for 1."""
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


def refine_spots(grey: Grey, spots: Spots, *, room: Array, darkness: float = 0.0, blur_px: float = 1.0) -> Ellipses:
    """Ellipses at rough ones, dark in grey (h, w).

    Args: room (n,): how far the window may reach, in half axes (1: the outline itself); darkness: the grey value where
    no light falls, 255 in a negative; blur_px: the blur to start from.
    """
    image, roots = np.ascontiguousarray(grey), np.ascontiguousarray(_roots(spots.shape))
    parameters, sigma, arcs = _fit(image, spots.uv, roots, room, float(blur_px), float(darkness))
    found, expected, count = arcs[np.isfinite(sigma[:, 0])].sum(axis=0)
    if count >= LEAST_ARCS:
        sigma[:, 0] *= np.sqrt(found / expected)
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
    "float64(uint8[:, ::1], float64, float64[::1], int64[:, ::1], float64[:, ::1], float64[::1])",
    cache=True,
    nogil=True,
    error_model="numpy",
    fastmath={"contract", "reassoc", "arcp", "nsz"},
)
def _linearise(grey, darkness, p, pixels, J, r):  # type: ignore[no-untyped-def]
    """Fills J (10, n) and r (n,) at pixels (n, 2); returns the sum of squared residuals."""
    a, b, c2, m, c, gx, gy = p[2], p[3], p[4], p[6], p[7], p[8], p[9]
    blur = math.exp(p[5])
    scale, slope = math.sqrt(0.5) / blur, math.sqrt(2.0 / math.pi) / blur
    total = 0.0
    for k in range(len(pixels)):
        u, v = pixels[k, 0], pixels[k, 1]
        dx, dy = u - p[0], v - p[1]
        y1, y2 = a * dx, b * dx + c2 * dy
        rho = max(math.sqrt(y1 * y1 + y2 * y2), 1e-6)
        nx, ny = (a * y1 + b * y2) / rho, c2 * y2 / rho
        per_steep = 1.0 / max(math.sqrt(nx * nx + ny * ny), 1e-9)
        nx, ny = nx * per_steep, ny * per_steep
        d = (rho - 1.0) * per_steep
        e, bell = step_and_bell(d * scale)
        bell *= slope
        light, inked = 1.0 + gx * dx + gy * dy, m + c * e
        shifted = blur * blur * bell
        residual = grey[v, u] - (darkness + light * inked + c * (gx * nx + gy * ny) * shifted)
        r[k] = residual
        total += residual * residual
        w = light * c * bell
        of_rho = w * per_steep / rho
        # The slopes of the last term by the outline's parameters are left out: a thousandth of the others.
        J[0, k] = -w * nx - gx * inked
        J[1, k] = -w * ny - gy * inked
        J[2, k] = of_rho * y1 * dx
        J[3, k] = of_rho * y2 * dx
        J[4, k] = of_rho * y2 * dy
        J[5, k] = -w * d
        J[6, k] = light
        J[7, k] = light * e + (gx * nx + gy * ny) * shifted
        J[8, k] = dx * inked + c * nx * shifted
        J[9, k] = dy * inked + c * ny * shifted
    return total


@njit(
    "int64(int64, int64, float64[::1], float64, float64, int64[:, ::1])",
    cache=True,
    nogil=True,
    error_model="numpy",
)
def _band(h, w, p, band, room, pixels):  # type: ignore[no-untyped-def]
    """Fills the pixels (count, 2) within `band` px of the outline and within `room` half axes; returns their count."""
    a, b, c2 = p[2], p[3], p[4]
    # Half extents of the ellipse along x and y: roots of the diagonal of (A^T A)^-1.
    det = abs(a * c2)
    reach_x = math.sqrt(b * b + c2 * c2) / det + band + 1.0
    reach_y = abs(a) / det + band + 1.0
    # No slope of rho is steeper than the root of the sum of A's squares: most pixels are told by rho^2 alone.
    steepest = math.sqrt(a * a + b * b + c2 * c2)
    least, most = max(1.0 - band * steepest, 0.0) ** 2, min(1.0 + band * steepest, room) ** 2
    count = 0
    for v in range(max(int(p[1] - reach_y), 0), min(int(p[1] + reach_y) + 2, h)):
        for u in range(max(int(p[0] - reach_x), 0), min(int(p[0] + reach_x) + 2, w)):
            dx, dy = u - p[0], v - p[1]
            y1, y2 = a * dx, b * dx + c2 * dy
            rho2 = y1 * y1 + y2 * y2
            if rho2 > most or rho2 < least:
                continue
            rho = math.sqrt(rho2)
            nx, ny = a * y1 + b * y2, c2 * y2
            steep = math.sqrt(nx * nx + ny * ny) / max(rho, 1e-9)
            if abs(rho - 1.0) <= band * max(steep, 1e-9) and count < len(pixels):
                pixels[count, 0] = u
                pixels[count, 1] = v
                count += 1
    return count


@njit(
    "void(float64[:, ::1], float64[::1], float64[:, ::1], float64[::1])",
    cache=True,
    nogil=True,
    fastmath={"contract", "reassoc"},
)
def _products(J, r, JtJ, Jtr):  # type: ignore[no-untyped-def]
    """Fills J J^T (10, 10) and J r (10,): along the pixels, where loops run over neighbours in memory."""
    n = len(r)
    for i in range(PARAMETERS):
        total = 0.0
        for k in range(n):
            total += J[i, k] * r[k]
        Jtr[i] = total
        for j in range(i + 1):
            total = 0.0
            for k in range(n):
                total += J[i, k] * J[j, k]
            JtJ[i, j] = total
            JtJ[j, i] = total


@njit(
    "float64(uint8[:, ::1], float64, int64[:, ::1], float64[::1], float64[:, ::1], float64)",
    cache=True,
    nogil=True,
    error_model="numpy",
)
def _descend(grey, darkness, pixels, p, JtJ, enough):  # type: ignore[no-untyped-def]
    """Levenberg-Marquardt on p, in place, until steps fall below `enough` px; fills J^T J there; returns the cost."""
    n = len(pixels)
    J, trial_J, r, trial_r = np.empty((PARAMETERS, n)), np.empty((PARAMETERS, n)), np.empty(n), np.empty(n)
    cost = _linearise(grey, darkness, p, pixels, J, r)
    damping = 1e-3
    Jtr, damped = np.empty(PARAMETERS), np.empty((PARAMETERS, PARAMETERS))
    _products(J, r, JtJ, Jtr)
    for _ in range(MOST_STEPS):
        damped[:] = JtJ
        for i in range(PARAMETERS):
            # The small term keeps a spot without contrast from a singular matrix; it fails its tests later.
            damped[i, i] += damping * JtJ[i, i] + 1e-9
        delta = np.linalg.solve(damped, Jtr)
        trial = p + delta
        trial[5] = min(max(trial[5], LEAST_LOG_BLUR), MOST_LOG_BLUR)
        trial_cost = _linearise(grey, darkness, trial, pixels, trial_J, trial_r)
        moved = abs(delta[0]) + abs(delta[1])
        if trial_cost < cost:
            p[:] = trial
            cost = trial_cost
            J, trial_J, r, trial_r = trial_J, J, trial_r, r
            _products(J, r, JtJ, Jtr)
            damping *= 0.1
            if moved < enough:
                break
        else:
            damping *= 10.0
            if damping > 1e6 or moved < 0.1 * enough:
                break
    return cost


@njit(
    "void(uint8[:, ::1], float64, float64[::1], int64[:, ::1], float64[:, ::1], float64, float64[::1])",
    cache=True,
    nogil=True,
    error_model="numpy",
)
def _sum_arcs(grey, darkness, p, pixels, cofactors, variance, arcs):  # type: ignore[no-untyped-def]
    """Fills arcs (3,): sum over pairs of arcs of (sum of g r)^2, in variances of (x, y); what noise gives; count."""
    n = len(pixels)
    J, r = np.empty((PARAMETERS, n)), np.empty(n)
    _linearise(grey, darkness, p, pixels, J, r)
    girth = math.pi * (1.0 / abs(p[2]) + 1.0 / abs(p[4]))
    count = max(int(0.5 * girth / ARC_PX), 4)
    shift = np.zeros((count, 2))
    normal = np.zeros((count, PARAMETERS, PARAMETERS))
    for k in range(n):
        dx, dy = pixels[k, 0] - p[0], pixels[k, 1] - p[1]
        half_turns = 1.0 + math.atan2(p[3] * dx + p[4] * dy, p[2] * dx) / math.pi
        arc = int(half_turns * count) % count
        for axis in range(2):
            share = 0.0
            for i in range(PARAMETERS):
                share += cofactors[axis, i] * J[i, k]
            shift[arc, axis] += share * r[k]
        for i in range(PARAMETERS):
            for j in range(i + 1):
                normal[arc, i, j] += J[i, k] * J[j, k]
    scale = variance * (cofactors[0, 0] + cofactors[1, 1])
    arcs[:] = 0.0
    for arc in range(count):
        for i in range(PARAMETERS):
            normal[arc, i, i + 1 :] = normal[arc, i + 1 :, i]
        arcs[0] += (shift[arc, 0] ** 2 + shift[arc, 1] ** 2) / scale
        # Residuals are noise less what the fit took of it: g^T (I - J C J^T) g within the arc.
        for axis in range(2):
            spread = np.dot(normal[arc], cofactors[axis])
            arcs[1] += variance * (np.dot(cofactors[axis], spread) - np.dot(spread, np.dot(cofactors, spread))) / scale
    arcs[2] = count


@njit("void(uint8[:, ::1], int64[:, ::1], float64[::1])", cache=True, nogil=True)
def _start_greys(grey, pixels, p):  # type: ignore[no-untyped-def]
    """Fills m and c from the pixels' darkest and lightest."""
    low, high = 255.0, 0.0
    for k in range(len(pixels)):
        value = float(grey[pixels[k, 1], pixels[k, 0]])
        low, high = min(low, value), max(high, value)
    p[6], p[7] = 0.5 * (low + high), 0.5 * (high - low)


@njit(
    "UniTuple(float64[:, ::1], 3)(uint8[:, ::1], float64[:, ::1], float64[:, ::1], float64[::1], float64, float64)",
    cache=True,
    nogil=True,
    error_model="numpy",
)
def _fit(grey, uv, roots, room, blur, darkness):  # type: ignore[no-untyped-def]
    """Parameters (n, 10); (n, 2): standard deviation per axis in px (infinite where it failed) and of grey, taking
    residuals for noise; (n, 3) sums over arcs."""
    h, w = grey.shape
    n = len(uv)
    fitted = np.zeros((n, PARAMETERS))
    sigma = np.full((n, 2), np.inf)
    arcs = np.zeros((n, 3))
    JtJ = np.empty((PARAMETERS, PARAMETERS))
    for i in range(n):
        p = fitted[i]
        p[0], p[1] = uv[i, 0], uv[i, 1]
        p[2:5] = roots[i]
        p[5] = math.log(blur)
        radius = 1.0 / min(abs(p[2]), abs(p[4]))
        side = 2 * int(radius + abs(p[3] / (p[2] * p[4])) + max(FIRST_BAND_PX, BLURS * blur)) + 6
        pixels = np.empty((side * side, 2), np.int64)
        count = _band(h, w, p, max(FIRST_BAND_PX, BLURS * blur), room[i], pixels)
        # Fewer pixels than this do not carry the parameters with any certainty left.
        if count < 3 * PARAMETERS:
            continue
        _start_greys(grey, pixels[:count], p)
        p[6] -= darkness
        thinned = THINNED if count > 8 * THINNED * PARAMETERS else 1
        _descend(grey, darkness, np.ascontiguousarray(pixels[:count:thinned]), p, JtJ, ROUGH_STEP_PX)
        moved = math.hypot(p[0] - uv[i, 0], p[1] - uv[i, 1])
        if not (moved < 0.5 * radius + 1.0 and p[7] > 0.0 and p[2] * p[4] > 0.0):
            continue
        count = _band(h, w, p, max(LEAST_BAND_PX, BLURS * math.exp(p[5])), room[i], pixels)
        if count < 3 * PARAMETERS:
            continue
        cost = _descend(grey, darkness, pixels[:count], p, JtJ, SMALL_STEP_PX)
        variance = cost / (count - PARAMETERS)
        for k in range(PARAMETERS):
            JtJ[k, k] *= 1.0 + 1e-12
            JtJ[k, k] += 1e-12
        cofactors = np.ascontiguousarray(np.linalg.inv(JtJ))
        spread = 0.5 * variance * (cofactors[0, 0] + cofactors[1, 1])
        moved = math.hypot(p[0] - uv[i, 0], p[1] - uv[i, 1])
        sigma[i, 1] = math.sqrt(variance)
        if spread > 0.0 and moved < 0.5 * radius + 1.0 and p[7] > 0.0 and p[2] * p[4] > 0.0:
            sigma[i, 0] = math.sqrt(spread)
            _sum_arcs(grey, darkness, p, pixels[:count], cofactors, variance, arcs[i])
    return fitted, sigma, arcs
