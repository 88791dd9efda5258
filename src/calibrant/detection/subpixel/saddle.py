"""Sub-pixel corners: where two straight edges cross, with the standard deviation of each.

Around a corner p the scene is m + c sgn(d_a) sgn(d_b) under a slope of light g . (q - p), with d_a, d_b the signed
distances of q from two lines through p. Blurred by a Gaussian of sigma s, with t = d / s and E(t) = erf(t / sqrt 2),

    I(q) = m + g . (q - p) + c (E(t_a) E(t_b) + E'(t_a) E'(t_b) (r + r^2 t_a t_b / 2 + r^3 (t_a^2 - 1) (t_b^2 - 1) / 6))

where r is the cosine of the edges' angle: Mehler's series of the bivariate normal distribution, which to this term is
good to 1 % of c up to r = 0.6.

Pictures whose pixels were mixed from others (demosaicing, resizing, blur put on afterwards) hold an edge at a fraction
f of a pixel as the mean of two edges a pixel apart, with weights f and 1 - f: its profile has the third moment
f (1 - f) (1 - 2 f). Along a slanted edge that averages out; on one along the raster it would pull the line aside. Each
edge therefore has a third moment k of its own, E + k / (6 s^3) (1 - t^2) E', unknown but for its variance over f, and
less the more pixels the edge crosses.

The eleven parameters (x, y, two angles, log s, m, c, g, k_a, k_b) are fitted by Levenberg-Marquardt over the pixels
whose grid coordinates lie within WINDOW of the distance to the next corners; the k only where an edge runs along the
raster. But for these and g, the terms are even about p, as is any corner blurred evenly, so that a wrong shape of blur
does not pull it aside. The covariance of (x, y) is that of least squares, sigma^2 (J^T J)^-1 with sigma^2 from the
corner's own residuals: noise, blur and contrast all show in it; times what these residuals do beyond noise
(`robust_variance`): groups are pieces of the edges, each with the one opposite. Added is how far edges along the raster
that are as sharp as pixels are drawn aside by the pixels' being squares.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array, Grey
from calibrant.compiled import compiled, compiled_part
from calibrant.detection.subpixel.blurred_step import step_and_bell
from calibrant.detection.subpixel.moved_edges import linearise_moved
from calibrant.detection.subpixel.normal_equations import factor, invert, products, solve
from calibrant.detection.subpixel.refined import Refined, Zone, zone_of
from calibrant.detection.subpixel.robust_variance import GROUP_PX, sum_groups, variance_ratio

WINDOW = 0.4
"""Half width of the window over the distance to the next corner, along each of the grid's directions: the rest keeps
the next edges' blur out."""
PARAMETERS, THIRD_MOMENTS = 11, 2
LEAST_PIXELS = 27
"""Three times the parameters but the third moments: fewer do not carry these with any certainty left."""
RASTER_PX3 = math.sqrt(1.0 / 210.0)
"""Third moment of an edge mixed from two pixels, rms over all places between them: that of f (1 - f) (1 - 2 f)."""
ALIASED_PX = 1.0 / math.pi
"""Times exp(-2 pi^2 s^2): how far a line fitted to an edge along the raster swings about it as the edge moves through a
pixel. A pixel is the mean over its square, whose spectrum ends before one period a pixel; a Gaussian of the same width
s has that much left there, which the raster takes for a place: 0.04 px rms at a blur of pixels alone, 0.002 at 0.5."""
LEAST_RASTER = 0.1
"""Of RASTER_PX3: what is left of it on an edge that crosses a pixel and a half; below, the k are not looked for."""
LEAST_LOG_MIXED = math.log(0.5)
"""Blur of an edge mixed from two pixels half and half, by that alone: sharper ones are hardly mixed."""
FLAT_PX3 = 1e-6
"""Standard deviation of a k that is not looked for: none."""
MOST_STEPS = 20
SMALL_STEP_PX, ROUGH_STEP_PX = 1e-3, 2e-2
"""When a fit is done: a tenth of the best standard deviation there is; and when the one before it is."""
SMALL_GAIN = 1e-3
"""Of the sum of squares, what the last step may promise: with a hundred pixels, that of a third of a standard deviation
in the worst of directions."""
SQRT_HALF = math.sqrt(0.5)
LEAST_LOG_BLUR = math.log(0.25)
"""A pixel's own width blurs by 0.29 px; without a floor, an edge between pixel columns could sharpen for ever."""

