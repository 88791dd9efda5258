"""The noise of a picture's pixels around a place, whatever edges are there, and what the raster adds on edges."""

from __future__ import annotations

import numpy as np

from calibrant.compiled import compiled_part

ROUNDING = 1.0 / 12.0
"""Variance of the rounding to whole grey levels: no picture has less."""
MIXED = 1.0 / 720.0
"""Pixels that were mixed from others (demosaicing, resizing, blur put on afterwards) hold an edge at a fraction f of a
pixel as the mean of two, with weights f and 1 - f, and are blurred by that: I + f (1 - f) I'' / 2. Over all f the
factor of I'' varies by a quarter of the variance of f (1 - f), 1/180."""


@compiled_part("float64(uint8[:, ::1], int64, int64, int64)")
def noise_variance(grey, u0, v0, half):  # type: ignore[no-untyped-def]
    """Variance of the pixels' noise within `half` of a place, which lies further than that from the picture's border.

    From second differences along both axes, which vanish on planes and on edges along the axes (J. Immerkaer, Fast
    noise variance estimation, 1996); the median leaves out the edges that slant. Grey levels squared.
    """
    values = np.empty((2 * half + 1) ** 2)
    n = 0
    for v in range(v0 - half, v0 + half + 1):
        for u in range(u0 - half, u0 + half + 1):
            total = 4.0 * grey[v, u]
            total -= 2.0 * (grey[v, u - 1] + float(grey[v, u + 1]) + grey[v - 1, u] + float(grey[v + 1, u]))
            total += grey[v - 1, u - 1] + float(grey[v - 1, u + 1]) + grey[v + 1, u - 1] + float(grey[v + 1, u + 1])
            values[n] = abs(total)
            n += 1
    # The mask has norm 6; the median of a normal variable's absolute value is 0.6745 sigma.
    return max((np.median(values[:n]) / (6.0 * 0.6745)) ** 2, ROUNDING)


@compiled_part("float64(uint8[:, ::1], int64, int64)")
def raster_variance(grey, u, v):  # type: ignore[no-untyped-def]
    """Variance of a pixel's grey value by where edges fall between pixels, grey levels squared; 0 on the border."""
    if u < 1 or v < 1 or u > grey.shape[1] - 2 or v > grey.shape[0] - 2:
        return 0.0
    twice = 2.0 * grey[v, u]
    across = float(grey[v, u - 1]) + float(grey[v, u + 1]) - twice
    down = float(grey[v - 1, u]) + float(grey[v + 1, u]) - twice
    return MIXED * (across * across + down * down)
