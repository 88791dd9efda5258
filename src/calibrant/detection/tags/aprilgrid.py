"""Finding AprilGrids: tags read in the whole picture, then where these put the others; corners moved to saddles.

Each corner of a tag touches the corner of a small black square, so two straight edges cross there and the same fit of
two blurred steps serves as for chessboards, whatever the motion blur or threshold.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array, Grey
from calibrant.detection.detection import Detection, covariance_of
from calibrant.detection.local_homography import fit_local_maps
from calibrant.detection.opencv import Markers
from calibrant.detection.subpixel import motion, saddle
from calibrant.detection.tags.detector import shows_cells
from calibrant.detection.tags.quad_edges import refine_quads
from calibrant.detection.tags.search import efforts, find_markers
from calibrant.errors import InputError
from calibrant.targets.aprilgrid import TURNS, AprilGrid
from calibrant.targets.target import Target

COARSE_SIDE_PX = 1000
"""The first search is in an image of about this many pixels: a 6x6 grid that fills half of it has tags of 60 px."""
APART = 0.33
"""Tags touch the small squares at their corners, where the grey is the mean of ink and paper: less than that counts as
ink, which keeps them apart when blurred."""
ENOUGH = 0.5
"""Part of the tags with which no further search is made: the others are read where these put them."""
LEAST_TAGS = 2
"""One tag may be read into texture; two that lie as on the grid are not."""
ROUGH_SIGMA_PX, CORNER_SIGMA_PX = 1.0, 0.2
"""How far corners from the tags' edges, and refined ones, are trusted when they predict each other."""
REACH_BORDER = 0.8
"""Profiles across a tag's edge stay within this part of its border, and within the gap."""
AGREEMENT_TAGS = 0.06
"""A corner must lie where those around it predict, in tags: a lens bends a grid by less."""
MOVE_TAGS = 0.08
"""How far a corner may move when it is refined, in tags: two pixels in a tag of 25."""


class AprilGridDetector:
    """Finds `AprilGrid` targets, whole or in part. Registered in `detection/registry.py`."""

    def detect(self, grey: Grey, target: Target) -> Detection:
        """The tags' corners in a grey image (h, w), with their standard deviations.

        Raises: InputError when the target is not an AprilGrid.
        """
        if not isinstance(target, AprilGrid):
            raise InputError(f"the AprilGrid detector was given a target of kind {target.kind!r}")
        seen = 0
        # The other width of the border is tried too: prints of both kinds are called AprilGrid.
        for printed in (target, replace(target, border=3 - target.border)):
            markers = _search(grey, printed)
            seen = max(seen, len(markers))
            detection = _detection(grey, printed, markers)
            if detection is not None:
                note = f"The tags' border is {printed.border} cells wide: add :border={printed.border} to the spec."
                return detection if printed == target else replace(detection, notes=(note,))
        if seen:
            return Detection.nothing(f"{seen} tags of {target.dictionary} seen, but they do not lie as on the grid")
        return Detection.nothing(f"no tags of {target.dictionary} seen")


def _search(grey: Grey, target: AprilGrid) -> Markers:
    """The tags of the grid, with more effort until most are read; each once."""
    count = target.columns * target.rows
    best = Markers.of((), None)
    for effort in efforts(grey.shape, COARSE_SIDE_PX, part=APART):
        found = find_markers(grey, target.dictionary, effort, border=target.border)
        once = np.array([np.count_nonzero(found.ids == i) == 1 for i in found.ids], dtype=bool)
        found = found.subset(once & (found.ids < count))
        best = found if len(found) > len(best) else best
        if len(best) >= ENOUGH * count:
            break
    # From the upper left, clockwise, as the target counts them.
    if len(best) == 0:
        return best
    reach = REACH_BORDER * target.border / (target.bits + 2 * target.border)
    corners, sigma = refine_quads(grey, np.roll(best.corners, TURNS, axis=1), reach=reach)
    best = Markers(best.ids, corners).subset(sigma.max(axis=1, initial=0.0) < ROUGH_SIGMA_PX)
    return best.subset(_with_codes(grey, target, best.ids, best.corners))


def _with_codes(grey: Grey, target: AprilGrid, ids: NDArray[np.int64], corners: Array) -> NDArray[np.bool_]:
    opencv_order = np.roll(corners, TURNS, axis=1)
    return shows_cells(grey, opencv_order, ids, target.dictionary, border=target.border)


