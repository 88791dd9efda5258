"""Corners of blurred markers: their edges against those of the same marker drawn there, its code known, as blurred.

Blur of a fifth of a cell and more carries the code's light cells into the border of ink, and what lies beyond the quiet
zone into the paper: no stretch of a profile then shows ink or paper alone, as `quad_edges` needs it. So the marker is
drawn where it was found, blurred and put into pixels as the picture is, and a profile v across an edge compared with
the drawing's m at the same places,

    v(x) = a + b m(x - d) + e m_s(x) + h z(x),     m(x - d) = m - d m',     m_s = s m'' = dm/ds of the blur s,

with a, e, h and b, linear along the side, of each side and d of each profile; z is a step at the end of the narrowest
quiet zone. Lines and their crossings are those of `quad_edges`, less certain by what a, b, e and h leave open; each
drawing takes the corners, the blur and the slope of the light from the one before.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array, Grey
from calibrant.detection.tags import quad_edges
from calibrant.opencv import cv2

ERF = np.vectorize(math.erf, otypes=[np.float64])
"""Of the few values of a marker: SciPy's takes longer to load than a picture to search."""
DRAWINGS = 6
"""At most; two or three are the rule."""
STILL = 0.5
"""Of a corner's sigma: when none moved further, the next drawing would move it by a fifth of that."""
BLURRED_CELLS = 0.15
"""Blur over a cell from which markers are drawn: a border's middle is then nearer than three sigmas to its sides."""
BLUR_PX = (0.2, 0.6)
"""The least blur, of a pixel's own kind, and the most in cells: no code is read through more."""
INWARDS_CELLS = 1.5
"""How far profiles go into the marker: through the border and half of the first cells, which show paper as well."""
OUTWARDS_CELLS = 1.0
"""The narrowest quiet zone; profiles end CLEAR sigmas of blur before it does, where it is wider than NEAR of them."""
CLEAR, NEAR, FAR = 2.0, 1.2, 4.0
FINE_PX = 0.5
"""Of the blur: the drawing's pixels, which are not sharper themselves."""
MOST_FINE = 4
"""Pixels of the drawing a pixel of the picture at most, along either axis."""


def refine_drawn(
    grey: Grey, corners: Array, sigma_px: Array, cells: NDArray[np.bool_], square: int
) -> tuple[Array, Array]:
    """Corners (n, 4, 2) px and their sigma_px (n, 4): of blurred markers against their drawings, of others as given.

    Args: corners, sigma_px: from `quad_edges.refine_quads`; cells (n, k, k): true where a marker is light, with what is
    printed around its square; square: how many of the k cells the square is wide.
    """
    uv, sigma = corners.copy(), sigma_px.copy()
    seen = np.isfinite(sigma).all(axis=1)
    if not seen.any():
        return uv, sigma
    cell = quad_edges.depth(uv, np.roll(uv, -1, axis=1) - uv).min(axis=1) / square
    blur = _blur(grey, uv, cell)
    for i in np.flatnonzero(seen & (blur > BLURRED_CELLS * cell)):
        uv[i], sigma[i] = _against_drawings(grey, uv[i], cells[i], square, float(blur[i]))
    return uv, sigma


def _blur(grey: Grey, uv: Array, cell: Array) -> Array:
    """Blur (n,), px, by how steep the mean profile across each side is: step / (slope sqrt(2 pi)), the median side."""
    side = np.roll(uv, -1, axis=1) - uv
    most, blur = np.maximum(0.5 * cell, 1.0), np.full(len(uv), np.inf)
    for _ in range(2):  # samples across half a large cell are too far apart for the slope of a sharp edge
        half = np.broadcast_to(np.clip(FAR * blur, 1.0, most)[:, None], side.shape[:2])
        value = quad_edges.profiles(grey, uv, side, -half, half)[0]
        mean = value.mean(axis=2)
        slope = np.diff(mean, axis=-1).max(axis=-1) * (quad_edges.SAMPLES - 1) / (2.0 * half)
        step = mean.max(axis=-1) - mean.min(axis=-1)
        blur = np.asarray(np.median(step / np.maximum(slope, 1e-6), axis=1)) / np.sqrt(2.0 * np.pi)
    return blur