LEAST_VARIANCE = 1 / 12
"""Of grey values: what rounding to whole levels adds. A drawing without noise is no more certain than that."""
MOST_STRETCH = 3.0
"""Of d and o of `moved_edges`: blur that is e^3 times as wide one way as the other fits into no window."""
LOG_BLUR_SIGMA = 1.0
"""Edges sharper than a pixel show only their distance over their blur: corner and blur are then known together, from
what is known of blur beforehand, a factor of e. Wherever an edge shows its blur this says nothing."""


def refined(fitted: Array, sigma: Array, pieces: Array) -> Refined:
    """What `fit` found without a stretch."""
    ok = np.isfinite(sigma[:, 0])
    spread = sigma[:, 0] * np.sqrt(variance_ratio(pieces[ok]))
    return Refined(fitted[:, :2], spread, np.abs(fitted[:, 6]), sigma[:, 1], np.exp(fitted[:, 4]), ok)


def fit(
    grey: Grey,
    uv: Array,
    steps: Array,
    dark: NDArray[np.bool_],
    *,
    radius_px: float,
    blur_px: float,
    zero_zone_px: Zone,
    begin: Array | None = None,
) -> tuple[Array, Array, Array]:
    """Corners where two edges cross, near uv (n, 2): all that `_fit` hands back.

    Args: as `motion.refine` has them; begin (n, 13): where to start, with d and o of `moved_edges`.
    """
    fitted, sigma, pieces = _fit(
        grey,
        np.ascontiguousarray(uv, dtype=np.float64),
        np.ascontiguousarray(steps, dtype=np.float64),
        np.ascontiguousarray(dark, dtype=np.bool_),
        float(radius_px),
        float(blur_px),
        np.empty((0, PARAMETERS)) if begin is None else np.ascontiguousarray(begin),
        zone_of(zero_zone_px),
    )
    return fitted, sigma, pieces


@compiled_part(
    "float64(float64[:, ::1], float64[::1], float64[:, ::1], float64[::1])",
    fastmath={"contract", "reassoc", "arcp", "nsz"},
    forceinline=True,
)
def _linearise(window, p, J, residuals):  # type: ignore[no-untyped-def]
    """Fills J (11, n) and residuals (n,) from the window's u, v and grey, (3, n); returns the sum of squared residuals.

    Without branches or look-ups, so that several pixels are computed at once. `linearise_moved` with its blur alike to
    all sides is the same, and as the one kernel of both would take 1.4 times as long for every picture at rest.
    """
    x, y, m, c, gx, gy = p[0], p[1], p[5], p[6], p[7], p[8]
    ca, sa, cb, sb = math.cos(p[2]), math.sin(p[2]), math.cos(p[3]), math.sin(p[3])
    per_blur, slope = math.exp(-p[4]), math.sqrt(2.0 / math.pi)
    blur = 1.0 / per_blur
    r, turned = ca * cb + sa * sb, sa * cb - ca * sb
    skew = per_blur * per_blur * per_blur / 6.0
    total = 0.0
    for k in range(len(residuals)):
        dx, dy = window[0, k] - x, window[1, k] - y
        ta, tb = (ca * dy - sa * dx) * per_blur, (cb * dy - sb * dx) * per_blur
        ea, bell_a = step_and_bell(SQRT_HALF * ta)
        eb, bell_b = step_and_bell(SQRT_HALF * tb)
        ga, gb = slope * bell_a, slope * bell_b
        qa, qb = ta * ta - 1.0, tb * tb - 1.0
        both = ga * gb
        series = r + r * r * (0.5 * ta * tb + r / 6.0 * qa * qb)
        skew_a, skew_b = -skew * qa * ga, -skew * qb * gb
        shape = ea * eb + both * series
        by_ka, by_kb = c * skew_a * eb, c * skew_b * ea
        residual = window[2, k] - (m + gx * dx + gy * dy + c * shape + p[9] * by_ka + p[10] * by_kb)
        residuals[k] = residual
        total += residual * residual
        # Slopes by t_a and t_b, and by r; those of the k's terms are left out, as small as these are.
        wa = c * per_blur * (ga * eb + both * (r * r * (0.5 * tb + r / 3.0 * ta * qb) - ta * series))
        wb = c * per_blur * (gb * ea + both * (r * r * (0.5 * ta + r / 3.0 * tb * qa) - tb * series))
        by_r = c * both * (1.0 + r * (ta * tb + 0.5 * r * qa * qb)) * turned
        J[0, k] = wa * sa + wb * sb - gx
        J[1, k] = -wa * ca - wb * cb - gy
        J[2, k] = -wa * (ca * dx + sa * dy) - by_r
        J[3, k] = -wb * (cb * dx + sb * dy) + by_r
        J[4, k] = -(wa * ta + wb * tb) * blur
        J[5, k] = 1.0
        J[6, k] = shape
        J[7, k] = dx
        J[8, k] = dy
        J[9, k] = by_ka
        J[10, k] = by_kb
    return total


