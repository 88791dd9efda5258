"""Disparity of a rectified pair: which pixel of the right picture shows what one of the left shows, and how sure.

A matcher (OpenCV's semi-global one, or any callable) gives the disparity to about a third of a pixel, in steps that
prefer whole ones. Where both directions agree, it is refined by least squares of grey values over a window W,

    min over (d, b) of sum_W (L(u, v) - R(u - S d0(u, v) - d, v) - b)^2,    d0 <- S d0 + d,

S the mean over the window, so that slanted surfaces keep their slope. With g = dR/du, noise of grey values makes

    sigma_d^2 = c s^2 / sum_W g^2,    s^2 = sum_W r^2 / (n_W - 2).

c holds what interpolation and the repeated smoothing do to noise, and is measured. d0 follows a surface but for
(1 - S)^2 d0, of the fourth order in its bends, so that the scatter of this over the picture, away from the ends of what
is matched, is noise. With a window a half wider it is the noise but for its slow part; that is what the same steps
leave of noise alone, with the same gradients, times what S (1 - S)^2 d0 of the picture is to that of noise alone.
Errors of interpolation are quicker than noise, so that one of the two does not do.

Where (1 - S)^2 d is more than noise the surface breaks. The steps end at d = S D / (1 - S + S^2) of a surface D, off by
(1 - S)^2 D / (1 - S + S^2), of which (1 - S)^2 d shows the part that S lets through: at a crease a seventeenth of its
square, and so much more adds to sigma^2; or, where that is more, what the window is off its plane.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array, Grey, Mask
from calibrant.errors import InputError
from calibrant.opencv import cv2

Matcher = Callable[[Grey, Grey], NDArray[np.floating]]
"""From rectified pictures (h, w), left and right, 8 bits, to the disparity (h, w) of the left one's pixels, u_left -
u_right px, NaN where there is none."""
WINDOW = 9
"""Side of the window, px: 81 grey values tell a disparity of textured surfaces to some hundredths of a pixel."""
AGREE_PX = 1.0
"""Both directions agree within this: a matcher's steps are a sixteenth, its errors at steps of depth are many."""
AGREED_PX = AGREE_PX / np.sqrt(3.0)
"""1 sigma of a disparity of which no more is known than that both directions agree within `AGREE_PX`, evenly spread."""
ROUNDED = 2 / 12
"""Variance of the difference of two grey values that are whole numbers."""
HELD = 0.1
"""Part of a surface that texture must tell for the rest of it to be taken as the matcher filled it in."""
SPECKLE_PX = 100
"""Connected pixels below which a part of one disparity is taken for a chance match."""
FLAT_PX = 0.5
"""sigma of a disparity from which nothing was matched: the window holds no texture."""
_JUMP_PX = 0.3
"""RMS of a window's disparities about a plane from which it holds two surfaces."""
_WRONG = 4.0
"""Times the usual variance of grey values that a window's may be: beyond, half of it shows other things."""
_ITERATIONS = 4
_FARTHEST_PX = 1.5
"""A refinement that goes farther has left what was matched."""
CHI2_1_MEDIAN = 0.4549
"""Median of the square of a normal variable."""
CREASE = 9.0
"""Square of what the refinement errs by at a crease over that of what smoothing leaves out, summed across it: both are
linear in the surface, and the refinement's own equations come to 8 to 10.6 over textures and directions."""
_BENDS = 8.0
"""Times the usual variance of a window's disparities about a plane, from which it holds an edge or a bend: noise alone,
on the gradients of three textures, stays below 5 in 999 of 1000 windows; from 8 on most is the surface's."""
_NEAR = 5
"""Side of a window, px, over which what smoothing leaves out at a crease is a tenth of its height and more."""
_SURE = 3.0
"""Times its usual mean square over that window from which what smoothing leaves out is no noise alone."""
_WIDE = 13
"""Side of the window, px, beyond whose reach noise is slow."""
_ENOUGH = 20
"""Windows' worth of pixels that tell a median."""
LEAST_PX = 1e-3
"""Beyond it no picture tells."""


