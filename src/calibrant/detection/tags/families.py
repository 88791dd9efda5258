"""Reading AprilTag 3's families: the cells within and around a light square in a dark ring, looked up among the codes.

The quadrilateral is the square; cells beyond it are sampled through its homography. The ring of paper within and the
ring of ink around tell a tag from texture, and the middle of the two is the threshold.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array, Grey
from calibrant.detection.opencv import Markers, sample
from calibrant.detection.tags.agreement import map_from_unit_square, strip
from calibrant.detection.tags.codes import (
    INNER,
    LEAST_CONTRAST,
    MENDED,
    MOST_BORDER,
    STEP_CELLS,
    Codes,
    look_up,
    outlines,
)
from calibrant.targets.apriltag3 import FAMILIES, tag_cells, tag_codes, tag_rings

WITHIN_A_CELL = INNER * np.array([[0.0, 0.0], [-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]])


@lru_cache(maxsize=8)
def family_codes(name: str) -> tuple[Codes, int]:
    """Codes (n, 4) of a family's tags at every quarter turn, and how many wrong bits are mended.

    Turn k: as read from a square whose first corner is the tag's own corner k. Raises: as `tag_codes`.
    """
    known = tag_codes(name)
    high_first = np.arange(len(known.row), dtype=np.uint64)[::-1]
    total = FAMILIES[name].total
    position = np.full((total, total), -1)
    position[known.row, known.column] = np.arange(len(known.row))
    codes = np.zeros((len(known.codes), 4), np.uint64)
    for turn in range(4):
        seen = np.rot90(position, turn)[known.row, known.column]
        for bit, place in enumerate(seen):
            codes[:, turn] |= ((known.codes >> high_first[place]) & np.uint64(1)) << high_first[bit]
    return codes, int(MENDED * ((known.distance - 1) // 2))


def read_family(grey: Grey, quads: Array, name: str) -> Markers:
    """The tags of a family whose squares are among quadrilaterals (n, 4, 2) px, clockwise. Raises: as `tag_codes`."""
    codes, mended = family_codes(name)
    known = tag_codes(name)
    value = _values(grey, quads, name)
    paper, ink = (value[:, ring] for ring in tag_rings(name))
    middle = 0.5 * (paper.mean(axis=1) + ink.mean(axis=1))
    seen = paper.mean(axis=1) - ink.mean(axis=1) >= LEAST_CONTRAST
    for wrong in (paper < middle[:, None], ink > middle[:, None]):
        seen &= wrong.mean(axis=1) <= MOST_BORDER
    at = np.flatnonzero(seen)
    bits = (value[at][:, known.row, known.column] > middle[at, None]).astype(np.uint64)
    weight = np.uint64(1) << np.arange(bits.shape[1], dtype=np.uint64)[::-1]
    found = np.empty((len(at), 2), np.int64)
    look_up(np.ascontiguousarray(bits @ weight), codes, mended, found)
    which, turn = found.T
    corners = np.stack([np.roll(quads[i], k, axis=0) for i, k in zip(at, turn, strict=True)]) if len(at) else quads[:0]
    markers = Markers(which, corners).subset(which >= 0)
    return markers.subset(outlines(markers.ids, markers.corners, _step(grey, markers.corners, name)))


def shows_tag(grey: Grey, corners: Array, ids: NDArray[np.int64], name: str, *, wrong: float) -> NDArray[np.bool_]:
    """Whether each tag shows its rings and its code, all but a part `wrong` of the cells, at corners (n, 4, 2)."""
    if len(ids) == 0:
        return np.empty(0, dtype=bool)
    known = tag_codes(name)
    told = np.logical_or(*tag_rings(name))
    told[known.row, known.column] = True
    light = np.stack([tag_cells(name, int(i))[told] for i in ids])
    value = _values(grey, corners, name)[:, told]
    bright, dark = (np.where(which, value, 0.0).sum(axis=1) / which.sum(axis=1) for which in (light, ~light))
    differs = (value > 0.5 * (bright + dark)[:, None]) != light
    return np.asarray((differs.mean(axis=1) <= wrong) & (bright > dark))


def _step(grey: Grey, quads: Array, name: str) -> Array:
    """Mean step of grey across each outline (n,), to either side: of several around one tag, its edge has the most."""
    if len(quads) == 0:
        return np.empty(0)
    along = (np.arange(FAMILIES[name].square) + 0.5) / FAMILIES[name].square
    inner, outer = (
        sample(grey, map_from_unit_square(quads, np.tile(strip(inset, along), (len(quads), 1, 1))))
        for inset in (STEP_CELLS / FAMILIES[name].square, -STEP_CELLS / FAMILIES[name].square)
    )
    return np.asarray(np.abs((inner - outer).mean(axis=1)))


def _values(grey: Grey, quads: Array, name: str) -> Array:
    """Grey values (n, total, total) of a tag's cells, the mean of five places in each one's inner half."""
    family = FAMILIES[name]
    centre = (np.arange(family.total) + 0.5 - 0.5 * (family.total - family.square)) / family.square
    grid = np.stack(np.meshgrid(centre, centre), axis=-1).reshape(-1, 1, 2) + WITHIN_A_CELL / family.square
    if len(quads) == 0:
        return np.empty((0, family.total, family.total))
    uv = map_from_unit_square(quads, np.tile(grid.reshape(-1, 2), (len(quads), 1, 1)))
    value = sample(grey, np.nan_to_num(uv, nan=-1.0)).reshape(len(quads), -1, len(WITHIN_A_CELL))
    return value.mean(axis=2).reshape(len(quads), family.total, family.total)