@compiled_part(
    "float64(float64[:, ::1], float64[::1], float64[::1], float64[:, ::1], float64[::1], float64[:, ::1], "
    "float64[::1])",
    forceinline=True,
)
def _normal_equations(window, p, prior, J, residuals, JtJ, Jtr):  # type: ignore[no-untyped-def]
    """Fills JtJ (p, p) and Jtr (p,); returns the cost. prior (2,): the noise's variance over that of each k."""
    cost = _linearise(window, p, J, residuals) if len(p) == PARAMETERS else linearise_moved(window, p, J, residuals)
    products(J, residuals, JtJ, Jtr)
    for i in range(THIRD_MOMENTS):
        k = PARAMETERS - THIRD_MOMENTS + i
        JtJ[k, k] += prior[i]
        Jtr[k] -= prior[i] * p[k]
        cost += prior[i] * p[k] * p[k]
    return cost


@compiled_part("float64(float64, float64)")
def _together(angle, length):  # type: ignore[no-untyped-def]
    """What is left of an effect of where an edge in direction `angle` falls between pixels, over its length, px."""
    along, across = abs(math.cos(angle)), abs(math.sin(angle))
    # The first harmonic holds nearly all of such effects' variance; its mean over so many periods is a sinc.
    crossed = length * min(along, across)
    return abs(math.sin(math.pi * crossed) / (math.pi * crossed)) if crossed > 1e-3 else 1.0


@compiled_part("float64(float64[::1], float64, float64)")
def _aliased(p, left_a, left_b):  # type: ignore[no-untyped-def]
    """Variance of the corner per axis, px^2, by what pixels do not show of edges as sharp as they are."""
    sine = math.sin(p[2] - p[3])
    lines = 0.5 * (ALIASED_PX * math.exp(-2.0 * math.pi**2 * math.exp(2.0 * p[4]))) ** 2
    return 0.5 * lines * (left_a * left_a + left_b * left_b) / max(sine * sine, 1e-6)


@compiled_part("int64(uint8[:, ::1], float64[::1], float64[::1], float64, float64[::1], float64[:, ::1])")
def window_around(grey, centre, step, radius, zero, window):  # type: ignore[no-untyped-def]
    """Fills u, v and grey (3, count) of the pixels within the window around a centre; returns their count."""
    h, w = grey.shape
    det = step[0] * step[3] - step[1] * step[2]
    count = 0
    if det == 0.0:  # a corner so alone that the grid's directions are not known there
        return count
    for v in range(max(int(centre[1] - radius), 0), min(int(centre[1] + radius) + 2, h)):
        for u in range(max(int(centre[0] - radius), 0), min(int(centre[0] + radius) + 2, w)):
            dx, dy = u - centre[0], v - centre[1]
            if abs(dx) < zero[0] and abs(dy) < zero[1]:
                continue
            a = (dx * step[3] - dy * step[2]) / det
            b = (dy * step[0] - dx * step[1]) / det
            if abs(a) <= WINDOW and abs(b) <= WINDOW and dx * dx + dy * dy <= radius * radius:
                window[0, count], window[1, count], window[2, count] = u, v, grey[v, u]
                count += 1
    return count