@dataclass(frozen=True, eq=False)
class Disparity:
    """d (h, w), px, NaN where nothing is known; sigma (h, w), px; confidence (h, w), 0 to 1: how well both directions,
    and the grey values of the window, agree."""

    d: Array
    sigma: Array
    confidence: Array

    @property
    def known(self) -> Mask:
        """Where there is a disparity (h, w)."""
        return np.asarray(np.isfinite(self.d))


def semi_global(lowest: float, highest: float, *, block: int = 5) -> Matcher:
    """OpenCV's semi-global block matching (Hirschmueller 2008) between two disparities, px.

    Args: block: side of the block, odd px. Raises: InputError for an empty range or an even block.
    """
    if not highest > lowest or block < 1 or block % 2 == 0:
        raise InputError(f"matching takes lowest < highest px and an odd block, got {lowest:g}, {highest:g}, {block}")
    first = int(np.floor(lowest))
    count = 16 * max(1, int(np.ceil((highest - first + 1) / 16)))
    engine = cv2.StereoSGBM.create(
        minDisparity=first,
        numDisparities=count,
        blockSize=block,
        P1=8 * block * block,
        P2=32 * block * block,
        disp12MaxDiff=-1,
        preFilterCap=31,
        uniquenessRatio=5,
        mode=cv2.STEREO_SGBM_MODE_SGBM,
    )

    def match(left: Grey, right: Grey) -> NDArray[np.floating]:
        # Sixteenths of a pixel; what has no match lies below the range.
        found = engine.compute(_wide(left, count + max(0, first)), _wide(right, count + max(0, first))) / 16.0
        found = found[:, count + max(0, first) :]
        return np.where(found >= first, found, np.nan)

    return match


def _wide(image: Grey, more: int) -> Grey:
    """The picture with columns before it: without them the first `more` are not matched."""
    return np.asarray(cv2.copyMakeBorder(image, 0, 0, more, 0, cv2.BORDER_REPLICATE), dtype=np.uint8)


def disparity(left: Array, right: Array, *, matcher: Matcher, valid: tuple[Mask, Mask] | None = None) -> Disparity:
    """Disparity of the left picture's pixels with its uncertainty.

    Args: left, right (h, w): rectified grey values, 0 to 255, in rows; valid (h, w) each: pixels that have a source.
    Raises: InputError for pictures of two sizes, or a matcher that gives another size.
    """
    if left.shape != right.shape or left.ndim != 2:
        raise InputError(f"a rectified pair has two pictures (h, w) of one size, got {left.shape} and {right.shape}")
    greys = [np.clip(np.rint(image), 0, 255).astype(np.uint8) for image in (left, right)]
    forward = np.asarray(matcher(*greys), dtype=np.float64)
    back = np.asarray(matcher(greys[1][:, ::-1].copy(), greys[0][:, ::-1].copy()), dtype=np.float64)[:, ::-1]
    if forward.shape != left.shape or back.shape != left.shape:
        raise InputError(f"the matcher gave disparities {forward.shape} for pictures {left.shape}")
    if valid is not None:
        forward = np.where(valid[0], forward, np.nan)
        back = np.where(valid[1], back, np.nan)
    apart = _apart(forward, back)
    with np.errstate(invalid="ignore"):
        start = np.where(np.abs(apart) <= AGREE_PX, forward, np.nan)
    start = _without_speckles(start)
    if not np.isfinite(start).any():
        empty = np.full(left.shape, np.nan)
        return Disparity(empty, empty, np.zeros(left.shape))
    return _refined(left, right, start, apart)


def _apart(forward: Array, back: Array) -> Array:
    """What the disparity of a pixel and that of its match differ by, (h, w), NaN where one is not known."""
    h, w = forward.shape
    column = np.arange(w) - forward
    inside = np.isfinite(column) & (column >= 0) & (column <= w - 1)
    at = np.where(inside, np.rint(np.where(inside, column, 0)), 0).astype(np.int64)
    return np.where(inside, forward - back[np.arange(h)[:, None], at], np.nan)


