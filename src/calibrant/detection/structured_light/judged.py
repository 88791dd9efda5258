"""What a capture is asked where the board is: how much of it was decoded, and what spoils the light.

decoded     share of the board's pixels whose projector pixel is known
direct      light straight from the projector, of all of it: less where things light each other, or stripes blur
saturated   share of pixels that white light drives to the end of their range
bend        what a half-lit pixel is brighter than half, of the light: 0 where the camera answers in proportion;
            for cosines the second harmonic over the first
alike       correlation of neighbouring pixels' noise: 0 for a sensor's own pixels, more where a picture was resampled
stripes     scatter of the stripes' widths over their mean, of one-pixel stripes, with those that are missing: a
            projector that resamples its picture (keystone, scaling) shows some twice and some not at all
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Mask
from calibrant.detection.structured_light.capture import Capture, Picture
from calibrant.detection.structured_light.decode import Decoded
from calibrant.detection.structured_light.edges import Edges
from calibrant.opencv import cv2

FULL = 254
"""Grey level from which a pixel may be saturated."""
WIDE_PX = 1.3
"""Camera pixels a stripe must be wide for its width to be measured."""
FEWEST_STRIPES = 24
ENOUGH_EDGES = 12
"""Edges of a stripe whose mean width counts."""


@dataclass(frozen=True)
class CaptureFigures:
    """See above; None where a capture cannot tell. `sigma_px`: of the typical decoded pixel; noise: grey levels."""

    decoded: float
    direct: float
    saturated: float
    sigma_px: float
    noise: float
    bend: float
    alike: float | None = None
    stripes: float | None = None


def capture_figures(capture: Capture, decoded: Decoded, board: Mask) -> CaptureFigures:
    """The figures of a capture over the board (h, w)."""
    known = decoded.known & board
    whole = np.maximum(decoded.light.whole, 1.0)
    bright = board & (whole > 0.5 * float(np.quantile(whole[board], 0.9)))
    sigma = decoded.sigma[known] if known.any() else np.array([[np.inf, np.inf]])
    stripes = (
        []
        if decoded.edges is None
        else [
            float(np.hypot(w, np.sqrt(_skipped(decoded, axis, board))))
            for axis, e in enumerate(decoded.edges)
            if (w := _widths(e, board)) is not None
        ]
    )
    return CaptureFigures(
        decoded=float(known.sum() / board.sum()),
        direct=float(np.median((decoded.light.direct / whole)[bright])),
        saturated=float((capture.white[board] >= FULL).mean()),
        sigma_px=float(np.sqrt(np.median(sigma**2))),
        noise=float(np.median(decoded.light.sigma[board])),
        bend=_bend(capture, bright),
        alike=_alike(capture, bright),
        stripes=max(stripes, default=None),
    )


def board_mask(uv: Picture, shape: tuple[int, int]) -> Mask:
    """The hull of a board's corners (n, 2) in a picture (h, w)."""
    out = np.zeros(shape, dtype=np.uint8)
    hull = cv2.convexHull(np.rint(uv).astype(np.int32))
    cv2.fillConvexPoly(out, hull, 1)
    return np.asarray(out > 0)


def _bend(capture: Capture, bright: Mask) -> float:
    sequence = capture.sequence
    if sequence.code != "gray":
        shots = capture.shifted("x", sequence.periods("x")[-1])[:, bright].astype(np.float32)
        if len(shots) < 5:
            return 0.0
        turn = 2 * np.pi * np.arange(len(shots)) / len(shots)
        first, second = (np.abs(np.tensordot(np.exp(-1j * k * turn), shots, axes=1)) for k in (1, 2))
        return float(np.median(second / np.maximum(first, 1e-6)))
    white, black = capture.white[bright].astype(np.float32), capture.black[bright].astype(np.float32)
    out = 0.0
    for axis in "xy":
        bit, inverse = capture.pairs(axis)[-1]
        one, two = bit[bright].astype(np.float32), inverse[bright].astype(np.float32)
        half = np.abs(one - two) < 0.3 * (white - black)
        if half.sum() > ENOUGH_EDGES:
            off = float(np.median(((one + two - white - black) / (white - black))[half]))
            out = max(out, off, key=abs)
    return out


def _alike(capture: Capture, bright: Mask) -> float | None:
    """Correlation of what I + I' differs by from its mean, between neighbours along the rows; None for cosines."""
    pairs = capture.pairs("x")
    if len(pairs) < 4:
        return None
    # Coarse bits: their edges are few.
    sums = np.stack([b.astype(np.float32) + i for b, i in pairs[:4]])
    left = sums - sums.mean(axis=0)
    inside = bright[:, 1:] & bright[:, :-1]
    if not inside.any():
        return None
    a, b = left[:, :, :-1][:, inside], left[:, :, 1:][:, inside]
    a, b = a - a.mean(axis=1, keepdims=True), b - b.mean(axis=1, keepdims=True)
    limit = 4 * float(np.median(np.abs(a))) + 1e-6
    use = (np.abs(a) < limit) & (np.abs(b) < limit)
    return float(np.sum((a * b)[use]) / max(np.sqrt(np.sum(a[use] ** 2) * np.sum(b[use] ** 2)), 1e-9))


def _widths(edges: Edges, board: Mask) -> float | None:
    """Scatter of the stripes' mean widths over the widths of those around them; None where they are too narrow."""
    name = max(edges.t, key=lambda n: int(np.isfinite(edges.t[n][board]).sum()))
    t, q = edges.t[name], edges.pixel[name]
    if name == "down":
        t, q, board = t.T, q.T, board.T
    y, x = np.nonzero(np.isfinite(t) & board)
    if len(y) < FEWEST_STRIPES * ENOUGH_EDGES:
        return None
    place, edge = x + t[y, x], q[y, x]
    beside = (np.diff(y) == 0) & (np.abs(np.diff(edge)) == 1)
    width = np.diff(place)[beside]
    stripe = np.rint((edge[1:] + edge[:-1])[beside] / 2).astype(np.int64)
    stripe -= stripe.min()
    count = np.bincount(stripe)
    total = np.bincount(stripe, weights=width)
    mean = np.where(count >= ENOUGH_EDGES, total / np.maximum(count, 1), np.nan)
    if np.isfinite(mean).sum() < FEWEST_STRIPES or np.nanmedian(mean) < WIDE_PX:
        return None
    around = np.array(
        [np.nanmedian(mean[max(k - 8, 0) : k + 9]) if np.isfinite(mean[k]) else np.nan for k in range(len(mean))]
    )
    return float(np.nanstd(mean / around))


def _skipped(decoded: Decoded, axis: int, board: Mask) -> float:
    """Share of the steps between neighbours that pass over a stripe."""
    number = np.where(board, np.rint(decoded.pixels[..., axis]), np.nan)
    one, two = 0, 0
    for along in (0, 1):
        step = np.abs(np.diff(number, axis=along))
        one, two = one + int(np.sum(step == 1)), two + int(np.sum(step == 2))
    return two / max(one + two, 1)
