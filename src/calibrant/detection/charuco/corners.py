"""Corners of a ChArUco board grown from its markers: predict each from what is known around it, look, keep or drop.

A round predicts every corner that is not known yet from the markers and corners around it, moves it onto the saddle
of the grey values, and keeps it when the four squares around it have the colours they must have. Corners found feed
the next round, so the board is followed into parts whose markers cannot be read and around the bend of a wide lens.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array, Grey
from calibrant.detection.local_homography import LocalMaps, fit_local_maps
from calibrant.detection.opencv import Markers, refine_corners, sample
from calibrant.detection.subpixel.refinement import DEFAULT, Refinement, refine
from calibrant.targets.charuco import Charuco

if TYPE_CHECKING:
    from calibrant.detection.subpixel.refined import Refined

# How far the markers' corners and refined corners are trusted, px: contour corners are whole pixels on a blurred edge.
MARKER_SIGMA_PX = 1.0
CORNER_SIGMA_PX = 0.2
# Correlation of the grey values around a corner with the pattern of light and dark there. Half a corner, its other half
# behind something of one grey, has sqrt(1/2) = 0.71; a blurred or noisy whole one stays above 0.8.
PATTERN_CORRELATION = 0.78
# Samples of each of the four squares, of five, that must lie in the picture.
LEAST_SAMPLES = 3
# Light and dark squares differ by this many grey levels at least: a few times the noise of a camera in poor light.
CONTRAST = 8.0
# A corner may move this far from its prediction, squares: half-way to anything else that looks like a corner would be
# 0.5; a prediction two squares away errs by less than 0.25.
MOVE_SQUARES = 0.25
# A corner must agree with the prediction from its neighbours this well, squares; saddles are good to a hundredth.
AGREEMENT_SQUARES = 0.08
# A corner that was looked for this often in vain, from better and better predictions, is hidden.
ATTEMPTS = 3
# Both refinements look at the same edges: where they differ by more, one of them is on something else.
SHARPENING_PX = 1.5
# What a corner is worth that only the rough refinement could place.
ROUGH_SIGMA_PX = 0.5
# Such a corner lies no further from where its neighbours put it than all but one in a thousand do, by both sigmas: the
# root of chi-square's quantile for two coordinates.
ROUGH_DEVIATIONS = 3.72
# Raster errors of the rough refinement that neighbours share, so that they cannot tell: without noise as well, it errs
# by 0.03 to 0.05 px.
ROUGH_FLOOR_PX = 0.05
# Fewer rough corners say nothing of how good they are: their mean square is then known to a factor of two at best.
LEAST_TOLD = 3
# Its neighbours' own distance from their predictions, of these many, is what the lens adds.
NEAREST = 4
HALF_WINDOWS_PX = (2, 10)
# Windows grow further where the prediction is not sure: to this many of its sigmas.
WINDOW_SIGMAS = 3.0


@dataclass(frozen=True, eq=False)
class Corners:
    """Corners found: index (n,) into the target's points; uv (n, 2) px; sigma_px (n,) per axis; shape (n, 2, 2), their
    covariance over sigma_px^2, by itself alike to all sides; smeared as that of `Detection`."""

    index: NDArray[np.int64]
    uv: Array
    sigma_px: Array
    shape: Array = field(default_factory=lambda: np.eye(2)[None])
    smeared: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "shape", np.broadcast_to(self.shape, (len(self.index), 2, 2)))

    def __len__(self) -> int:
        return len(self.index)

    def subset(self, keep: NDArray[np.bool_]) -> Corners:
        """The corners where keep (n,) is true."""
        return Corners(self.index[keep], self.uv[keep], self.sigma_px[keep], self.shape[keep], self.smeared)


@dataclass(frozen=True, eq=False)
class Anchors:
    """Known points of the board: xy (m, 2) squares, uv (m, 2) px, sigma_px (m,)."""

    xy: Array
    uv: Array
    sigma_px: Array

    def joined(self, xy: Array, uv: Array, sigma_px: float) -> Anchors:
        """These and more points of one sigma."""
        sigma = np.concatenate([self.sigma_px, np.full(len(xy), sigma_px)])
        return Anchors(np.concatenate([self.xy, xy]), np.concatenate([self.uv, uv]), sigma)

    def maps_at(self, places: Array) -> LocalMaps:
        """The local maps around places (n, 2), squares."""
        return fit_local_maps(places, self.xy, self.uv, self.sigma_px)


def marker_anchors(markers: Markers, target: Charuco) -> Anchors:
    """The markers' corners as known points."""
    xy = (target.marker_corners[markers.ids] / target.square).reshape(-1, 2)
    return Anchors(xy, markers.corners.reshape(-1, 2), np.full(len(xy), MARKER_SIGMA_PX))


