"""Finding markers that stand alone: a single one, or a bundle of them fixed to each other.

A marker is taken when its dictionary's code is read and its four edges are straight and seen; small dictionaries are
read into texture now and then, so every cell must also show its colour at the corners found.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array, Grey
from calibrant.detection.detection import Detection
from calibrant.detection.opencv import Markers, marker_cells, sample
from calibrant.detection.tags.agreement import map_from_unit_square
from calibrant.detection.tags.drawn_edges import refine_drawn
from calibrant.detection.tags.families import shows_tag
from calibrant.detection.tags.quad_edges import refine_quads
from calibrant.detection.tags.search import efforts, find_markers
from calibrant.errors import InputError
from calibrant.targets.apriltag3 import FAMILIES
from calibrant.targets.bundle import Bundle
from calibrant.targets.marker import Marker
from calibrant.targets.target import Target

COARSE_SIDE_PX = 800
"""The first search is in an image of about this many pixels: a marker that fills a tenth of it is read there."""
REACH_CELLS = 0.8
"""Profiles across an edge stay within the border of ink, one cell wide."""
WORST_SIGMA_PX = 0.5
"""An edge that is not known better than this is not an edge of the marker."""
WRONG_CELLS = 0.05
"""Part of the cells that may be hidden by glare; more, and it is texture that looks like a marker."""
LEAST_SIDE_PX = 8.0
"""Shortest side: one pixel a cell."""


class TagDetector:
    """Finds `Marker` and `Bundle` targets. Registered in `detection/registry.py`."""

    def detect(self, grey: Grey, target: Target) -> Detection:
        """The corners of the target's markers in a grey image (h, w), with their standard deviations.

        Raises: InputError when the target is neither a marker nor a bundle.
        """
        if not isinstance(target, Marker | Bundle):
            raise InputError(f"the detector of markers was given a target of kind {target.kind!r}")
        wanted = target.marker_points
        best = Markers.of((), None)
        for effort in efforts(grey.shape, COARSE_SIDE_PX):
            markers = find_markers(grey, target.dictionary, effort)
            on_target = markers.subset(np.isin(markers.ids, list(wanted)))
            if len(np.unique(on_target.ids)) > len(np.unique(best.ids)):
                best = on_target
            if len(np.unique(best.ids)) == len(wanted):
                break
        if len(best) == 0:
            return Detection.nothing(_none_seen(target, wanted))
        twice = [int(i) for i in np.unique(best.ids) if np.count_nonzero(best.ids == i) > 1]
        if twice:
            return Detection.nothing(f"marker {twice[0]} is in the picture twice; cover one of the two")
        uv, sigma = _refined(grey, best, target.dictionary)
        good = (sigma.max(axis=1) < WORST_SIGMA_PX) & _shown(grey, uv, best.ids, target.dictionary)
        good &= np.linalg.norm(np.roll(uv, -1, axis=1) - uv, axis=2).min(axis=1) > LEAST_SIDE_PX
        if not good.any():
            return Detection.nothing(
                "markers seen, but their edges are blurred, hidden or cut off; their quiet zone must be in view"
            )
        kept = np.flatnonzero(good)[np.argsort(best.ids[good])]
        ids = np.concatenate([wanted[int(i)] for i in best.ids[kept]])
        return Detection(ids, uv[kept].reshape(-1, 2), sigma[kept].ravel())


def _refined(grey: Grey, markers: Markers, name: str) -> tuple[Array, Array]:
    """Corners (n, 4, 2) px on the edges of the markers' squares, and their sigma_px (n, 4)."""
    cells = np.stack([marker_cells(name, int(i)) for i in markers.ids])
    square = cells.shape[1]
    if name in FAMILIES:
        # The square is light in a dark ring, each a cell wide.
        grey, cells, square = np.asarray(255 - grey, np.uint8), ~cells, FAMILIES[name].square
    uv, sigma = refine_quads(grey, markers.corners, reach=REACH_CELLS / square)
    return refine_drawn(grey, uv, sigma, cells, square)


def _shown(grey: Grey, corners: Array, ids: NDArray[np.int64], name: str) -> NDArray[np.bool_]:
    if name in FAMILIES:
        return shows_tag(grey, corners, ids, name, wrong=WRONG_CELLS)
    return shows_cells(grey, corners, ids, name)


def shows_cells(grey: Grey, corners: Array, ids: NDArray[np.int64], dictionary: str, *, border: int = 1) -> NDArray:
    """Whether each marker shows its own cells, and its whole black border, between corners (n, 4, 2). Returns (n,)."""
    if len(ids) == 0:
        return np.empty(0, dtype=bool)
    inner = np.stack([marker_cells(dictionary, int(i))[1:-1, 1:-1] for i in ids])
    cells = np.pad(inner, ((0, 0), (border, border), (border, border)))
    side = cells.shape[1]
    centre = (np.arange(side) + 0.5) / side
    grid = np.stack(np.meshgrid(centre, centre), axis=-1).reshape(-1, 2)
    value = sample(grey, map_from_unit_square(corners, np.tile(grid, (len(ids), 1, 1))))
    light = cells.reshape(len(ids), -1)
    mean_light = np.where(light, value, 0).sum(axis=1) / light.sum(axis=1)
    mean_dark = np.where(~light, value, 0).sum(axis=1) / (~light).sum(axis=1)
    wrong = (value > 0.5 * (mean_light + mean_dark)[:, None]) != light
    return (wrong.mean(axis=1) <= WRONG_CELLS) & (mean_light > mean_dark)


def _none_seen(target: Marker | Bundle, wanted: dict[int, NDArray[np.int64]]) -> str:
    if isinstance(target, Marker):
        return f"marker {target.id} of {target.dictionary} was not seen"
    return f"none of the {len(wanted)} markers of {target.dictionary} of the bundle was seen"
