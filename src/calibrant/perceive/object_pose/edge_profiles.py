"""Edges of an outline to a fraction of a pixel: blurred steps fitted to the profiles across it.

Beside the outline lies often a narrow strip, a side of the object seen at a grazing angle, darker or brighter than its
top, and the half-way point is then no longer the edge. Where the strip is w wide by the expected pose,

    g(s) = T Phi(-(s + w - e) / b) + S [Phi((s + w - e) / b) - Phi((s - e) / b)] + O Phi((s - e) / b)

with the levels of top, strip and outside, the blur b and the edge's place e. Neighbouring samples are averaged into
pieces first; levels are linear, e and b are searched.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array, Mask
from calibrant.opencv import cv2
from calibrant.perceive.object_pose.outline_edges import LEAST_CONTRAST
from calibrant.perceive.object_pose.rendered import Silhouette

PIECE = 6
"""Samples a piece: 9 pixels of an edge, straight enough for any lens."""
REACH_PX = 3.0
_STEP = 0.5
_TRIED = np.linspace(-REACH_PX, REACH_PX, 41)
_BLURS = np.array([0.35, 0.6, 0.9, 1.4])
_STRIP_LEVEL, _STRIP_SPREAD = 0.75, 0.4
"""Of a strip's brightness, the top's being 1: lambertian sides of things lit from above have 0.35 to 1.1."""
MODEL_ERROR = 0.05
"""Of the contrast: what sRGB's curve makes a blurred step differ from the model's by."""
LEAST_SIGMA_PX = 0.05
"""Of a piece: pixels that integrated nothing would be off by 0.29 px each, 0.1 px for nine; Bayer patterns, and lenses
that blur by less than a pixel, are half way there."""
_WORST_SIGMA_PX = 0.7


@dataclass(frozen=True, eq=False)
class Pieces:
    """Edges of pieces of an outline. sample (k,): the outline's sample in its middle; off (k,), sigma (k,): px along
    the outward normal; asked: how many pieces were looked for."""

    sample: NDArray[np.int64]
    off: Array
    sigma: Array
    asked: int


def measure_edges(image: NDArray[Any], outline: Silhouette) -> Pieces:
    """Where the edges of an outline are that is expected within `REACH_PX` pixels. Args: image (h, w, 3), float32."""
    piece = _pieces(outline.side)
    middle = np.array([np.flatnonzero(piece == k)[np.sum(piece == k) // 2] for k in range(piece.max(initial=-1) + 1)])
    if len(middle) == 0:
        return Pieces(np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros(0), 0)
    s = np.arange(-4 * REACH_PX, 2 * REACH_PX + _STEP / 2, _STEP)
    at = (outline.uv[:, None] + s[:, None] * outline.outward[:, None]).astype(np.float32)
    colours = cv2.remap(image, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    colours = colours.reshape(len(at), len(s), -1).astype(np.float64)
    height, width = image.shape[:2]
    whole = ((at >= 0) & (at <= (width - 1, height - 1)))[:, s >= -REACH_PX].all(axis=(1, 2))
    count = np.bincount(piece, minlength=len(middle))
    mean = np.zeros((len(middle), *colours.shape[1:]))
    np.add.at(mean, piece, colours)
    mean /= count[:, None, None]
    off, sigma = _places(mean, s, outline.strips[middle], outline.seconds[middle])
    complete = np.bincount(piece, weights=whole, minlength=len(middle)) == count
    keep = np.isfinite(off) & complete
    return Pieces(middle[keep], off[keep], sigma[keep], len(middle))


def _pieces(side: NDArray[np.int64]) -> NDArray[np.int64]:
    """Number (n,) of each sample's piece: neighbours of one side, `PIECE` of them."""
    if len(side) == 0:
        return np.zeros(0, dtype=np.int64)
    new = np.concatenate([[True], side[1:] != side[:-1]])
    start = np.flatnonzero(new)[np.cumsum(new) - 1]
    within = np.arange(len(side)) - start
    return np.cumsum(new | (within % PIECE == 0)) - 1