def corner_anchors(corners: Corners, target: Charuco) -> Anchors:
    """Found corners as known points."""
    xy = target.points[corners.index, :2] / target.square
    return Anchors(xy, corners.uv, np.full(len(xy), CORNER_SIGMA_PX))


def grow_corners(grey: Grey, target: Charuco, anchors: Anchors, how: Refinement = DEFAULT) -> Corners:
    """All corners that can be reached from the anchors, each checked against the picture and its neighbours."""
    places = target.points[:, :2] / target.square
    uv = np.full((len(places), 2), np.nan)
    attempts = np.zeros(len(places), dtype=np.int64)
    known = anchors
    while True:
        todo = np.flatnonzero(np.isnan(uv[:, 0]) & (attempts < ATTEMPTS))
        if len(todo) == 0:
            break
        maps = known.maps_at(places[todo])
        todo, maps = todo[maps.determined], maps.subset(maps.determined)
        attempts[todo] += 1
        refined, good = find_corners(grey, target, todo, maps)
        new = todo[good]
        if len(new) == 0:
            break
        uv[new] = refined[good]
        known = known.joined(places[new], uv[new], CORNER_SIGMA_PX)
    found = np.flatnonzero(~np.isnan(uv[:, 0]))
    rough = Corners(found, uv[found], np.full(len(found), CORNER_SIGMA_PX))
    per_square = known.maps_at(places[found]).px_per_square
    return _agreeing(_sharpened(grey, rough, target, per_square, how), target, anchors)


def corners_at(grey: Grey, target: Charuco, known: Corners, maps: LocalMaps, how: Refinement = DEFAULT) -> Corners:
    """The known corners and those found where maps of all the board's corners put them."""
    there: NDArray[np.bool_] = np.asarray(np.isfinite(maps.centres).all(axis=1))
    there[known.index] = False
    todo = np.flatnonzero(there)
    uv, good = find_corners(grey, target, todo, maps.subset(there))
    index = np.concatenate([known.index, todo[good]])
    sigma = np.concatenate([known.sigma_px, np.full(np.count_nonzero(good), CORNER_SIGMA_PX)])
    order = np.argsort(index)
    rough = Corners(index[order], np.concatenate([known.uv, uv[good]])[order], sigma[order])
    return _sharpened(grey, rough, target, maps.px_per_square[rough.index], how)


def _sharpened(grey: Grey, corners: Corners, target: Charuco, per_square: Array, how: Refinement) -> Corners:
    """Corners refined to their full accuracy, each with its own sigma.

    A corner whose fit fails is fitted once more from where its neighbours put it: it may have been found before these
    were. Where the model of two blurred edges does not fit (a moving board), the rough corner stays, with a large
    sigma, unless its neighbours say that it is elsewhere.
    Args: per_square (n, 2, 2): as `LocalMaps.px_per_square`.
    """
    if len(corners) == 0:
        return corners
    # Windows end before the markers.
    gap = 0.5 * (1.0 - target.marker / target.square)
    steps = np.swapaxes(per_square, 1, 2).reshape(-1, 4)
    dark = ~_light_at_top_left(target, corners.index)

    def fitted(start: Array, which: NDArray[np.bool_]) -> tuple[Refined, NDArray[np.bool_]]:
        refined = refine(grey, start, steps[which], dark[which], how=how, most=gap)
        moved = np.linalg.norm(refined.uv - start, axis=1)
        fits = refined.converged & (moved < SHARPENING_PX) & (refined.sigma_px < ROUGH_SIGMA_PX)
        return refined, fits

    first, fits = fitted(corners.uv, np.ones(len(corners), dtype=bool))
    uv, sigma = np.where(fits[:, None], first.uv, corners.uv), np.where(fits, first.sigma_px, ROUGH_SIGMA_PX)
    shape = np.where(fits[:, None, None], first.shape, np.eye(2))
    if fits.all():
        return Corners(corners.index, uv, sigma, shape, first.smeared)
    if not fits.any():
        return _rough_alone(Corners(corners.index, uv, sigma, shape, first.smeared), ~fits, target)
    place = target.points[corners.index, :2] / target.square
    maps = _maps_of(place, Corners(corners.index, uv, sigma).subset(fits), target)
    again = ~fits & maps.determined & _inside(maps.centres, grey.shape)
    second, good = fitted(maps.centres[again], again)
    index = np.flatnonzero(again)[good]
    uv[index], sigma[index], shape[index] = second.uv[good], second.sigma_px[good], second.shape[good]
    fits[index] = True
    return _without_strays(Corners(corners.index, uv, sigma, shape, first.smeared), fits, target)


