"""Maps from a flat board to the image that hold nearby: one homography a place, fitted to the points around it.

A lens bends a board, but little within two squares; so a homography of its own at every corner follows a wide lens
where a single one for the board does not. All places are fitted in one batch.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array

# Fitted to this many nearest points: enough for 8 unknowns with some to average over, few enough to stay local.
NEIGHBOURS = 16
# Points weigh exp(-d^2 / (2 s^2)) at d squares: next to nothing beyond three squares.
REACH_SQUARES = 1.2
# Prior of the perspective terms: the scale of a board changes by about a tenth from square to square at most. It keeps
# them quiet where the points do not determine them.
PERSPECTIVE_SIGMA = 0.1
# A prediction is of use when twice its sigma stays within a quarter of a square: the next corner is a square away.
DETERMINED_SQUARES = 0.12


@dataclass(frozen=True, eq=False)
class LocalMaps:
    """Homographies at n places: (dx, dy) squares from the place -> pixels.

    u = u0 + (h0 dx + h1 dy + h2) / (1 + h6 dx + h7 dy), v likewise with h3, h4, h5. h (n, 8); origin_px (n, 2);
    sigma_px (n,): standard deviation of a place's pixel per axis, from the points' own; large where they say little.
    """

    h: Array
    origin_px: Array
    sigma_px: Array

    @property
    def centres(self) -> Array:
        """Pixels of the places themselves, (n, 2)."""
        return self.origin_px + self.h[:, [2, 5]]

    @property
    def px_per_square(self) -> Array:
        """Derivatives of pixels by squares at the places, (n, 2, 2)."""
        h = self.h
        along_u = h[:, 0:2] - h[:, 2:3] * h[:, 6:8]
        along_v = h[:, 3:5] - h[:, 5:6] * h[:, 6:8]
        return np.stack([along_u, along_v], axis=1)

    @property
    def square_px(self) -> Array:
        """Side of a square at the places, (n,): the root of its area, pixels."""
        return np.sqrt(np.abs(np.linalg.det(self.px_per_square)))

    @property
    def determined(self) -> NDArray[np.bool_]:
        """Whether the points around a place fix its map, (n,)."""
        return self.sigma_px < DETERMINED_SQUARES * self.square_px

    def pixels(self, offsets: Array) -> Array:
        """Pixels (n, m, 2) of the offsets (m, 2) or (n, m, 2), squares, from each place."""
        dx, dy = np.moveaxis(np.broadcast_to(offsets, (len(self.h), *offsets.shape[-2:])), -1, 0)
        h = self.h[:, :, None]
        # Beyond the horizon a place has no pixel; such points land far outside the image and fail there.
        w = np.maximum(1.0 + h[:, 6] * dx + h[:, 7] * dy, 1e-3)
        uv = np.stack([h[:, 0] * dx + h[:, 1] * dy + h[:, 2], h[:, 3] * dx + h[:, 4] * dy + h[:, 5]], axis=-1)
        return self.origin_px[:, None] + uv / w[..., None]

    def subset(self, keep: NDArray[np.bool_]) -> LocalMaps:
        """The maps where keep (n,) is true."""
        return LocalMaps(self.h[keep], self.origin_px[keep], self.sigma_px[keep])


def fit_local_maps(places: Array, xy: Array, uv: Array, sigma_px: Array) -> LocalMaps:
    """Weighted least-squares homography at each place from the nearest known points, never from the place's own.

    Rows [dx dy 1 0 0 0 -u dx -u dy] h = u (and v), weighted by exp(-d^2 / 2 s^2) / sigma^2, with a prior on h6, h7.
    Leaving out a place's own point makes the map a prediction that the point can be checked against.
    Args: places (n, 2) squares; xy (m, 2) squares and uv (m, 2) px of the known points with sigma_px (m,).
    """
    n, k = len(places), min(NEIGHBOURS, len(xy))
    offsets = xy[None] - places[:, None]
    distance2 = np.einsum("nmi,nmi->nm", offsets, offsets)
    nearest = np.argpartition(distance2, k - 1, axis=1)[:, :k] if k < len(xy) else np.tile(np.arange(k), (n, 1))
    d = np.take_along_axis(offsets, nearest[..., None], axis=1)
    d2 = np.take_along_axis(distance2, nearest, axis=1)
    weight = np.exp(-0.5 * d2 / REACH_SQUARES**2) / sigma_px[nearest] ** 2
    weight[d2 < 1e-12] = 0.0
    return LocalMaps(*_solve_local(d, uv[nearest], weight))


def _solve_local(d: Array, uv: Array, weight: Array) -> tuple[Array, Array, Array]:
    n, k = weight.shape
    total = np.maximum(weight.sum(axis=1), 1e-300)
    origin = np.einsum("nk,nki->ni", weight, uv) / total[:, None]
    centred = uv - origin[:, None]
    A = np.zeros((n, k, 2, 8))
    A[:, :, 0, 0:2] = A[:, :, 1, 3:5] = d
    A[:, :, 0, 2] = A[:, :, 1, 5] = 1.0
    A[:, :, :, 6:8] = -centred[..., :, None] * d[..., None, :]
    # Batched products, as einsum spends more on planning these small sums than on adding them.
    rows = A.reshape(n, 2 * k, 8)
    weighted_t = np.swapaxes(rows * np.repeat(weight, 2, axis=1)[..., None], 1, 2)
    N = weighted_t @ rows
    g = (weighted_t @ centred.reshape(n, 2 * k, 1))[..., 0]
    N[:, 6, 6] += 1.0 / PERSPECTIVE_SIGMA**2
    N[:, 7, 7] += 1.0 / PERSPECTIVE_SIGMA**2
    # Points on one line leave a direction open: this gives it a sigma of 1000 px instead of a division by zero.
    N[:, np.arange(6), np.arange(6)] += 1000.0**-2
    cofactors = np.linalg.inv(N)
    h = (cofactors @ g[..., None])[..., 0]
    sigma = np.sqrt(np.maximum(cofactors[:, 2, 2], cofactors[:, 5, 5]))
    return h, origin, sigma
