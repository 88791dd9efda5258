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

The covariance of (x, y) is that of least squares with sigma from the spot's own residuals, times what these do beyond
noise (`robust_variance`): groups are short arcs of the outline, each with the one opposite, as misfits that are even
about p cancel between these.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array, Grey
from calibrant.compiled import compiled, compiled_part
from calibrant.detection.circles.spots import Spots
from calibrant.detection.subpixel.blurred_step import step_and_bell
from calibrant.detection.subpixel.normal_equations import factor, products, solve
from calibrant.detection.subpixel.robust_variance import GROUP_PX, sum_groups, variance_ratio

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
    sigma[:, 0] *= np.sqrt(variance_ratio(arcs[np.isfinite(sigma[:, 0])]))
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


@compiled_part(
    "float64(float64[:, ::1], float64[::1], float64[:, ::1], float64[::1])",
    fastmath={"contract", "reassoc", "arcp", "nsz"},
    forceinline=True,
)
def _linearise(window, p, J, r):  # type: ignore[no-untyped-def]
    """Fills J (10, n) and r (n,) from the window's x, y and grey, (3, n); returns the sum of squared residuals.

    In three loops, so that the first and the last are computed for several pixels at once.
    """
    a, b, c2, m, c, gx, gy = p[2], p[3], p[4], p[6], p[7], p[8], p[9]
    blur = math.exp(p[5])
    scale, slope = math.sqrt(0.5) / blur, math.sqrt(2.0 / math.pi) / blur
    n = window.shape[1]
    for k in range(n):
        dx, dy = window[0, k] - p[0], window[1, k] - p[1]
        y1, y2 = a * dx, b * dx + c2 * dy
        rho = math.sqrt(y1 * y1 + y2 * y2 + 1e-12)
        qx, qy = a * y1 + b * y2, c2 * y2
        per_length = 1.0 / math.sqrt(qx * qx + qy * qy + 1e-18)
        J[0, k], J[1, k] = qx * per_length, qy * per_length
        J[2, k], J[3, k], J[4, k] = y1 * dx * per_length, y2 * dx * per_length, y2 * dy * per_length
        J[5, k] = (rho - 1.0) * rho * per_length
    for k in range(n):
        J[7, k], J[6, k] = step_and_bell(J[5, k] * scale)
    total = 0.0
    for k in range(n):
        dx, dy = window[0, k] - p[0], window[1, k] - p[1]
        nx, ny, d, e, bell = J[0, k], J[1, k], J[5, k], J[7, k], slope * J[6, k]
        light, inked = 1.0 + gx * dx + gy * dy, m + c * e
        shifted = blur * blur * bell
        r[k] = window[2, k] - (light * inked + c * (gx * nx + gy * ny) * shifted)
        total += r[k] * r[k]
        # The slopes of the last term by the outline's parameters are left out: a thousandth of the others.
        w = light * c * bell
        J[0, k] = -w * nx - gx * inked
        J[1, k] = -w * ny - gy * inked
        J[2, k] *= w
        J[3, k] *= w
        J[4, k] *= w
        J[5, k] = -w * d
        J[6, k] = light
        J[7, k] = light * e + (gx * nx + gy * ny) * shifted
        J[8, k] = dx * inked + c * nx * shifted
        J[9, k] = dy * inked + c * ny * shifted
    return total


@compiled_part("float64[:, ::1](uint8[:, ::1], float64, float64[::1], float64, float64)")
def _band(grey, darkness, p, band, room):  # type: ignore[no-untyped-def]
    """x, y and grey above darkness, (3, n), of pixels within `band` px of the outline and within `room` half axes."""
    h, w = grey.shape
    a, b, c2 = p[2], p[3], p[4]
    # Half extents of the ellipse along x and y: roots of the diagonal of (A^T A)^-1.
    det = abs(a * c2)
    reach_x = math.sqrt(b * b + c2 * c2) / det + band + 1.0
    reach_y = abs(a) / det + band + 1.0
    # No slope of rho is steeper than the root of the sum of A's squares: most pixels are told by rho^2 alone.
    steepest = math.sqrt(a * a + b * b + c2 * c2)
    least, most = max(1.0 - band * steepest, 0.0) ** 2, min(1.0 + band * steepest, room) ** 2
    window = np.empty((3, int(2.0 * reach_x + 4.0) * int(2.0 * reach_y + 4.0)))
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
            if abs(rho - 1.0) <= band * max(steep, 1e-9):
                window[0, count] = u
                window[1, count] = v
                window[2, count] = grey[v, u] - darkness
                count += 1
    return window[:, :count].copy()