def _without_speckles(d: Array) -> Array:
    known = np.isfinite(d)
    steps = np.where(known, np.rint(16 * d), -(2**15 - 1)).astype(np.int16)
    cv2.filterSpeckles(steps, -(2**15 - 1), SPECKLE_PX, 16)
    return np.where(steps > -(2**15 - 1), d, np.nan)


def _refined(left: Array, right: Array, start: Array, apart: Array) -> Disparity:
    from scipy.ndimage import spline_filter1d

    coefficients = spline_filter1d(right, order=3, axis=1, mode="mirror")
    # Pixels that stand alone without a match do not cost those around them.
    found = np.isfinite(start)
    known = cv2.morphologyEx(found.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8)) > 0
    near = _mean(found.astype(np.float64))
    filled = _mean(np.where(found, start, 0.0)) / np.maximum(near, 1e-9)
    start = np.where(found, start, np.where(known, filled, np.nan))
    d = np.where(known, start, 0.0)
    for _ in range(_ITERATIONS):
        step, s2, gg, g = _step(left, coefficients, base := _smooth(d, known), known)
        d = np.where(known, base + step, 0.0)
    unit = s2 / np.maximum(gg, 1e-9)
    usual = _usual(s2, gg, unit, known)
    whole = found & (_mean(known.astype(np.float64)) > 1 - 0.5 / WINDOW**2)
    with np.errstate(invalid="ignore"):
        kept = whole & (np.abs(d - start) <= _FARTHEST_PX) & (unit <= FLAT_PX**2) & (s2 <= _WRONG * usual)
        off = _off_plane(np.where(known, d, 0.0), known)
        kept &= off <= _JUMP_PX
        agreement = 1 / (1 + (apart / AGREE_PX) ** 2)
        confidence = agreement / np.maximum(s2 / usual, 1.0)
    smooth = _away_from_ends(kept)
    sigma = _sigma(d, unit, off, (known, kept, smooth), _of_noise(g, gg, known))
    # Where the window has no texture of its own, what both directions agree on is all that is known.
    coarse = whole & ~kept & (_off_plane(np.where(known, start, 0.0), known) <= AGREED_PX)
    coarse &= _held(kept, kept | coarse)
    by_matcher = _smooth(start, known)
    alike = unit <= FLAT_PX**2
    sigma = np.where(coarse, _of_matcher(start, by_matcher, d, known, smooth, alike), sigma)
    d = np.where(coarse, by_matcher, d)
    confidence = np.where(coarse, agreement / 2, confidence)
    kept = np.isfinite(_without_speckles(np.where(kept | coarse, d, np.nan)))
    return Disparity(
        np.where(kept, d, np.nan), np.where(kept, sigma, np.nan), np.where(kept, np.clip(confidence, 0, 1), 0.0)
    )


def _held(sure: Mask, all_of_it: Mask) -> Mask:
    """Connected parts (h, w) of a mask of which `HELD` and more is sure: where nothing is, a matcher's answer is its
    own invention."""
    count, labels = cv2.connectedComponents(all_of_it.astype(np.uint8))
    sizes = np.bincount(labels.ravel(), minlength=count)
    shares = np.bincount(labels[sure], minlength=count) / np.maximum(sizes, 1)
    return np.asarray(all_of_it & (shares >= HELD)[labels])


def _usual(s2: Array, gg: Array, unit: Array, known: Mask) -> Array:
    """The variance of grey values (h, w) that textured windows have: noise, and a part that grows with the gradients,
    as rows that are off and other lights make it."""
    textured = known & (unit <= FLAT_PX**2)
    if not textured.any():
        return np.full(s2.shape, max(float(np.median(s2[known])), 1e-12))
    g2 = gg / WINDOW**2
    share = float(np.median((s2 / np.maximum(g2, 1e-12))[textured]))
    return np.maximum((np.median(s2[textured]) + share * g2) / 2, 1e-12)


