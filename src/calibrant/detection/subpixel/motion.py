"""Corners of pictures taken on the move: less certain along the motion than across it.

Edges across the motion are smeared, those along it are not: a corner of such a picture is known worse one way than the
other, and a model of blur alike to all sides finds neither where it is nor how certain. So a few corners are asked
whether a blur that is wider along a direction would fit them better (`first_stretch`); where they nearly share one,
they are fitted with it (`moved_edges`); where they do share one, all are. The covariance of a corner is then the fit's,
variance (J^T J)^-1, each edge's share of it times what the misfits of that edge's pieces do beyond noise
(`robust_variance`), for a smear is no Gaussian and its misfit stands on the smeared edge alone.

A picture that turned about its middle shares no direction, and is fitted as one at rest.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array, Grey
from calibrant.detection.subpixel import saddle
from calibrant.detection.subpixel.first_stretch import first_stretches
from calibrant.detection.subpixel.refined import WINDOWS_OF_BLUR, Refined, Zone
from calibrant.detection.subpixel.robust_variance import variance_ratio

LOOK_AT, LEAST_SEEN = 9, 5
"""Corners looked at before all are fitted anew, and those that it takes to say more than what chance does."""
CHANCE = 1e-3
"""That a picture at rest is taken for a moved one: its corners then have a model of more freedom than they need."""
NEARLY = 0.5
"""Of STRETCH, and of the logarithm of CHANCE, from where corners are fitted to see: a first step says both to a tenth
where they are that small."""
STRETCH = 0.25
"""Of rho, from where blur counts as wider along one direction: edges across it are then e^0.25 = 1.3 times as wide as
those along it, and deviations, which grow as the root of an edge's width, differ by an eighth: no more than one number
for both axes may be off by."""


def refine(
    grey: Grey,
    uv: Array,
    steps: Array,
    dark: NDArray[np.bool_],
    *,
    radius_px: float = 6.0,
    blur_px: float = 1.0,
    zero_zone_px: Zone = 0.0,
) -> Refined:
    """Corners where two edges cross, near uv (n, 2); where the picture moved while it was exposed, with that in fit and
    covariance.

    Args: steps (n, 4) pixels: ux, uy to the next corner along the row and vx, vy along the column; dark (n,): colour of
    the square towards both; radius_px: largest half width of the window; blur_px: the blur to start from, about the
    uncertainty of uv; zero_zone_px: half width of the square around the corner that is left out, 0 for none, or
    its half widths along x and y.
    """
    fitted, *more = saddle.fit(grey, uv, steps, dark, radius_px=radius_px, blur_px=blur_px, zero_zone_px=zero_zone_px)
    still = saddle.refined(fitted, *more)
    there = np.flatnonzero(still.converged)
    if len(there) < LEAST_SEEN:
        return still
    some = there[np.linspace(0, len(there) - 1, min(LOOK_AT, len(there))).round().astype(np.int64)]
    first = first_stretches(grey, fitted[some], uv[some], steps[some], radius_px=radius_px, zero_zone_px=zero_zone_px)
    if common_stretch(first[np.isfinite(first[:, 0])], share=NEARLY) is None:
        return still

    def stretched(which: NDArray[np.int64], stretch: tuple[float, float]) -> tuple[Array, Array, Array]:
        begin = np.hstack([fitted[which], np.tile(stretch, (len(which), 1))])
        return saddle.fit(
            grey, uv[which], steps[which], dark[which],
            radius_px=radius_px, blur_px=blur_px, zero_zone_px=zero_zone_px, begin=begin,
        )  # fmt: skip

    seen, sigma, _ = stretched(some, (0.0, 0.0))
    stretch = common_stretch(seen[np.isfinite(sigma[:, 0]), -2:])
    if stretch is None:
        return still
    moved = _of_moved(still, there, *stretched(there, stretch))
    nearest = np.minimum(np.hypot(steps[:, 0], steps[:, 1]), np.hypot(steps[:, 2], steps[:, 3]))
    room = np.minimum(saddle.WINDOW * nearest, radius_px)
    beyond = WINDOWS_OF_BLUR * moved.blur_px[moved.converged] > room[moved.converged]
    return replace(moved, smeared=2 * int(np.count_nonzero(beyond)) > len(beyond))


def common_stretch(found: Array, *, share: float = 1.0) -> tuple[float, float] | None:
    """d and o of a picture that moved, from those of some of its corners (n, 2); None for one that did not.

    share: of STRETCH, and of the logarithm of CHANCE, that it takes.

    Bent edges, print and compression give every corner a stretch of its own; motion gives all the same. With m their
    mean, s^2 their variance per axis and nu = 2 (n - 1), as large a mean comes by chance with the probability
    (1 + n |m|^2 / (nu s^2))^(-nu / 2), the tail of F(2, nu).
    """
    n = len(found)
    if n < LEAST_SEEN:
        return None
    mean, nu = found.mean(axis=0), 2 * (n - 1)
    variance = max(float(np.sum((found - mean) ** 2)) / nu, np.finfo(float).tiny)
    chance = -0.5 * nu * np.log1p(n * float(mean @ mean) / (nu * variance))
    there = np.hypot(*mean) > share * STRETCH and chance < share * np.log(CHANCE)
    return (float(mean[0]), float(mean[1])) if there else None


def _of_moved(still: Refined, there: NDArray[np.int64], found: Array, spread: Array, pieces: Array) -> Refined:
    """The corners fitted with a stretch in place of those without; one that has no such fit is none."""
    good = np.isfinite(spread[:, 0])
    own = pieces[good]
    whole = variance_ratio(own)
    covariance = whole * _matrices(spread[good, 2:5])
    for edge in range(2):
        covariance += (variance_ratio(own[:, edge]) - whole) * _matrices(own[:, edge, 3:])
    covariance *= spread[good, 1, None, None] ** 2
    index = there[good]
    uv, sigma, blur = still.uv.copy(), np.full(len(still.uv), np.inf), still.blur_px.copy()
    contrast, noise = still.contrast.copy(), still.noise.copy()
    whole_covariance = np.full((len(uv), 2, 2), np.inf)
    uv[index], contrast[index], noise[index] = found[good, :2], np.abs(found[good, 6]), spread[good, 1]
    blur[index] = np.exp(found[good, 4] + 0.5 * np.hypot(found[good, 11], found[good, 12]))
    sigma[index] = np.sqrt(0.5 * np.trace(covariance, axis1=1, axis2=2))
    whole_covariance[index] = covariance
    return Refined(uv, sigma, contrast, noise, blur, np.isfinite(sigma), whole_covariance)


def _matrices(values: Array) -> Array:
    """Symmetric matrices (n, 2, 2) of their xx, xy, yy (n, 3)."""
    return values[:, [0, 1, 1, 2]].reshape(-1, 2, 2)
