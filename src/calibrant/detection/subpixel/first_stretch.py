"""What the first step towards blur along a direction says of a corner fitted without: a question without its answer.

From a fit of the eleven parameters of `saddle`, one step of Gauss-Newton on the model of `moved_edges`,

    delta = (J^T J)^-1 J^T r,

is as large in d and o as where a fit ends, to a tenth up to rho = 1 and less far beyond: the model is nearly linear in
them. Angles, blur, brightness and contrast change with them. Place, slope of light and third moments stay: their terms
are odd about the corner, those of d and o are even, and in a window around it they tell nothing of each other. So it
costs one pass over the window and seven unknowns, in place of a fit's eight passes with thirteen.
"""

from __future__ import annotations

import numpy as np

from calibrant.arrays import Array, Grey
from calibrant.compiled import compiled
from calibrant.detection.subpixel.moved_edges import linearise_moved
from calibrant.detection.subpixel.normal_equations import factor, products, solve
from calibrant.detection.subpixel.refined import Zone, zone_of
from calibrant.detection.subpixel.saddle import LEAST_PIXELS, PARAMETERS, window_around

MOVED_PARAMETERS = PARAMETERS + 2
EVEN = np.array([2, 3, 4, 5, 6, PARAMETERS, PARAMETERS + 1])
"""Which of them are even about the corner: angles, log s, m, c, d and o."""


def first_stretches(
    grey: Grey, fitted: Array, uv: Array, steps: Array, *, radius_px: float, zero_zone_px: Zone
) -> Array:
    """d and o (n, 2) after one step from corners fitted (n, 11) by `saddle.fit` near uv (n, 2); NaN where the window is
    too small for them. steps (n, 4), radius_px and zero_zone_px as there."""
    found: Array = _first_stretches(
        grey,
        np.ascontiguousarray(fitted),
        np.ascontiguousarray(uv, dtype=np.float64),
        np.ascontiguousarray(steps, dtype=np.float64),
        float(radius_px),
        zone_of(zero_zone_px),
    )
    return found


@compiled("float64[:, ::1](uint8[:, ::1], float64[:, ::1], float64[:, ::1], float64[:, ::1], float64, float64[::1])")
def _first_stretches(grey, fitted, uv, steps, radius, zero):  # type: ignore[no-untyped-def]
    """d and o (n, 2), NaN where there is no such step."""
    n, m, even = len(uv), MOVED_PARAMETERS, len(EVEN)
    found = np.empty((n, 2))
    side = 2 * int(radius) + 4
    pixels, p = np.empty((3, side * side)), np.empty(m)
    JtJ, L, Jtr, delta = np.empty((even, even)), np.empty((even, even)), np.empty(even), np.empty(even)
    for i in range(n):
        found[i, 0], found[i, 1] = np.nan, np.nan
        count = window_around(grey, uv[i], steps[i], radius, zero, pixels)
        if count < LEAST_PIXELS + 3 * (m - PARAMETERS):
            continue
        window, J, residuals = np.empty((3, count)), np.empty((m, count)), np.empty(count)
        for k in range(count):
            window[0, k], window[1, k], window[2, k] = pixels[0, k], pixels[1, k], pixels[2, k]
        for k in range(m):
            p[k] = fitted[i, k] if k < PARAMETERS else 0.0
        linearise_moved(window, p, J, residuals)
        some = np.empty((even, count))
        for row in range(even):
            for k in range(count):
                some[row, k] = J[EVEN[row], k]
        products(some, residuals, JtJ, Jtr)
        factor(JtJ, 0.0, L)
        solve(L, Jtr, delta)
        found[i, 0], found[i, 1] = delta[even - 2], delta[even - 1]
    return found
