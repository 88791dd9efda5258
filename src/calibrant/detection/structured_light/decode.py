"""Which projector pixel lights a camera's pixel, with its sigma: by the bits, by the cosines, or by both.

Gray code: bit k is d_k = I_k - I'_k > 0, wrong with the chance P_k = Q(|d_k| / (sqrt(2) sigma)). A wrong bit moves
the number by D_k, one pixel next to a stripe's edge and many elsewhere, so that

    q = n + sum P_k D_k,    sigma_q^2 = 1/12 + sum P_k (1 - P_k) D_k^2,

1/12 of a stripe one pixel wide. But a bit that is told nearby and in doubt here, next to D_k = 1, is at its edge: there
q is known best, and the bit takes (1 - 2 P_k)^2 of the stripe's own.

Cosines: phi = atan2(sum I_k sin, sum I_k cos) of amplitude B tells q within a period,

    sigma_q = p / (2 pi) sqrt(2 / n) sigma / B,

and which period by the next coarser one, or by the bits, where that is told apart by five sigmas.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import erfc

from calibrant.arrays import Mask
from calibrant.detection.structured_light.capture import Capture, Picture
from calibrant.detection.structured_light.edges import Edges, stripe_edges
from calibrant.detection.structured_light.light import Light, cosine_sums, light_of
from calibrant.opencv import cv2

LEAST_RELIABILITY = 4.0
"""Direct light over the noise of a difference: a bit is then wrong once in thirty thousand."""
MOST_SIGMA = 1.0
"""Pixels: a number that is less certain names no pixel."""
APART = 5.0
"""Sigmas by which the coarser phase must tell periods apart: once in two million it does not."""
RIM = 3.0
"""Pixels at the picture's edge: beyond it there is no light, and blur moves what is found inwards."""
STEP_VARIANCE = 1 / 12
EDGE_SIGMA = 0.1
"""Pixels: how well a stripe's edge is told by one pixel on it, of light that changes over one pixel by most of it."""
NEAR, RESOLVED = 5, 12.0
"""A bit is told nearby where, in so many pixels each way, it differs from its inverse by so many sigmas."""


@dataclass(frozen=True, eq=False)
class Decoded:
    """pixels (h, w, 2): the projector's pixel, NaN where it is not known; sigma (h, w, 2); light of the capture.

    edges: of the stripes along x and along y, where bits alone tell the pixels. beyond: (x, y) shares of the clearly
    lit pixels whose numbers the projector does not have.
    """

    pixels: Picture
    sigma: Picture
    light: Light
    edges: tuple[Edges, Edges] | None = None
    beyond: tuple[float, float] = (0.0, 0.0)

    @property
    def known(self) -> Mask:
        """Where the projector's pixel is known, (h, w)."""
        return np.asarray(np.isfinite(self.pixels[..., 0]))


def decode(capture: Capture) -> Decoded:
    """The projector's pixel at every pixel of a capture."""
    light = light_of(capture)
    found = [_along(capture, axis, light) for axis in "xy"]
    pixels = np.stack([q for q, _, _ in found], axis=-1)
    sigma = np.stack([s for _, s, _ in found], axis=-1)
    size = np.array(capture.sequence.projector_size)
    good = (light.reliability > LEAST_RELIABILITY) & (sigma < MOST_SIGMA).all(axis=-1)
    beyond = [float((pixels[good][:, k] >= size[k]).mean()) if good.any() else 0.0 for k in range(2)]
    good &= (pixels >= RIM).all(axis=-1) & (pixels <= size - 1 - RIM).all(axis=-1)
    pixels[~good] = np.nan
    edges = None
    if capture.sequence.code == "gray":
        x, y = (stripe_edges(capture.pairs(a), n, good, light) for a, (_, _, n) in zip("xy", found))
        edges = (x, y)
    return Decoded(pixels, sigma, light, edges, (beyond[0], beyond[1]))


def _along(capture: Capture, axis: str, light: Light) -> tuple[Picture, Picture, Picture]:
    """Pixel, sigma and whole number (h, w) along one axis."""
    sequence = capture.sequence
    periods = sequence.periods(axis)
    number = np.zeros((0, 0), dtype=np.int32)
    if sequence.code != "phase":
        q, sigma, number = by_bits(capture.pairs(axis), light.sigma)
    else:
        q, sigma = by_cosine(capture.shifted(axis, periods[0]), periods[0], light.sigma)
        q = np.where(q > (sequence.side(axis) - 1 + periods[0]) / 2, q - periods[0], q)
        periods = periods[1:]
    for period in periods:
        fine, fine_sigma = by_cosine(capture.shifted(axis, period), period, light.sigma)
        told = APART * np.hypot(sigma, fine_sigma) < period / 2
        q = fine + period * np.rint((q - fine) / period)
        sigma = np.where(told, fine_sigma, np.float32(np.inf))
    return q, sigma, number


def by_bits(pairs: list[tuple[Picture, Picture]], sigma: Picture) -> tuple[Picture, Picture, Picture]:
    """Pixel, sigma and whole number (h, w) of Gray code by each bit's picture and its inverse's, coarsest first."""
    n = len(pairs)
    number = np.zeros(sigma.shape, dtype=np.int32)
    last = np.zeros_like(number)
    doubts = []
    for bit, inverse in pairs:
        d = bit.astype(np.float32) - inverse
        last = last ^ (d > 0)
        number = 2 * number + last
        seen = cv2.dilate(np.abs(d), np.ones((NEAR, NEAR), dtype=np.uint8)) > RESOLVED * sigma
        doubts.append((0.5 * erfc(np.abs(d) / (2 * sigma)), seen))
    q, beside = number.astype(np.float32), np.ones(sigma.shape, dtype=np.float32)
    variance = np.zeros(sigma.shape, dtype=np.float32)
    for k, (chance, seen) in enumerate(doubts):
        moved = ((number ^ ((1 << (n - k)) - 1)) - number).astype(np.float32)
        q += chance * moved
        edge = seen & (np.abs(moved) == 1)
        beside *= np.where(edge, (1 - 2 * chance) ** 2, 1)
        variance += np.where(edge, 0, chance * (1 - chance) * moved * moved)
    return q, np.sqrt(variance + np.maximum(STEP_VARIANCE * beside, EDGE_SIGMA**2)), number


def by_cosine(shots: Picture, period: float, sigma: Picture) -> tuple[Picture, Picture]:
    """Pixel in 0 … period and sigma (h, w) by n shifted pictures (n, h, w) of a cosine."""
    n = len(shots)
    _, c, s = cosine_sums(shots.astype(np.float32))
    q = np.mod(np.arctan2(s, c), 2 * np.pi) * period / (2 * np.pi)
    amplitude = np.maximum(2 / n * np.hypot(c, s), 1e-6)
    return q, np.asarray(period / (2 * np.pi) * np.sqrt(2 / n) * sigma / amplitude)
