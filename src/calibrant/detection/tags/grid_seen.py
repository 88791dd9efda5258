"""Is it an AprilGrid? For who looks for something else: its tags' edges and small squares make corners and spots, too.

Its tags stand closer than those of a ChArUco board can: there a square lies between, here 0.2 to 0.5 of a tag.
"""

from __future__ import annotations

import numpy as np

from calibrant.arrays import Grey
from calibrant.detection.opencv import Markers
from calibrant.detection.tags.aprilgrid import APART, COARSE_SIDE_PX
from calibrant.detection.tags.search import efforts, find_quads_at, read_quads

FAMILIES = ("DICT_APRILTAG_36h11", "DICT_APRILTAG_25h9", "DICT_APRILTAG_36h10")
"""Those that AprilGrids are printed with: Kalibr's, and what others made after it; 16h5 is read anywhere."""
LEAST = 3
"""Neighbours, by their ids, that stand so close."""
CLOSE = 1.75
"""Tags from centre to centre: 1.2 to 1.5 in prints; on a ChArUco board at least two, they fill less than a square."""


def aprilgrid_seen(grey: Grey) -> str | None:
    """What to call the AprilGrid that a grey image (h, w) shows, its tags' family; None where it shows none."""
    quads = find_quads_at(grey, efforts(grey.shape, COARSE_SIDE_PX, part=APART)[0])
    for family in FAMILIES if len(quads) > LEAST else ():
        for border in (2, 1):
            if _close(read_quads(grey, quads, family, border=border)) >= LEAST:
                return f"an AprilGrid with tags of {family}"
    return None


def _close(tags: Markers) -> int:
    """How many tags stand beside the one of the next id."""
    order = np.argsort(tags.ids)
    ids, corners = tags.ids[order], tags.corners[order]
    apart = np.linalg.norm(np.diff(corners.mean(axis=1), axis=0), axis=1)
    side = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean(axis=1)
    return int(np.sum((np.diff(ids) == 1) & (apart < CLOSE * np.maximum(side[1:], side[:-1]))))
