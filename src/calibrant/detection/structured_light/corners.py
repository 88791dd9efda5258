"""Corners of a board carried into the projector: its pixel at each, by the decoded pixels around it.

Around a corner the map from camera to projector is smooth: a homography of the board's plane, bent a little by both
lenses. To second order, which holds both,

    q(u) = q0 + S (u - u0) + second-order terms,

fitted to all decoded pixels nearer than the next corner is, weighted by their sigma and to the middle. q0 is the
corner's pixel in the projector and S what an error of u0 makes of it. Blur mixes light across the edges of squares
alike from both sides of a corner, and falls out.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array
from calibrant.data import View
from calibrant.data.observations import Carried
from calibrant.detection.structured_light.decode import Decoded

REACH = 0.45
"""Of the way to the next corner: no other corner's edges come in."""
LEAST_PX, MOST_PX = 5.0, 24.0
"""Of that reach: fewer pixels hold no six terms; farther out the third order begins."""
LEAST_PIXELS = 40
OUTLIER_SIGMAS = 4.0
LEAST_EDGE_SIGMA = 0.02
"""Pixels: no edge is straighter than that between two pixels."""
MOST_CONDITION = 1e10
MOST_SIGMA_PX = 0.5
"""Of a carried corner: what is less certain says less than the corner's own stripe does."""


@dataclass(frozen=True, eq=False)
class LocalMap:
    """q0 (2,), slope (2, 2), sigma of q0, and how many pixels told it."""

    pixel: Array
    slope: Array
    sigma: float
    pixels: int


def carried_view(view: View, decoded: Decoded, *, camera: str, projector: str) -> View | None:
    """The projector's view of the corners that could be carried; None where none could."""
    reach = np.clip(REACH * _next_corner(view.uv), LEAST_PX, MOST_PX)
    found = [local_map(decoded, uv, float(r)) for uv, r in zip(view.uv, reach)]
    keep = np.array([m is not None for m in found], dtype=bool)
    maps = [m for m in found if m is not None]
    if not maps:
        return None
    slope = np.stack([m.slope for m in maps])
    return View(
        view.id,
        view.points[keep],
        np.stack([m.pixel for m in maps]),
        view.point_ids[keep],
        projector,
        moment=view.moment,
        sigma_px=np.array([m.sigma for m in maps]),
        file=view.file,
        carried=Carried(camera, view.uv[keep], slope),
    )


def local_map(decoded: Decoded, at: Array, reach: float) -> LocalMap | None:
    """The map around a place (2,), px, by the pixels within reach; None where they do not tell it."""
    height, width = decoded.known.shape
    x0, y0 = int(max(np.floor(at[0] - reach), 0)), int(max(np.floor(at[1] - reach), 0))
    x1, y1 = int(min(np.ceil(at[0] + reach) + 1, width)), int(min(np.ceil(at[1] + reach) + 1, height))
    if x1 - x0 < 3 or y1 - y0 < 3:
        return None
    rows = []
    for axis in range(2):
        fitted = None
        for places, q, sigma in _told(decoded, axis, (x0, y0, x1, y1)):
            fitted = _fitted((places - at) / reach, q, sigma)
            if fitted is not None:
                break
        if fitted is None:
            return None
        rows.append(fitted)
    (a, sa, na), (b, sb, nb) = rows
    sigma_px = float(np.sqrt((sa**2 + sb**2) / 2))
    if not sigma_px < MOST_SIGMA_PX:
        return None
    return LocalMap(np.array([a[0], b[0]]), np.stack([a[1:3], b[1:3]]) / reach, sigma_px, min(na, nb))


def _told(decoded: Decoded, axis: int, window: tuple[int, int, int, int]) -> Iterator[tuple[Array, Array, Array]]:
    """Places (n, 2), the projector's pixel there along the axis (n,) and its sigma (n,): by the stripes' edges where
    there are any, and by every pixel."""
    x0, y0, x1, y1 = window
    if decoded.edges is not None:
        places, q, sigma = decoded.edges[axis].around(x0, y0, x1, y1)
        yield places, q, np.maximum(sigma, LEAST_EDGE_SIGMA)
    y, x = np.mgrid[y0:y1, x0:x1]
    q = decoded.pixels[y0:y1, x0:x1, axis]
    use = np.isfinite(q)
    yield np.stack([x[use], y[use]], axis=1), q[use].astype(np.float64), decoded.sigma[y0:y1, x0:x1, axis][use]


def _fitted(d: Array, q: Array, sigma: Array) -> tuple[Array, float, int] | None:
    """Coefficients, sigma of the first, and pixels used: least squares without what does not belong.

    Args: d (n, 2), places from the corner over the reach; q (n,); sigma (n,). None where they do not tell the terms.
    """
    inside = np.sum(d * d, axis=1) < 1
    d, q, sigma = d[inside], q[inside], sigma[inside]
    weight = np.exp(-np.sum(d * d, axis=1)) / sigma.astype(np.float64) ** 2
    terms = np.stack([np.ones(len(d)), d[:, 0], d[:, 1], d[:, 0] ** 2, d[:, 0] * d[:, 1], d[:, 1] ** 2], axis=1)
    use = np.ones(len(q), dtype=bool)
    for _ in range(4):
        if use.sum() < LEAST_PIXELS:
            return None
        root = np.sqrt(weight[use])
        A = terms[use] * root[:, None]
        N = A.T @ A
        if np.linalg.cond(N) > MOST_CONDITION:
            return None
        c = np.linalg.solve(N, A.T @ (root * q[use]))
        r = q - terms @ c
        spread = 1.4826 * float(np.median(np.abs(r[use])))
        keep = np.abs(r) <= OUTLIER_SIGMAS * max(spread, LEAST_EDGE_SIGMA)
        if np.array_equal(keep, use):
            break
        use = keep
    root = np.sqrt(weight[use])
    A = terms[use] * root[:, None]
    # Weights fall to the middle: the scatter of q0 is that of the weighted sum itself.
    pick = np.linalg.solve(A.T @ A, (A * root[:, None]).T)[0]
    left = q[use] - terms[use] @ c
    return c, float(np.sqrt(np.sum(pick**2 * left**2) * len(left) / max(len(left) - 6, 1))), int(use.sum())


def _next_corner(uv: Array) -> Array:
    """Distance (n,) to the nearest other point."""
    if len(uv) < 2:
        return np.full(len(uv), MOST_PX)
    gaps = np.linalg.norm(uv[:, None] - uv[None], axis=-1)
    np.fill_diagonal(gaps, np.inf)
    return np.asarray(gaps.min(axis=1))
