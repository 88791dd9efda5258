"""Noise of pictures, compiled: one pass over the pixels where NumPy would take ten."""

from __future__ import annotations

import numpy as np
from numba import types

from calibrant.compiled import compiled

_bytes = types.uint8[::1]
_floats = types.Array(types.float32, 1, "C", readonly=True)
_picture = types.Array(types.float32, 2, "C", readonly=True)
_f4 = types.float32


@compiled(types.void(_bytes, _floats, _floats))
def add_noise(picture, sigma, numbers):  # type: ignore[no-untyped-def]
    """picture (n,) + sigma[picture] * numbers, in place, rounded to 0..255; sigma (256,) by grey."""
    for i in range(picture.size):
        grey = picture[i]
        value = np.float32(grey) + sigma[grey] * numbers[i] + np.float32(0.5)
        picture[i] = np.uint8(min(np.float32(255.0), max(np.float32(0.0), value)))


@compiled(types.void(types.Array(types.float32, 2, "C"), _picture, _f4, _f4))
def to_metres(out, raw, near, far):  # type: ignore[no-untyped-def]
    """Depth of a reversed buffer (1 at the near plane, 0 at the far one) whose first row is the lowest."""
    rows, columns = raw.shape
    for r in range(rows):
        for c in range(columns):
            out[rows - 1 - r, c] = near * far / (near + raw[r, c] * (far - near))


@compiled(types.void(types.Array(types.float32, 2, "C"), _picture))
def bend(out, disparity):  # type: ignore[no-untyped-def]
    """The larger of the second differences along rows and columns: 0 on any plane, the step's height beside a step."""
    rows, columns = disparity.shape
    for r in range(rows):
        above, below = max(r - 1, 0), min(r + 1, rows - 1)
        inside = np.float32(0 < r < rows - 1)
        for c in range(columns):
            down = inside * abs(disparity[above, c] - 2 * disparity[r, c] + disparity[below, c])
            across = np.float32(0)
            if 0 < c < columns - 1:
                across = abs(disparity[r, c - 1] - 2 * disparity[r, c] + disparity[r, c + 1])
            out[r, c] = max(down, across)


@compiled(
    types.void(
        types.Array(types.float32, 2, "C"), _picture, _picture, _picture, types.Array(types.boolean, 2, "C"),
        _floats, _floats, types.Array(types.float32, 1, "C", readonly=True),
    )
)  # fmt: skip
def measure_depth(out, disparity, near_spread, wide_spread, sure, smooth, white, figures):  # type: ignore[no-untyped-def]
    """Depth (h, w) as it is measured, NaN where there is none; see `sensors.noisy_depth`.

    near_spread, wide_spread: the step of disparity beside a pixel, within the window; sure (h / 4, w / 4):
    where the window loses; smooth, white (h w,): normal numbers; figures: focal times baseline, largest disparity,
    offset, step of the disparity that spoils a window, sigma, quantum of disparity, the number beyond which a pixel is
    a hole, unit of depth.
    """
    fb, largest, offset, step, sigma, quantum, hole, unit = figures
    half, nothing = np.float32(0.5), np.float32(np.nan)
    rows, columns = disparity.shape
    per_quantum, per_unit = np.float32(1) / quantum, np.float32(1) / unit
    hidden = np.empty(columns, dtype=np.bool_)
    for r in range(rows):
        least = np.float32(np.inf)
        for c in range(columns - 1, -1, -1):
            at = np.float32(c) - disparity[r, c]
            hidden[c] = at >= least
            least = min(least, at)
        if largest == np.float32(np.inf):
            hidden[:] = False
        for c in range(columns):
            hidden[c] = hidden[c] | ((wide_spread[r, c] > step) & sure[r // 4, c // 4])
        first = r * columns
        for c in range(columns):
            d = disparity[r, c]
            measured = d + offset + sigma * smooth[first + c]
            measured = np.floor(measured * per_quantum + half) * quantum
            z = np.floor(fb / measured * per_unit + half) * unit
            lost = (d > largest) | (near_spread[r, c] > step) | (white[first + c] > hole) | (measured <= 0)
            out[r, c] = nothing if lost | hidden[c] else z