def _smooth(d: Array, known: Mask, window: int = WINDOW) -> Array:
    """The mean of the window's known disparities (h, w), 0 where none is asked for."""
    share = np.maximum(_mean(known.astype(np.float64), window), 1e-9)
    return np.where(known, _mean(np.where(known, d, 0.0), window) / share, 0.0)


def _left_out(d: Array, known: Mask, window: int = WINDOW) -> Array:
    """(1 - S)^2 d: what smoothing leaves out of a surface."""
    once = _smooth(d, known, window)
    return d - 2 * once + _smooth(once, known, window)


def _of_noise(g: Array, gg: Array, known: Mask) -> tuple[Array, Array]:
    """The refinement (h, w) of noise of variance 1 on the gradients g, and its variance but for a factor."""
    noise = np.where(known, np.random.default_rng(0).standard_normal(g.shape), 0.0)
    n = np.maximum(_sum(known.astype(np.float64)), 3.0)
    mean = _sum(g) / n
    d = np.zeros(g.shape)
    for _ in range(_ITERATIONS):
        base = _smooth(d, known)
        r = np.where(known, noise - g * base, 0.0)
        step = (_sum(g * r) - mean * _sum(r)) / np.maximum(gg, 1e-9)
        d = np.where(known, base + step, 0.0)
    return d, 1 / np.maximum(gg, 1e-9)


def _away_from_ends(kept: Mask) -> Mask:
    """Pixels (h, w) around which all is kept that goes into the noise; all, where these are few."""
    side = 2 * (_WIDE - 1) + WINDOW
    inner = cv2.erode(kept.astype(np.uint8), np.ones((side, side), np.uint8), borderValue=0) > 0
    return np.asarray(inner if inner.sum() >= _ENOUGH * WINDOW**2 else kept)


def _sigma(d: Array, unit: Array, off: Array, where: tuple[Mask, Mask, Mask], noise: tuple[Array, Array]) -> Array:
    """1 sigma (h, w) from variances `unit` but for one factor, from what smoothing leaves out of d, and where a window
    is no plane from how far it is `off` one.

    where: d is known, is kept, and is away from the ends of what is kept; noise: as `_of_noise` gives it.
    """
    known, kept, smooth = where
    if not smooth.any():
        return np.full(unit.shape, np.nan)

    def scatter(x: Array, of: Array) -> float:
        return float(np.median((x * x / np.maximum(of, 1e-18))[smooth])) / CHI2_1_MEDIAN

    whole, of = noise
    quick, quick_noise = _left_out(d, known, _WIDE), _left_out(whole, known, _WIDE)
    slow = scatter(_smooth(quick, known), unit) / max(scatter(_smooth(quick_noise, known), of), 1e-18)
    factor = scatter(quick, unit) + slow * max(scatter(whole, of) - scatter(quick_noise, of), 0.0)
    left_out = _left_out(d, known)
    near = _smooth(left_out**2, kept, _NEAR)
    breaks = CREASE * np.maximum(near - _SURE * scatter(left_out, unit) * unit, 0.0)
    usual = float(np.median((off**2 / np.maximum(unit, 1e-18))[smooth]))
    # Smoothed again and again, an edge reaches a pixel beyond its window.
    off = np.asarray(cv2.dilate(off, np.ones((3, 3), np.uint8)))
    breaks = np.maximum(breaks, np.where(off**2 > _BENDS * usual * unit, off**2, 0.0))
    return np.sqrt(np.maximum(factor * unit + breaks, LEAST_PX**2))


def _of_matcher(start: Array, smoothed: Array, d: Array, known: Mask, smooth: Mask, alike: Mask) -> Array:
    """1 sigma (h, w) of the matcher's own disparities, smoothed: what they differ by from refined ones where there are
    any, and what the window bends by. Where there is no texture, that both directions agree is all that is known."""
    if smooth.sum() < _ENOUGH * WINDOW**2:
        return np.full(start.shape, AGREED_PX)
    apart = np.where(known, smoothed - d, 0.0) ** 2
    bends = np.where(known, start - smoothed, 0.0) ** 2
    off, usual = (float(np.mean(a[smooth])) for a in (apart, bends))
    bends = np.maximum(_smooth(apart, known) - off, 0.0) + np.maximum(_smooth(bends, known) - usual, 0.0)
    return np.where(alike, np.minimum(np.sqrt(off + bends), AGREED_PX), AGREED_PX)