def _places(profiles: Array, s: Array, strips: Array, seconds: Array) -> tuple[Array, Array]:
    """Places and sigmas (k,), px, of the edges in profiles (k, m, 3); NaN where there is none."""
    inward = np.minimum(2 * REACH_PX + np.minimum(strips, 2 * REACH_PX), np.maximum(seconds - 1, 2.0))
    use = s >= -inward[:, None]
    inner = use & (s < -REACH_PX / 2)
    outside = profiles[:, s > REACH_PX].mean(axis=1)
    # Deep inside the level is the top's, or that of a broad strip.
    inside = np.einsum("kmc,km->kc", profiles, inner / np.maximum(inner.sum(axis=1), 1)[:, None])
    d = inside - outside
    contrast = np.linalg.norm(d, axis=1)
    g = np.einsum("kmc,kc->km", profiles - outside[:, None], d) / np.maximum(contrast, 1e-6)[:, None] ** 2
    cost, falls = _costs(g, s, use, np.where(strips < 2 * REACH_PX, strips, np.inf))
    rows = np.arange(len(g))
    best = cost.reshape(len(g), -1).argmin(axis=1)
    b, e = np.unravel_index(best, cost.shape[1:])
    e_in = np.clip(e, 1, len(_TRIED) - 2)
    low, here, high = (cost[rows, b, e_in + k] for k in (-1, 0, 1))
    bend = low - 2 * here + high
    h = _TRIED[1] - _TRIED[0]
    with np.errstate(invalid="ignore", divide="ignore"):
        off = _TRIED[e_in] + 0.5 * h * (low - high) / bend
        level = np.maximum(here / np.maximum(use.sum(axis=1) - 4, 1), (0.5 / contrast) ** 2)
        # Half a pixel apart, neighbours of a profile share half their noise.
        sigma = np.hypot(np.sqrt(4 * level / bend) * h, LEAST_SIGMA_PX)
        good = (e == e_in) & (bend > 0) & falls[rows, b, e] & (contrast >= LEAST_CONTRAST) & (sigma < _WORST_SIGMA_PX)
    return np.where(good & inner.any(axis=1), off, np.nan), sigma


def _costs(g: Array, s: Array, use: Mask, strips: Array) -> tuple[Array, Mask]:
    """Sum of squares (k, blurs, places) with the best levels, and whether those fall outwards."""
    from scipy.special import ndtr

    z = (s - _TRIED[:, None]) / _BLURS[:, None, None]
    beyond = np.broadcast_to(ndtr(z), (len(g), *z.shape))
    edge = ndtr(z + np.where(np.isinf(strips), 1e3, strips)[:, None, None, None] / _BLURS[:, None, None])
    # Where the strip is broad, nothing is seen of the top: its basis is 0, and the prior keeps its level.
    basis = np.stack([1 - edge, edge - beyond, beyond], axis=-1) * use[:, None, None, :, None]
    noise = np.maximum(np.std(g[:, s > REACH_PX], axis=1), MODEL_ERROR)
    ridge = np.where(np.isinf(strips), 0.0, (noise / _STRIP_SPREAD) ** 2)
    A = np.swapaxes(basis, -1, -2) @ basis
    A[..., range(3), range(3)] += 1e-9
    A[..., 1, 1] += ridge[:, None, None]
    right = np.einsum("kbemi,km->kbei", basis, g)
    right[..., 1] += (ridge * _STRIP_LEVEL)[:, None, None]
    levels = np.linalg.solve(A, right[..., None])[..., 0]
    left = np.einsum("kbemi,kbei->kbem", basis, levels) - (g * use)[:, None, None]
    cost = np.sum(left**2, axis=-1) + ridge[:, None, None] * (levels[..., 1] - _STRIP_LEVEL) ** 2
    return cost, levels[..., 1] > levels[..., 2]