def _detection(grey: Grey, target: AprilGrid, markers: Markers) -> Detection | None:
    """The corners of the tags that agree with each other, and of those that can be read where these put them."""
    xy = target.points[:, :2] / target.tag
    while len(markers) >= LEAST_TAGS:
        error = _prediction_error(xy[target.tag_points[markers.ids]], markers.corners)
        if error.max() <= 1.0:
            break
        markers = markers.subset(error < max(1.0, 0.7 * error.max()))
    if len(markers) < LEAST_TAGS:
        return None
    n = len(target.point_ids)
    uv, sigma = np.full((n, 2), np.nan), np.full(n, ROUGH_SIGMA_PX)
    uv[target.tag_points[markers.ids].ravel()] = markers.corners.reshape(-1, 2)
    uv, sigma, shape = _refined_tags(grey, target, uv, sigma)
    for _ in range(target.columns + target.rows):
        more = _predicted(grey, target, uv, sigma)
        if more is None:
            break
        uv, sigma, shape = more
    found = np.flatnonzero(~np.isnan(uv[:, 0]))
    if len(found) < 4 * LEAST_TAGS:
        return None
    covariance = covariance_of(sigma[found], shape[found])
    return Detection(target.point_ids[found], uv[found], sigma[found], covariance_px=covariance)


def _prediction_error(xy: Array, corners: Array) -> Array:
    """How far each tag (n,) is from where the others put it, over what is allowed."""
    n = len(xy)
    error = np.zeros(n)
    for i in range(n):
        others = np.arange(n) != i
        known, uv = xy[others].reshape(-1, 2), corners[others].reshape(-1, 2)
        maps = fit_local_maps(xy[i], known, uv, np.full(len(known), ROUGH_SIGMA_PX))
        away = np.linalg.norm(maps.centres - corners[i], axis=1)
        allowed = np.maximum(AGREEMENT_TAGS * maps.square_px, 2.0 * ROUGH_SIGMA_PX) + 3.0 * maps.sigma_px
        error[i] = (away / allowed).max()
    return error


def _predicted(grey: Grey, target: AprilGrid, uv: Array, sigma: Array) -> tuple[Array, Array, Array] | None:
    """With the tags that can be read where the corners known so far put them; None when there is no such tag."""
    xy = target.points[:, :2] / target.tag
    known = ~np.isnan(uv[:, 0])
    tags = np.flatnonzero(~known[target.tag_points].any(axis=1))
    if len(tags) == 0 or known.sum() < 4:
        return None
    places = target.tag_points[tags].ravel()
    maps = fit_local_maps(xy[places], xy[known], uv[known], np.maximum(sigma[known], CORNER_SIGMA_PX))
    height, width = grey.shape
    inside = np.all((maps.centres > 0) & (maps.centres < np.array([width, height]) - 1), axis=1)
    sure = (inside & maps.determined).reshape(-1, 4).all(axis=1)
    corners = maps.centres.reshape(-1, 4, 2)
    sure[sure] = _with_codes(grey, target, tags[sure], corners[sure])
    if not sure.any():
        return None
    trial = uv.copy()
    trial[target.tag_points[tags[sure]].ravel()] = corners[sure].reshape(-1, 2)
    found = _refined_tags(grey, target, trial, sigma)
    return found if (~np.isnan(found[0][:, 0])).sum() > known.sum() else None


def _refined_tags(grey: Grey, target: AprilGrid, uv: Array, sigma: Array) -> tuple[Array, Array, Array]:
    """All corners known (NaN where not) moved onto their saddles, those without one left out; and their sigma_px and
    shape, as those of `Refined`."""
    index = np.flatnonzero(~np.isnan(uv[:, 0]))
    xy = target.points[index, :2] / target.tag
    maps = fit_local_maps(xy, xy, uv[index], np.maximum(sigma[index], CORNER_SIGMA_PX))
    # The fit looks at WINDOW of the steps: they are shortened so that it ends within border and gap.
    border = target.border / (target.border * 2 + target.bits)
    part = 0.9 * min(border, target.spacing) / saddle.WINDOW
    steps = np.swapaxes(maps.px_per_square, 1, 2).reshape(-1, 4) * part
    row, column = np.divmod(index, 2 * target.columns)
    # Right of and below a corner lies its tag when it is an upper left one, a small square when a lower right one.
    dark = (row % 2 == 1) == (column % 2 == 0)
    refined = motion.refine(grey, uv[index], steps, dark, blur_px=1.0)
    moved = np.linalg.norm(refined.uv - uv[index], axis=1)
    near = moved < np.maximum(MOVE_TAGS * maps.square_px, 2.0 * ROUGH_SIGMA_PX)
    good = refined.converged & near & (refined.noise < refined.contrast)
    new_uv, new_sigma = np.full_like(uv, np.nan), np.full_like(sigma, ROUGH_SIGMA_PX)
    shape = np.tile(np.eye(2), (len(uv), 1, 1))
    new_uv[index[good]], new_sigma[index[good]] = refined.uv[good], refined.sigma_px[good]
    shape[index[good]] = refined.shape[good]
    return new_uv, new_sigma, shape
