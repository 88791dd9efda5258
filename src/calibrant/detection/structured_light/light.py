"""How much light comes straight from the projector, and how noisy the camera is, from the patterns themselves.

A bit and its inverse light every point once: I + I' is the same for all bits, and its scatter over them twice the
noise's variance (for cosines, what is left of the fitted ones). Noise grows with light, sigma^2 = a + b I: a and b are
fitted to the medians of classes of brightness. What comes by way of other surfaces is the same for a fine bit and its
inverse, so that |I - I'| is the direct light alone (Nayar, Krishnan, Grossberg and Raskar 2006, "Fast separation of
direct and global components of a scene using high frequency illumination").
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibrant.detection.structured_light.capture import Capture, Picture

CLASSES = 24
"""Of brightness: each ten grey levels wide."""
FINE_PX = (4.0, 24.0)
"""Widths of stripes in projector pixels that are fine beside what throws light back, and coarse beside the blur."""
LEAST_SIGMA = 0.3
"""Grey levels: what rounding to whole ones leaves (1 / sqrt(12))."""


@dataclass(frozen=True, eq=False)
class Light:
    """sigma (h, w): noise in grey levels; direct (h, w): light straight from the projector, grey levels between a dark
    and a lit stripe; whole (h, w): white less black; spread (h, w): scatter of I + I' over the bits beyond noise."""

    sigma: Picture
    direct: Picture
    whole: Picture

    @property
    def reliability(self) -> Picture:
        """Direct light over the noise of a difference, (h, w)."""
        return np.asarray(self.direct / (np.sqrt(2) * self.sigma))


def light_of(capture: Capture) -> Light:
    """Noise and direct light of every pixel."""
    pairs = capture.pairs("x") + capture.pairs("y")
    mean, variance = _by_pairs(pairs) if pairs else _by_shifts(capture)
    sigma = _noise(mean, variance)
    white, black = capture.white.astype(np.float32), capture.black.astype(np.float32)
    return Light(sigma, _direct(capture), white - black)


def _by_pairs(pairs: list[tuple[Picture, Picture]]) -> tuple[Picture, Picture]:
    """Mean grey level, and variance of one picture, (h, w)."""
    total = np.zeros(pairs[0][0].shape, dtype=np.float32)
    squares = np.zeros_like(total)
    for bit, inverse in pairs:
        s = bit.astype(np.float32) + inverse
        total += s
        squares += s * s
    n = len(pairs)
    return total / (2 * n), np.maximum(squares - total * total / n, 0) / (2 * (n - 1))


def _by_shifts(capture: Capture) -> tuple[Picture, Picture]:
    """The same by what is left of the finest cosines; three shifts leave nothing, and rounding is assumed."""
    axis = "x"
    shots = capture.shifted(axis, capture.sequence.periods(axis)[-1]).astype(np.float32)
    n = len(shots)
    mean, c, s = cosine_sums(shots)
    if n == 3:
        return mean, np.full_like(mean, LEAST_SIGMA**2)
    turn = 2 * np.pi * np.arange(n) / n
    left = np.zeros_like(mean)
    for k in range(n):
        left += (shots[k] - mean - 2 / n * (c * np.cos(turn[k]) + s * np.sin(turn[k]))) ** 2
    return mean, left / (n - 3)


def cosine_sums(shots: Picture) -> tuple[Picture, Picture, Picture]:
    """Mean, sum I_k cos and sum I_k sin (h, w) of n shifted cosines (n, h, w)."""
    turn = 2 * np.pi * np.arange(len(shots)) / len(shots)
    c = np.tensordot(np.cos(turn).astype(np.float32), shots, axes=1)
    s = np.tensordot(np.sin(turn).astype(np.float32), shots, axes=1)
    return shots.mean(axis=0), c, s


def _noise(mean: Picture, variance: Picture) -> Picture:
    """sigma (h, w) with sigma^2 = a + b mean fitted to the medians of classes of brightness."""
    classes = np.minimum((mean / (256 / CLASSES)).astype(np.int64), CLASSES - 1).ravel()
    count = np.bincount(classes, minlength=CLASSES)
    level, typical = [], []
    v = variance.ravel()
    # The median of few squared numbers lies below their mean; the mean of the lower nine tenths hardly does.
    for k in np.flatnonzero(count > 0.002 * len(v)):
        mine = np.sort(v[classes == k])
        level.append((k + 0.5) * 256 / CLASSES)
        typical.append(float(mine[: max(int(0.9 * len(mine)), 1)].mean() / LOWER_NINE))
    if len(level) < 2:
        a, b = (typical or [LEAST_SIGMA**2])[0], 0.0
    else:
        b, a = np.polyfit(level, typical, 1)
        if b < 0:  # a tone curve makes the dark noisiest: no line, but the classes themselves
            variance = np.interp(mean, level, typical)
            return np.sqrt(np.maximum(variance, LEAST_SIGMA**2)).astype(np.float32)
    return np.sqrt(np.maximum(a + b * mean, LEAST_SIGMA**2)).astype(np.float32)


LOWER_NINE = 0.83
"""Mean of the lower nine tenths of chi^2 with twenty degrees of freedom, over the mean of all."""


def _direct(capture: Capture) -> Picture:
    """The median difference of bit and inverse over the fine bits, or twice the finest cosines' amplitude."""
    sequence = capture.sequence
    found = []
    for axis in "xy":
        pairs = capture.pairs(axis)
        for number, (bit, inverse) in enumerate(pairs):
            # Gray code's stripes are twice as wide as the bit's own step.
            width = 2.0 ** (len(pairs) - number)
            if FINE_PX[0] <= width <= FINE_PX[1]:
                found.append(np.abs(bit.astype(np.float32) - inverse))
        if not pairs:
            shots = capture.shifted(axis, sequence.periods(axis)[-1]).astype(np.float32)
            _, c, s = cosine_sums(shots)
            found.append(4 / len(shots) * np.hypot(c, s))
    return np.asarray(np.median(np.stack(found), axis=0), dtype=np.float32)