def _against_drawings(grey: Grey, uv: Array, cells: NDArray[np.bool_], square: int, blur: float) -> tuple[Array, Array]:
    """Corners (4, 2) and sigma (4,) of one marker, infinite where its edges are not as drawn."""
    found, light, ink = uv, np.zeros(2), 0.0
    sigma = np.full(4, np.inf)
    for _ in range(DRAWINGS):
        side = np.roll(uv, -1, axis=0) - uv
        cell = quad_edges.depth(uv[None], side[None])[0] / square
        blur = float(np.clip(blur, BLUR_PX[0], BLUR_PX[1] * cell.min()))
        inwards = np.minimum(INWARDS_CELLS * cell, FAR * blur)
        outwards = np.clip(OUTWARDS_CELLS * cell - CLEAR * blur, NEAR * blur, FAR * blur)
        value, normal = quad_edges.profiles(grey, uv[None], side[None], -inwards[None], outwards[None])
        origin, picture = _drawn(uv, cells, square, blur, float(inwards.max() + outwards.max()), light, ink)
        drawn = quad_edges.profiles(picture, uv[None] - origin, side[None], -inwards[None], outwards[None])[0][0]
        x = -inwards[:, None] + (inwards + outwards)[:, None] * np.linspace(0.0, 1.0, quad_edges.SAMPLES)
        beyond = 0.5 + 0.5 * ERF((x - OUTWARDS_CELLS * cell[:, None]) / (math.sqrt(2.0) * blur))
        step = (x[:, 1] - x[:, 0])[:, None, None]
        slope = np.gradient(drawn, axis=-1) / step
        # A Gaussian's slope by its width is its second derivative times the width.
        by_blur = blur * np.gradient(slope, axis=-1) / step
        sides = _compared(value[0], drawn, slope, by_blur, beyond)
        crossing, spread = quad_edges.crossings(
            uv[None], side[None], normal, sides.offset[None], sides.seen[None], sides.shared[None]
        )
        if not (np.isfinite(crossing).all() and np.isfinite(spread).all()):
            return found, np.full(4, np.inf)
        light = light + _gradient(uv + 0.5 * side, sides.contrast)
        ink = max(float(np.median(sides.dark) / np.median(sides.contrast)) + ink, 0.0)
        moved = np.linalg.norm(crossing[0] - uv, axis=1)
        uv, sigma = crossing[0], spread[0]
        blur += float(np.median(sides.missing))
        if (moved < STILL * sigma).all():
            break
    else:
        # What still moves is not known better than that.
        sigma = np.hypot(sigma, moved)
    return uv, sigma


def _gradient(middle: Array, contrast: Array) -> Array:
    """How much lighter it becomes a pixel (2,), as a part, from the contrasts (4,) at the sides' middles (4, 2)."""
    off = middle - middle.mean(axis=0)
    return np.asarray(np.linalg.lstsq(off, contrast / contrast.mean() - 1.0, rcond=None)[0])


def _drawn(
    uv: Array, cells: NDArray[np.bool_], square: int, blur: float, reach: float, light: Array, ink: float
) -> tuple[Array, NDArray[np.float32]]:
    """The marker on paper without end, 0 to 1: the pixel that the drawing begins at, and the drawing."""
    margin = reach + 4.0 * blur + 2.0
    first = np.floor(uv.min(axis=0) - margin)
    size = (np.ceil(uv.max(axis=0) + margin) - first).astype(int) + 1
    fine = int(np.clip(np.ceil(1.0 / (FINE_PX * blur)), 1, MOST_FINE))
    # As many pixels a cell as the drawing has on its longest side, so that edges are neither stepped nor smoothed.
    longest = np.linalg.norm(np.roll(uv, -1, axis=0) - uv, axis=1).max()
    each = int(np.ceil(fine * longest / square))
    beyond = (cells.shape[0] - square) / 2.0
    art = np.repeat(np.repeat(cells, each, axis=0), each, axis=1).astype(np.float32)
    low, high = beyond * each - 0.5, (beyond + square) * each - 0.5
    of_art = np.array([[low, low], [high, low], [high, high], [low, high]], dtype=np.float32)
    of_picture = (fine * (uv - first) + 0.5 * (fine - 1)).astype(np.float32)
    H = cv2.getPerspectiveTransform(of_art, of_picture)
    width, height = int(size[0]) * fine, int(size[1]) * fine
    sharp = cv2.warpPerspective(art, H, (width, height), flags=cv2.INTER_LINEAR, borderValue=1.0)
    u, v = (
        np.arange(n) / fine + low - middle
        for n, low, middle in zip((width, height), first, uv.mean(axis=0), strict=True)
    )
    sharp = (sharp + np.float32(ink)) * (1.0 + light[0] * u[None, :] + light[1] * v[:, None]).astype(np.float32)
    soft = cv2.GaussianBlur(sharp, (0, 0), fine * blur, borderType=cv2.BORDER_REPLICATE)
    return first, np.asarray(cv2.resize(soft, (int(size[0]), int(size[1])), interpolation=cv2.INTER_AREA), np.float32)