@compiled_part("void(float64[::1], float64[::1], float64[::1], boolean, float64, float64[::1])")
def _start(values, centre, step, dark, blur, p):  # type: ignore[no-untyped-def]
    """Fills p, 0 before: edges along the grid's directions, brightness from the window's grey values."""
    p[0], p[1] = centre[0], centre[1]
    p[2], p[3], p[4] = math.atan2(step[1], step[0]), math.atan2(step[3], step[2]), math.log(blur)
    total, low, high = 0.0, np.inf, -np.inf
    for value in values:
        total += value
        low, high = min(low, value), max(high, value)
    p[5] = total / len(values)
    # Between the axes d_a > 0 and d_b < 0: there the model is dark when c is above 0.
    p[6] = 0.5 * (high - low) * (1.0 if dark else -1.0)


@compiled_part(
    "float64(float64[:, ::1], float64[::1], float64, float64, float64[::1], float64[:, ::1])", forceinline=True
)
def _descend(window, p, most_blur, small_step, prior, JtJ):  # type: ignore[no-untyped-def]
    """Levenberg-Marquardt on p, in place; fills J^T J there; returns the sum of squared residuals."""
    n, m = window.shape[1], len(p)
    Jtr, trial_JtJ, trial_Jtr = np.empty(m), np.empty((m, m)), np.empty(m)
    J, residuals = np.empty((m, n)), np.empty(n)
    L, delta, trial = np.empty((m, m)), np.empty(m), np.empty(m)
    for i in range(m):
        trial[i] = p[i]
    cost, damping, moved, promised = np.inf, 1e-3, np.inf, 0.0
    # The equations stand in one place of the loop, for they are compiled as often as they stand there.
    for step in range(MOST_STEPS + 1):
        trial_cost = _normal_equations(window, trial, prior, J, residuals, trial_JtJ, trial_Jtr)
        if step == 0 or trial_cost < cost:
            cost = trial_cost
            for i in range(m):
                p[i], Jtr[i] = trial[i], trial_Jtr[i]
                for j in range(m):
                    JtJ[i, j] = trial_JtJ[i, j]
            damping *= 0.1 if step > 0 else 1.0
        else:
            damping *= 10.0
            if damping > 1e6 or moved < 0.1 * SMALL_STEP_PX:
                break
        if step == MOST_STEPS:
            break
        factor(JtJ, damping, L)
        solve(L, Jtr, delta)
        promised = 0.0
        for i in range(m):
            trial[i] = p[i] + delta[i]
            promised += delta[i] * Jtr[i]
        trial[4] = min(max(trial[4], LEAST_LOG_BLUR), math.log(most_blur))
        for i in range(PARAMETERS, m):
            trial[i] = min(max(trial[i], -MOST_STRETCH), MOST_STRETCH)
        moved = abs(delta[0]) + abs(delta[1])
        if moved < small_step and promised < SMALL_GAIN * cost:
            # What such a step changes in J is less than what there is to say about it.
            for i in range(m):
                p[i] = trial[i]
            cost -= promised
            break
    return cost


@compiled_part("void(float64[:, ::1], float64[::1], float64[:, ::1], float64, float64[:, ::1])", forceinline=True)
def _sum_pieces(window, p, cofactors, variance, sums):  # type: ignore[no-untyped-def]
    """Fills sums (2, 6) of `robust_variance`, of the pieces of either edge."""
    n = window.shape[1]
    J, r, group = np.empty((len(p), n)), np.empty(n), np.empty(n, np.int64)
    if len(p) == PARAMETERS:
        _linearise(window, p, J, r)
    else:
        linearise_moved(window, p, J, r)
    ca, sa, cb, sb = math.cos(p[2]), math.sin(p[2]), math.cos(p[3]), math.sin(p[3])
    furthest = 0
    for k in range(n):
        dx, dy = window[0, k] - p[0], window[1, k] - p[1]
        along_a, along_b = abs(ca * dx + sa * dy), abs(cb * dx + sb * dy)
        # A pixel belongs to the edge that it is nearer to, hence further along.
        edge = 0 if along_a > along_b else 1
        group[k] = 2 * int(max(along_a, along_b) / GROUP_PX) + edge
        furthest = max(furthest, group[k])
    sum_groups(J, r, cofactors, group, furthest + 1, variance, sums)