def _step(left: Array, coefficients: Array, base: Array, known: Mask) -> tuple[Array, Array, Array, Array]:
    """The refinement of `base`, s^2, sum_W g^2 about its mean, and g."""
    value, slope = _along_rows(coefficients, np.arange(left.shape[1]) - base)
    use = known.astype(np.float64)
    n = np.maximum(_sum(use), 3.0)
    r = np.where(known, left - value, 0.0)
    g = np.where(known, slope, 0.0)
    # The mean of the window is free: light differs between two cameras.
    r_mean, g_mean = _sum(r) / n, _sum(g) / n
    gg = _sum(g * g) - n * g_mean**2
    gr = _sum(g * r) - n * g_mean * r_mean
    step = np.clip(-gr / np.maximum(gg, 1e-9), -1.0, 1.0)
    left_over = _sum(r * r) - n * r_mean**2 - gr**2 / np.maximum(gg, 1e-9)
    return step, np.maximum(left_over / np.maximum(n - 2, 1.0), ROUNDED), gg, g


def _along_rows(coefficients: Array, column: Array) -> tuple[Array, Array]:
    """The cubic spline of each row, and its slope, at columns (h, w)."""
    h, w = coefficients.shape
    at = np.clip(column, 0, w - 1)
    first = np.floor(at).astype(np.int64)
    t = at - first
    rows = np.arange(h)[:, None]
    value, slope = np.zeros(at.shape), np.zeros(at.shape)
    weights = ((1 - t) ** 3 / 6, (3 * t**3 - 6 * t**2 + 4) / 6, (-3 * t**3 + 3 * t**2 + 3 * t + 1) / 6, t**3 / 6)
    slopes = (-((1 - t) ** 2) / 2, (3 * t**2 - 4 * t) / 2, (-3 * t**2 + 2 * t + 1) / 2, t**2 / 2)
    for k, (a, b) in enumerate(zip(weights, slopes)):
        # Beyond an end the row is its mirror image, as the spline's filter has it.
        j = np.abs(first + k - 1)
        c = coefficients[rows, np.where(j > w - 1, 2 * (w - 1) - j, j)]
        value += a * c
        slope += b * c
    return value, slope


def _off_plane(d: Array, known: Mask) -> Array:
    """RMS of a window's disparities about the plane that fits them (h, w), the window taken as full."""
    half = WINDOW // 2
    steps = np.arange(-half, half + 1, dtype=np.float64)
    n = np.maximum(_mean(known.astype(np.float64)), 1e-9)
    mean = _mean(d) / n
    there, use = np.where(known, d, 0.0), known.astype(np.float64)
    # sum (k d) over the window by a kernel; its variance along one axis is (W^2 - 1) / 12.
    moment = (WINDOW**2 - 1) / 12
    kx = np.outer(np.ones(WINDOW), steps) / WINDOW**2
    # About the mean of this window, not each pixel about that of its own, which follows a slope and hides it.
    slopes = [(_filtered(there, k) - mean * _filtered(use, k)) / moment for k in (kx, kx.T)]
    square = _mean(np.where(known, d * d, 0.0)) / n - mean**2
    return np.sqrt(np.maximum(square - moment * (slopes[0] ** 2 + slopes[1] ** 2), 0.0))


def _filtered(a: Array, kernel: Array) -> Array:
    return np.asarray(cv2.filter2D(a, -1, kernel, borderType=cv2.BORDER_CONSTANT))


def _sum(a: Array, window: int = WINDOW) -> Array:
    return np.asarray(cv2.boxFilter(a, -1, (window, window), normalize=False, borderType=cv2.BORDER_CONSTANT))


def _mean(a: Array, window: int = WINDOW) -> Array:
    return _sum(a, window) / window**2