def _maps_of(places: Array, corners: Corners, target: Charuco) -> LocalMaps:
    """The maps around places (n, 2), squares, that corners give; no corner is a witness for its own place."""
    return corner_anchors(corners, target).maps_at(places)


def _without_strays(corners: Corners, fits: NDArray[np.bool_], target: Charuco) -> Corners:
    """The corners without those of no fit (n,) that the others put elsewhere.

    A corner may be off by ROUGH_DEVIATIONS of its sigma and its prediction's, and by what the corners around that do
    fit are off by: a lens bends the board between them alike.
    """
    place = target.points[corners.index, :2] / target.square
    measured = corners.subset(fits)
    own = _maps_of(place[fits], measured, target)
    off = np.linalg.norm(measured.uv - own.centres, axis=1)
    bent = np.where(own.determined, off / np.maximum(own.square_px, 1e-9), 0.0)
    maps = _maps_of(place, measured, target)
    distance = np.linalg.norm(place[:, None] - place[fits][None], axis=2)
    nearest = np.argsort(distance, axis=1)[:, :NEAREST]
    lens = bent[nearest].max(axis=1) * maps.square_px
    away = np.linalg.norm(corners.uv - maps.centres, axis=1)
    allowed = ROUGH_DEVIATIONS * np.hypot(ROUGH_SIGMA_PX, maps.sigma_px) + lens
    near = ~maps.determined | (away <= allowed)
    told = ~fits & near & maps.determined
    sigma = np.where(fits, corners.sigma_px, ROUGH_SIGMA_PX)
    sigma[told] = _rough_sigma(away[told])
    if not maps.determined.all():
        # Too few fit there: what they all say of each other is left.
        sigma = np.where(fits | maps.determined, sigma, _rough_alone(corners, ~fits, target).sigma_px)
    return replace(corners, sigma_px=sigma).subset(fits | near)


def _rough_alone(corners: Corners, rough: NDArray[np.bool_], target: Charuco) -> Corners:
    """Corners of which none fits, or few, those rough (n,) with a sigma by how well all predict each other."""
    maps = _maps_of(target.points[corners.index, :2] / target.square, corners, target)
    told = rough & maps.determined
    # A prediction from others as rough, each of CORNER_SIGMA_PX in the maps, errs by its share of the same sigma.
    away = np.linalg.norm(corners.uv - maps.centres, axis=1) / np.hypot(1.0, maps.sigma_px / CORNER_SIGMA_PX)
    sigma = corners.sigma_px.copy()
    sigma[told] = _rough_sigma(away[told])
    return replace(corners, sigma_px=sigma)


def _rough_sigma(away: Array) -> Array:
    """Sigma (n,), px, of rough corners by how far they are from where the fitted ones around put them, (n,) px.

    Their mean square over both axes is twice the variance, and what the predictions err by comes on top; the inverse of
    one of 2 n values is 2 n / (2 n - 2) too large on average. No corner is better than its own distance by the bound of
    strays.
    """
    n = len(away)
    level = np.sqrt(0.5 * np.mean(away**2) * n / (n - 1)) if n >= LEAST_TOLD else ROUGH_SIGMA_PX
    return np.maximum(np.hypot(level, ROUGH_FLOOR_PX), away / ROUGH_DEVIATIONS)


def find_corners(
    grey: Grey, target: Charuco, index: NDArray[np.int64], maps: LocalMaps
) -> tuple[Array, NDArray[np.bool_]]:
    """Corners refined from their predictions, (n, 2) px, and whether each is one, (n,)."""
    # In the precision of the refinement, which gives a start back untouched when its window shows no corner.
    start = maps.centres.astype(np.float32).astype(np.float64)
    inside = _inside(start, grey.shape)
    refined = start.copy()
    half = half_windows(maps, target)
    for window in np.unique(half[inside]):
        chosen = inside & (half == window)
        refined[chosen] = refine_corners(grey, start[chosen], int(window))
    moved = np.linalg.norm(refined - start, axis=1)
    # An untouched start is no corner, unless it is known as well as a marker's: the strips beside some hold no window.
    good = inside & ((moved > 0) | (maps.sigma_px < MARKER_SIGMA_PX)) & (moved < MOVE_SQUARES * maps.square_px)
    good[good] = shows_corner(grey, target, index[good], maps.subset(good), refined[good])
    return refined, good