@dataclass(frozen=True, eq=False)
class _Sides:
    """offset, seen (4, PROFILES): how far out edges lie from the drawing's, px, and whether they show; dark, contrast
    (4,): grey level of ink that the drawing lacks, and from ink to paper; shared (4,): the factor by which a side's
    line is less sure for its brightness and blur; missing (4,): blur that the drawing lacks, px."""

    offset: Array
    seen: NDArray[np.bool_]
    dark: Array
    contrast: Array
    shared: Array
    missing: Array


def _compared(value: Array, drawn: Array, slope: Array, by_blur: Array, beyond: Array) -> _Sides:
    """A picture's profiles against the drawing's.

    Args: value, drawn, slope, by_blur (4, PROFILES, SAMPLES): grey values, 0 to 1, and its slopes outwards and by blur;
    beyond (4, SAMPLES): the part that lies beyond the quiet zone.
    """
    s = (np.linspace(*quad_edges.ALONG, quad_edges.PROFILES) - 0.5)[:, None]
    shared = np.ones_like(drawn)
    other = [shared, drawn, s * drawn, by_blur, np.broadcast_to(beyond[:, None], drawn.shape)]
    own = [slope, s * slope, s**2 * slope]
    A = np.stack([*other, *own], axis=-1).reshape(4, -1, len(other) + len(own))
    y = value.reshape(4, -1, 1)
    At = np.swapaxes(A, 1, 2)
    size = np.sqrt((A**2).sum(axis=1))
    # In units of each column's size; the small term is for columns that a picture does not show.
    scale = 1.0 / np.maximum(size, 1e-9)
    N = (At @ A) * scale[:, :, None] * scale[:, None, :] + 1e-9 * np.eye(A.shape[2])
    cofactors = np.linalg.inv(N) * scale[:, :, None] * scale[:, None, :]
    p = cofactors @ (At @ y)
    left = (y - A @ p).reshape(drawn.shape)
    p = p[..., 0]
    contrast = p[:, 1, None] + p[:, 2, None] * s[:, 0]
    safe = np.where(np.abs(contrast) > 1e-6, contrast, 1.0)
    k = len(other)
    fitted = p[:, k, None] + p[:, k + 1, None] * s[:, 0] + p[:, k + 2, None] * s[:, 0] ** 2
    offset = -(fitted + (left * slope).sum(axis=2) / np.maximum((slope**2).sum(axis=2), 1e-12)) / safe
    alone = np.linalg.inv(N[:, k:, k:])
    e = np.array([1.0, 0.5, 0.25]) * scale[:, k:]
    least = np.einsum("ka,kab,kb->k", e, alone, e)
    most = np.einsum("a,kab,b->k", np.array([1.0, 0.5, 0.25]), cofactors[:, k:, k:], np.array([1.0, 0.5, 0.25]))
    return _Sides(
        offset,
        contrast > quad_edges.LEAST_STEP,
        p[:, 0],
        p[:, 1],
        np.sqrt(np.maximum(most / np.maximum(least, 1e-30), 1.0)),
        p[:, 3] / np.where(np.abs(p[:, 1]) > quad_edges.LEAST_STEP, p[:, 1], np.inf),
    )
