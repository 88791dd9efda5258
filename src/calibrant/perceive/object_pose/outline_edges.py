"""Where a picture has the edges of an expected outline: the half-way point between inside and outside.

Across every sample of the outline the colours are read along its normal. With c_in and c_out, the means of the inner
and of the outer part, g = (c - c_out) . (c_in - c_out) / |c_in - c_out|^2 runs from 1 to 0, and blur that is alike to
both sides leaves g = 1/2 on the edge.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array, Mask
from calibrant.opencv import cv2
from calibrant.perceive.object_pose.rendered import Silhouette

STEP_PX = 0.5
LEAST_CONTRAST = 12.0
"""Of 255: less than five times the usual noise of two or three grey levels, and the half-way point is noise's."""
FAR = 3.5
"""Robust sigmas from the other edges of the same side: what is farther is another edge (a shadow, a print)."""
EDGE_BIAS_PX = 0.06
"""What all edges of one side may be off by together, beside what all sides have in common: under sRGB's curve the
half-way points of sides of brightness 0.35 to 1 differ by 0.12 px where the blur has 0.6 px."""
STRIP_BIAS_PX, THIN_STRIP_BIAS_PX = 0.12, 0.25
"""The same of a side beside a strip that is seen at a grazing angle: its own shade is not known, and where the strip is
hardly wider than the blur (`THIN_PX`), shade and place of its edge are told apart by a few per cent of contrast."""
THIN_PX = (0.3, 1.5)
COMMON_BIAS_PX = 0.3
"""What all edges of an object may be off outwards: sRGB's curve moves the half-way point of a blurred step between
dark and bright by up to half of the blur's sigma, half a pixel as a rule, towards the dark."""

_HARMONICS = np.arange(1, 12)


@dataclass(frozen=True, eq=False)
class Edges:
    """Edges that were found. off (n,): px along the outward normal from where the outline was expected; good (n,)."""

    off: Array
    good: Mask

    @property
    def share(self) -> float:
        """Of the samples that have an edge."""
        return float(self.good.mean()) if len(self.good) else 0.0


def find_edges(image: NDArray[Any], outline: Silhouette, *, reach: float) -> Edges:
    """The edge nearest to every sample of an outline, within `reach` pixels.

    Args: image (h, w, 3) or (h, w), float32.
    """
    if len(outline.uv) == 0:
        return Edges(np.zeros(0), np.zeros(0, dtype=np.bool_))
    n = int(np.ceil(2 * reach / STEP_PX))
    s = np.arange(-n, n + 1) * STEP_PX  # as far again: levels are read beyond the reach
    at = (outline.uv[:, None] + s[:, None] * outline.outward[:, None]).astype(np.float32)
    colours = cv2.remap(image, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    colours = colours.reshape(len(at), len(s), -1).astype(np.float64)
    c_in, c_out = colours[:, s < -reach].mean(axis=1), colours[:, s > reach].mean(axis=1)
    d = c_in - c_out
    contrast = np.linalg.norm(d, axis=1)
    g = np.einsum("nsc,nc->ns", colours - c_out[:, None], d) / np.maximum(contrast, 1e-6)[:, None] ** 2
    off = _crossings(g, np.asarray(s, dtype=np.float64), reach)
    height, width = image.shape[:2]
    inside = ((at >= 0) & (at <= (width - 1, height - 1))).all(axis=(1, 2))
    good = np.isfinite(off) & (contrast >= LEAST_CONTRAST) & inside
    return Edges(np.where(good, off, 0.0), good & with_their_side(off, good, outline.side))


def _crossings(g: Array, s: Array, reach: float) -> Array:
    """Where g (n, m) falls through 1/2, nearest to 0; NaN where it does not within reach."""
    down = (g[:, :-1] >= 0.5) & (g[:, 1:] < 0.5)
    with np.errstate(invalid="ignore", divide="ignore"):
        at = s[:-1] + (g[:, :-1] - 0.5) / (g[:, :-1] - g[:, 1:]) * STEP_PX
    distance = np.where(down, np.abs(at), np.inf)
    best = np.argmin(distance, axis=1)
    rows = np.arange(len(g))
    return np.where(distance[rows, best] <= reach, at[rows, best], np.nan)


def with_their_side(off: Array, good: Mask, side: NDArray[np.int64]) -> Mask:
    """Which of the edges are near those of their own side."""
    out = good.copy()
    for k in np.unique(side[good]):
        mine = good & (side == k)
        x = np.arange(mine.sum(), dtype=np.float64)
        # An edge that turned by a little is off linearly along it.
        left = off[mine] - (np.polyval(np.polyfit(x, off[mine], 1), x) if len(x) > 4 else np.median(off[mine]))
        left -= np.median(left)
        limit = FAR * max(float(np.median(np.abs(left))) / 0.6745, 0.05)
        out[np.flatnonzero(mine)[np.abs(left) > limit]] = False
    return out


def side_bias(strips: Array, broad: float) -> Array:
    """Sigma (n,), px, of what a side is off by as a whole, by the width of the strip beside it, px; from `broad` on it
    is a side like others."""
    thin = (strips > THIN_PX[0]) & (strips < THIN_PX[1])
    strip = (strips >= THIN_PX[1]) & (strips < broad)
    return np.where(thin, THIN_STRIP_BIAS_PX, np.where(strip, STRIP_BIAS_PX, EDGE_BIAS_PX))


def sampling_bias(outward: Array, length: Array, step: float) -> Array:
    """Sigma (n,), px, of what the pixels' grid makes straight edges err by as a whole, along their normal.

    Sampled without averaging, an edge of slope m = tan(angle to the nearer axis) is a staircase: off by a sawtooth of
    period 1 / m along it. Over all phases the mean over N columns has the variance

        cos^2(angle) sum_h 1 / (2 pi^2 h^2) (sin(pi h m N) / (N sin(pi h m)))^2,

    1/12 along an axis (the sawtooth's series, Dirichlet's kernel). Args: outward (n, 2), unit; length (n,), px; step:
    between samples, px.
    """
    if step <= 0:
        return np.zeros(len(length))
    small, large = np.sort(np.abs(outward), axis=-1).T
    m, count = small / large, np.maximum(length * large / step, 1.0)
    h = _HARMONICS
    below = count[:, None] * np.sin(np.pi * h * m[:, None])
    above = np.sin(np.pi * h * m[:, None] * count[:, None])
    # Where the slope is a whole number of a harmonic, all columns err alike.
    kernel = np.divide(above, below, out=np.ones_like(above), where=np.abs(below) > 1e-9)
    variance = np.sum(np.minimum(kernel**2, 1.0) / (2 * np.pi**2 * h**2), axis=1)
    return np.asarray(step * large * np.sqrt(variance), dtype=np.float64)
