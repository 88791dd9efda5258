"""Edges of Gray code's stripes between neighbouring pixels: where exactly the projector's pixel is n + 1/2.

Whole numbers err by up to half a stripe, all alike where camera and projector pixels are of one size. Between pixels of
numbers n and n + 1 exactly one bit changes, and m = (I - I') / direct light goes through zero where the stripe ends:

    u = u_1 + t (u_2 - u_1),    t = a_1 / (a_1 - a_2),    a = erf^-1(m)

for neighbours to the right and below: a blurred edge is an error function of the distance from it. Divided by the
direct light, a change of the print's grey does not move it. sigma_t follows from sigma(m) = sqrt(2) sigma / direct.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import erfinv

from calibrant.detection.structured_light.capture import Picture
from calibrant.detection.structured_light.light import Light
from calibrant.patterns.sequence import gray_code

Pairs = list[tuple[Picture, Picture]]
MOST_PART = 0.95
"""Of the direct light: beyond, noise decides how far away the edge seems."""
SHIFTS = {"right": (0, 1), "down": (1, 0)}


@dataclass(frozen=True, eq=False)
class Edges:
    """Of one axis, by direction of the neighbour: t (h, w) from each pixel, NaN where no stripe ends, its sigma, and
    the projector's pixel n + 1/2 there."""

    t: dict[str, Picture]
    sigma: dict[str, Picture]
    pixel: dict[str, Picture]

    def around(self, x0: int, y0: int, x1: int, y1: int) -> tuple[Picture, Picture, Picture]:
        """Places (n, 2), projector pixels (n,) and sigmas (n,), camera px, of the edges within a window."""
        places, pixels, sigmas = [], [], []
        for name, (down, right) in SHIFTS.items():
            t = self.t[name][y0:y1, x0:x1]
            y, x = np.nonzero(np.isfinite(t))
            along = t[y, x]
            places.append(np.stack([x + x0 + right * along, y + y0 + down * along], axis=1))
            pixels.append(self.pixel[name][y0:y1, x0:x1][y, x])
            sigmas.append(self.sigma[name][y0:y1, x0:x1][y, x])
        return tuple(np.concatenate(p).astype(np.float64) for p in (places, pixels, sigmas))  # type: ignore[return-value]


def stripe_edges(pairs: Pairs, number: Picture, known: Picture, light: Light) -> Edges:
    """The edges of all stripes. Args: pictures of bits and inverses, coarsest first; decoded numbers (h, w), whole."""
    t, sigma, pixel = {}, {}, {}
    for name, (down, right) in SHIFTS.items():
        t[name], sigma[name], pixel[name] = _between(pairs, number, known, light, down=down, right=right)
    return Edges(t, sigma, pixel)


def _between(
    pairs: Pairs, number: Picture, known: Picture, light: Light, *, down: int, right: int
) -> tuple[Picture, Picture, Picture]:
    h, w = number.shape
    a, b = np.s_[: h - down, : w - right], np.s_[down:, right:]
    beside = known[a] & known[b] & (np.abs(number[a] - number[b]) == 1)
    bit = np.zeros(beside.shape, dtype=np.int32)
    changed = gray_code(number[a].astype(np.int64)) ^ gray_code(number[b].astype(np.int64))
    bit[beside] = np.log2(changed[beside]).astype(np.int32)
    t = np.full((h, w), np.nan, dtype=np.float32)
    sigma, pixel = np.full_like(t, np.nan), np.full_like(t, np.nan)
    for k, (shown, inverse) in enumerate(pairs):
        y, x = np.nonzero(beside & (bit == len(pairs) - 1 - k))
        one, two = (y, x), (y + down, x + right)
        m, level = [], []
        for at in (one, two):
            direct = np.maximum(light.direct[at], 1.0)
            part = np.clip((shown[at].astype(np.float32) - inverse[at]) / direct, -MOST_PART, MOST_PART)
            m.append(erfinv(part))
            level.append(np.sqrt(np.pi / 2) * np.exp(m[-1] ** 2) * light.sigma[at] / direct)
        gap = m[0] - m[1]
        share = m[0] / np.where(gap == 0, 1.0, gap)
        t[one] = share
        sigma[one] = np.hypot((1 - share) * level[0], share * level[1]) / np.maximum(np.abs(gap), 1e-6)
        pixel[one] = (number[one] + number[two]) / 2
    return t, sigma, pixel