@compiled(
    "Tuple((float64[:, ::1], float64[:, ::1], float64[:, :, ::1]))(uint8[:, ::1], float64[:, ::1], float64[:, ::1], "
    "boolean[::1], float64, float64, float64[:, ::1], float64[::1])"
)
def _fit(grey, uv, steps, dark, radius, blur, begin, zero):  # type: ignore[no-untyped-def]
    """Parameters (n, m), from where they begin (n, m), m = 13; or m = 11, without the two of `moved_edges`, from uv.

    And (n, 5): standard deviation per axis in px (infinite where it failed) and of grey, taking residuals for noise,
    and cofactors xx, xy, yy of the corner; (n, 2, 6) sums over pieces of edges.
    """
    n, m = len(uv), begin.shape[1]
    fitted, sigma = np.empty((n, m)), np.empty((n, 5))
    side = 2 * int(radius) + 4
    pixels = np.empty((3, side * side))
    JtJ, L = np.empty((m, m)), np.empty((m, m))
    pieces, cofactors, prior = np.empty((n, 2, 6)), np.empty((m, m)), np.empty(2)
    for i in range(n):
        for k in range(6):
            pieces[i, 0, k], pieces[i, 1, k] = 0.0, 0.0
        sigma[i, 0], sigma[i, 1], p, step = np.inf, np.inf, fitted[i], steps[i]
        for k in range(m):
            p[k] = 0.0
        count = window_around(grey, uv[i], step, radius, zero, pixels)
        if count < LEAST_PIXELS + 3 * (m - PARAMETERS):
            p[0], p[1] = uv[i, 0], uv[i, 1]
            continue
        window = np.empty((3, count))
        for k in range(count):
            window[0, k], window[1, k], window[2, k] = pixels[0, k], pixels[1, k], pixels[2, k]
        if len(begin) == 0:
            _start(window[2], uv[i], step, dark[i], blur, p)
        else:
            for k in range(m):
                p[k] = begin[i, k]
        prior[0], prior[1] = 1.0 / (FLAT_PX3 * FLAT_PX3), 1.0 / (FLAT_PX3 * FLAT_PX3)
        cost, variance, left_a, left_b = 0.0, 0.0, 0.0, 0.0
        # First to where it can be told whether the third moments matter, then all the way.
        for stage in range(2):
            if stage > 0:
                length = 2.0 * math.sqrt(count / math.pi)
                left_a, left_b = _together(p[2], length), _together(p[3], length)
                if p[4] > LEAST_LOG_MIXED and max(left_a, left_b) > LEAST_RASTER:
                    deviation_a, deviation_b = max(RASTER_PX3 * left_a, FLAT_PX3), max(RASTER_PX3 * left_b, FLAT_PX3)
                    prior[0], prior[1] = variance / (deviation_a * deviation_a), variance / (deviation_b * deviation_b)
            cost = _descend(window, p, radius, SMALL_STEP_PX if stage > 0 else ROUGH_STEP_PX, prior, JtJ)
            variance = max(cost / (count - m + THIRD_MOMENTS), LEAST_VARIANCE)
        JtJ[4, 4] += variance / LOG_BLUR_SIGMA**2
        for k in range(PARAMETERS, m):
            JtJ[k, k] += variance / LOG_BLUR_SIGMA**2
        factor(JtJ, 0.0, L)
        invert(L, cofactors)
        spread = 0.5 * variance * (cofactors[0, 0] + cofactors[1, 1]) + _aliased(p, left_a, left_b)
        # A fit that runs half its window away has left the corner it began at for something else.
        limit = min(WINDOW * min(math.hypot(step[0], step[1]), math.hypot(step[2], step[3])), 0.5 * radius)
        moved = math.hypot(p[0] - uv[i, 0], p[1] - uv[i, 1])
        sigma[i, 1] = math.sqrt(variance)
        sigma[i, 2], sigma[i, 3], sigma[i, 4] = cofactors[0, 0], cofactors[0, 1], cofactors[1, 1]
        # Nor is anything known of one whose deviation is as large.
        if 0.0 < spread < limit * limit and moved < limit and (p[6] > 0.0) == dark[i]:
            sigma[i, 0] = math.sqrt(spread)
            # Sharper edges show too little of their profile to tell a misfit from where they are.
            if p[4] > LEAST_LOG_MIXED:
                _sum_pieces(window, p, cofactors, variance, pieces[i])
    return fitted, sigma, pieces