@compiled_part("float64(float64[:, ::1], float64[::1], float64[:, ::1], float64)", forceinline=True)
def _descend(window, p, JtJ, enough):  # type: ignore[no-untyped-def]
    """Levenberg-Marquardt on p, in place, until steps fall below `enough` px; fills J^T J there; returns the cost."""
    n = window.shape[1]
    J, trial_J, r, trial_r = np.empty((PARAMETERS, n)), np.empty((PARAMETERS, n)), np.empty(n), np.empty(n)
    cost = _linearise(window, p, J, r)
    damping = 1e-3
    Jtr, delta, L = np.empty(PARAMETERS), np.empty(PARAMETERS), np.empty((PARAMETERS, PARAMETERS))
    products(J, r, JtJ, Jtr)
    for _ in range(MOST_STEPS):
        factor(JtJ, damping, L)
        solve(L, Jtr, delta)
        trial = p + delta
        trial[5] = min(max(trial[5], LEAST_LOG_BLUR), MOST_LOG_BLUR)
        trial_cost = _linearise(window, trial, trial_J, trial_r)
        moved = abs(delta[0]) + abs(delta[1])
        if trial_cost < cost:
            for i in range(len(p)):
                p[i] = trial[i]
            cost = trial_cost
            J, trial_J, r, trial_r = trial_J, J, trial_r, r
            products(J, r, JtJ, Jtr)
            damping *= 0.1
            if moved < enough:
                break
        else:
            damping *= 10.0
            if damping > 1e6 or moved < 0.1 * enough:
                break
    return cost


@compiled_part("void(float64[:, ::1], float64[::1], float64[:, ::1], float64, float64[:, ::1])", forceinline=True)
def _sum_arcs(window, p, cofactors, variance, sums):  # type: ignore[no-untyped-def]
    """Fills sums (2, 6) of `robust_variance`."""
    n = window.shape[1]
    J, r, group = np.empty((PARAMETERS, n)), np.empty(n), np.empty(n, np.int64)
    _linearise(window, p, J, r)
    half_girth = 0.5 * math.pi * (1.0 / abs(p[2]) + 1.0 / abs(p[4]))
    count = max(int(half_girth / GROUP_PX), 4)
    for k in range(n):
        dx, dy = window[0, k] - p[0], window[1, k] - p[1]
        half_turns = 1.0 + math.atan2(p[3] * dx + p[4] * dy, p[2] * dx) / math.pi
        group[k] = int(half_turns * count) % count
    sum_groups(J, r, cofactors, group, count, variance, sums)


@compiled(
    "Tuple((float64[:, ::1], float64[:, ::1], float64[:, :, ::1]))(uint8[:, ::1], float64[:, ::1], float64[:, ::1], "
    "float64[::1], float64, float64)"
)
def _fit(grey, uv, roots, room, blur, darkness):  # type: ignore[no-untyped-def]
    """Parameters (n, 10); (n, 2): standard deviation per axis in px (infinite where it failed) and of grey, taking
    residuals for noise; (n, 2, 6) sums over arcs."""
    n = len(uv)
    fitted = np.zeros((n, PARAMETERS))
    sigma = np.full((n, 2), np.inf)
    arcs = np.zeros((n, 2, 6))
    JtJ = np.empty((PARAMETERS, PARAMETERS))
    for i in range(n):
        p = fitted[i]
        p[0], p[1] = uv[i, 0], uv[i, 1]
        p[2], p[3], p[4] = roots[i, 0], roots[i, 1], roots[i, 2]
        p[5] = math.log(blur)
        radius = 1.0 / min(abs(p[2]), abs(p[4]))
        window = _band(grey, darkness, p, max(FIRST_BAND_PX, BLURS * blur), room[i])
        count = window.shape[1]
        # Fewer pixels than this do not carry the parameters with any certainty left.
        if count < 3 * PARAMETERS:
            continue
        low, high = window[2].min(), window[2].max()
        p[6], p[7] = 0.5 * (low + high), 0.5 * (high - low)
        thinned = THINNED if count > 8 * THINNED * PARAMETERS else 1
        _descend(np.ascontiguousarray(window[:, ::thinned]), p, JtJ, ROUGH_STEP_PX)
        moved = math.hypot(p[0] - uv[i, 0], p[1] - uv[i, 1])
        if not (moved < 0.5 * radius + 1.0 and p[7] > 0.0 and p[2] * p[4] > 0.0):
            continue
        window = _band(grey, darkness, p, max(LEAST_BAND_PX, BLURS * math.exp(p[5])), room[i])
        count = window.shape[1]
        if count < 3 * PARAMETERS:
            continue
        cost = _descend(window, p, JtJ, SMALL_STEP_PX)
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
            _sum_arcs(window, p, cofactors, variance, arcs[i])
    return fitted, sigma, arcs