def half_windows(maps: LocalMaps, target: Charuco) -> NDArray[np.int64]:
    """Half sides (n,), px, of square windows around the corners that stay clear of the markers' corners."""
    gap = 0.5 * (1.0 - target.marker / target.square)
    diagonals = gap * np.array([[1.0, 1.0], [1.0, -1.0]])
    reach = np.linalg.norm(np.einsum("nij,kj->nki", maps.px_per_square, diagonals), axis=-1).min(axis=1)
    least, most = HALF_WINDOWS_PX
    # A square of half side r reaches r sqrt(2) into its corners, and the refinement looks one pixel further.
    room = np.floor(reach / np.sqrt(2.0) - 0.5)
    return np.clip(room, least, np.maximum(most, np.ceil(WINDOW_SIGMAS * maps.sigma_px))).astype(np.int64)


def shows_corner(
    grey: Grey, target: Charuco, index: NDArray[np.int64], maps: LocalMaps, uv: Array
) -> NDArray[np.bool_]:
    """Whether the grey values around each refined corner alternate as the board's squares do there.

    Samples lie in the four squares along the edges that meet in the corner, off the edges by a part of the strip
    between edge and marker, so no marker comes near.
    """
    if len(index) == 0:
        return np.empty(0, dtype=bool)
    offsets, turn = _probe(target)
    light = _light_at_top_left(target, index)
    expected = turn[None] * np.where(light, 1.0, -1.0)[:, None]
    around = maps.pixels(offsets) + (uv - maps.centres)[:, None]
    value = sample(grey, around)
    inside = _inside(around, grey.shape)
    count = np.maximum(inside.sum(axis=1, keepdims=True), 1)
    value = np.where(inside, value - (value * inside).sum(axis=1, keepdims=True) / count, 0.0)
    pattern = np.where(inside, expected - (expected * inside).sum(axis=1, keepdims=True) / count, 0.0)
    product, energy = (value * pattern).sum(axis=1), (pattern**2).sum(axis=1)
    correlation = product / np.maximum(np.sqrt((value**2).sum(axis=1) * energy), 1e-9)
    contrast = 2.0 * product / np.maximum(energy, 1e-9)
    enough = np.all(inside.reshape(len(index), 4, -1).sum(axis=2) >= LEAST_SAMPLES, axis=1)
    return enough & (correlation > PATTERN_CORRELATION) & (contrast > CONTRAST)


def _probe(target: Charuco) -> tuple[Array, Array]:
    """Sample places (20, 2), squares, and +1 in the squares top left and bottom right, -1 in the other two."""
    off = 0.3 * (1.0 - target.marker / target.square)
    quadrant = np.array([[off, off], [0.2, off], [off, 0.2], [0.35, off], [off, 0.35]])
    signs = np.array([[1.0, 1.0], [-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0]])
    offsets = (signs[:, None] * quadrant[None]).reshape(-1, 2)
    return offsets, np.repeat(signs[:, 0] * signs[:, 1], len(quadrant))


def _light_at_top_left(target: Charuco, index: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether the square at the top left of each corner is light: those with markers are, in an upright print."""
    row, column = np.divmod(index, target.columns - 1)
    first_column, first_row = target.marker_squares[0]
    marked = (row + column) % 2 == (first_column + first_row) % 2
    return marked != target.inverted


def _agreeing(corners: Corners, target: Charuco, anchors: Anchors) -> Corners:
    """Corners that lie where those around them predict, the worst dropped first until all agree."""
    while len(corners):
        here = corner_anchors(corners, target)
        # Few corners do not determine each other; the markers then help, at their lower weight.
        maps = here.joined(anchors.xy, anchors.uv, MARKER_SIGMA_PX).maps_at(here.xy)
        size = maps.square_px
        error = np.linalg.norm(corners.uv - maps.centres, axis=1) / np.maximum(size, 1e-9)
        # Whole pixels cannot be told apart from agreement on tiny boards: allow for the refinement's own error too.
        allowed = np.maximum(AGREEMENT_SQUARES, 1.0 / np.maximum(size, 1e-9))
        excess = np.where(maps.determined, error / allowed, 0.0)
        if excess.max() <= 1.0:
            break
        # A bad corner spoils its neighbours' predictions: drop those that are locally the worst, then look again.
        corners = corners.subset(excess < max(1.0, 0.7 * excess.max()))
    return corners


def _inside(uv: Array, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    height, width = shape[:2]
    u, v = uv[..., 0], uv[..., 1]
    return np.asarray((u >= 0) & (v >= 0) & (u <= width - 1) & (v <= height - 1))
