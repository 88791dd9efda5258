"""What the search for markers saw on its way, as pictures: to tell a photo that is too dark from a wrong dictionary."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array, Grey
from calibrant.data import View
from calibrant.detection.images.overlay import draw, write_label
from calibrant.detection.opencv import Markers
from calibrant.detection.tags.quads import MIDDLE, dark_regions
from calibrant.detection.tags.search import Effort, Ink, efforts, find_quads_at, level_of, read_quads
from calibrant.errors import InputError
from calibrant.opencv import cv2
from calibrant.targets.aprilgrid import AprilGrid
from calibrant.targets.bundle import Bundle
from calibrant.targets.charuco import Charuco
from calibrant.targets.marker import Marker
from calibrant.targets.target import Target

NAMES = ("1-grey", "2-threshold", "3-quads", "4-decoded", "5-corners")
COARSE_SIDE_PX = 1000
"""Of the first picture searched, longest side."""
MOST_IDS = 8
"""Markers of one photo that are named."""
READ, UNREAD = (80, 220, 80), (60, 60, 230)
"""Colours in BGR of quadrilaterals with a code and without."""

Picture = NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class _Search:
    effort: Effort
    quads: Array
    markers: Markers


def with_markers(target: Target) -> AprilGrid | Bundle | Charuco | Marker:
    """The same target. Raises: InputError for one without markers."""
    if not isinstance(target, AprilGrid | Bundle | Charuco | Marker):
        raise InputError(
            f"--stages shows how markers are found; {target.spec} has none: use --overlays, or give a charuco, "
            "aprilgrid, marker or bundle target"
        )
    return target


def stages(grey: Grey, target: Target, view: View | None) -> list[Picture]:
    """Pictures of `NAMES` of an image (h, w): the smaller grey one that is searched, its dark regions, quadrilaterals,
    which of them have a code (with its number), and the points found (view; None where there are none).

    They are those of the search that reads most markers. Raises: InputError for a target without markers.
    """
    found = _best_search(grey, with_markers(target))
    level = level_of(grey, found.effort)
    dark = dark_regions(level, contrast=found.effort.contrast, part=found.effort.part)[1:-1, 1:-1]
    corners = np.repeat(grey[..., np.newaxis], 3, axis=2) if view is None else draw(grey, view)
    return [level, np.asarray(255 * (1 - dark), np.uint8), _quads(grey, found), _decoded(grey, found), corners]


def lost_at(grey: Grey, target: Target) -> str:
    """At which stage the search of an image (h, w) that shows nothing of the target lost it, in words.

    Raises: InputError for a target without markers.
    """
    wanted = with_markers(target)
    found = _best_search(grey, wanted)
    if len(found.quads) == 0:
        level = level_of(grey, found.effort)
        dark = dark_regions(level, contrast=found.effort.contrast, part=found.effort.part)
        return "3-quads: no dark region has four straight sides" if dark.any() else "2-threshold: nothing is dark"
    if len(found.markers) == 0:
        count = len(found.quads)
        seen = "the only quadrilateral has no" if count == 1 else f"none of {count} quadrilaterals has a"
        return f"4-decoded: {seen} code of {wanted.dictionary}"
    ids = ", ".join(str(int(i)) for i in np.unique(found.markers.ids)[:MOST_IDS])
    return f"5-corners: of {wanted.dictionary} read ({ids}), none is where the board has it, with its edges seen"


def _best_search(grey: Grey, target: AprilGrid | Bundle | Charuco | Marker) -> _Search:
    ink: Ink = "light" if isinstance(target, Charuco) and target.inverted else "dark"
    border = target.border if isinstance(target, AprilGrid) else 1
    tried = []
    for effort in efforts(grey.shape, COARSE_SIDE_PX, ink, part=MIDDLE):
        quads = find_quads_at(grey, effort)
        tried.append(_Search(effort, quads, read_quads(grey, quads, target.dictionary, border=border)))
    return max(tried, key=lambda search: len(search.markers))


def _quads(grey: Grey, found: _Search) -> Picture:
    return _outlined(np.repeat(grey[..., np.newaxis], 3, axis=2), found.quads, UNREAD)


def _decoded(grey: Grey, found: _Search) -> Picture:
    canvas = _outlined(_quads(grey, found), found.markers.corners, READ)
    unit = max(canvas.shape[1] / 1000, 0.6)
    for marker_id, corners in zip(found.markers.ids, found.markers.corners, strict=True):
        write_label(canvas, str(int(marker_id)), corners.mean(axis=0), READ, unit)
    return canvas


def _outlined(canvas: Picture, quads: Array, colour: tuple[int, int, int]) -> Picture:
    width = max(1, round(canvas.shape[1] / 1000))
    cv2.polylines(canvas, list(np.rint(quads).astype(np.int32)), True, colour, width, cv2.LINE_AA)
    return canvas
