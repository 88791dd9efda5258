"""Finding grids of circles: spots, lattice, placement; then ellipses fitted at full size and moved to the true centres.

Spots are looked for in a small picture first, then at full size where dots are missing. The dots of a lattice predict
each other's centres, which leaves out what is none.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from calibrant.arrays import Array, Grey
from calibrant.detection.chessboard.detector import board_seen
from calibrant.detection.circles.centres import true_centres
from calibrant.detection.circles.ellipse import refine_spots
from calibrant.detection.circles.lattice import Lattice, grow_lattices
from calibrant.detection.circles.layouts import Layout, is_other_kind, layouts_of, why_not_found
from calibrant.detection.circles.placement import Placement, least_dots, place
from calibrant.detection.circles.spots import Spots, find_spots
from calibrant.detection.detection import Detection
from calibrant.detection.local_homography import fit_local_maps
from calibrant.detection.opencv import shrink
from calibrant.errors import InputError
from calibrant.targets.circles import Circles
from calibrant.targets.target import Target

FIRST_LONGEST_PX = 640
"""Longest side of the first scale: dots of a 20x20 grid that fills half of the picture still measure 8 px."""
WINDOWS = (1 / 30, 1 / 10, 1 / 100, 1 / 4)
BIG_DOT_WINDOWS = (1 / 15, 1 / 6, 1 / 40, 1 / 3)
"""Windows of the threshold over the picture's longest side: a window must hold a dot, and not reach over the paper's
edge more than it must; a big dot needs one about twice as wide. The likeliest first."""
LEAST_CONTRAST = 3.0
"""Half the difference of dot and paper, grey levels: three times the rounding of 8 bits."""
MOST_MISFIT = 0.35
"""Residuals of the ellipse's model over its contrast: noise of a sixth of the whole step; letters are worse."""
CENTRE_SIGMA_PX = 0.1
"""What fitted centres are trusted when they predict each other."""
AGREEMENT_STEPS = 0.08
"""A dot lies where those around it predict, in steps: a lens bends a grid by a hundredth between neighbours."""
ENOUGH = 0.8
"""Of the dots: with as many, other windows are not tried. Pieces that fit elsewhere, too, are smaller."""
SAME_DOT_PX = 3.0
"""A dot's rough centre and its fitted one."""
LEAST_FIT = 0.7
"""Of the dots placed whose ellipses must fit: else it is a grid of something else."""


class CirclesDetector:
    """Finds grids of circles, whole or in part. Registered in `detection/registry.py`."""

    def detect(self, grey: Grey, target: Target) -> Detection:
        """The dots' centres in a grey image (h, w), with their standard deviations.

        Raises: InputError when the target is not a grid of circles.
        """
        if not isinstance(target, Circles):
            raise InputError(f"the detector of circles was given a target of kind {target.kind!r}")
        seen: list[Layout] = []
        for negative in (target.inverted, not target.inverted):
            picture = np.asarray(255 - grey, np.uint8) if negative else grey
            # A wrong colour in the spec is looked for with the likeliest windows alone.
            windows: tuple[float, ...] = BIG_DOT_WINDOWS if target.bigdot else WINDOWS
            windows = windows if negative == target.inverted else windows[:2]
            best: Detection | None = None
            first = max(1, round(max(grey.shape) / FIRST_LONGEST_PX))
            for factor in dict.fromkeys((first, 1)):
                detection = _at_scale(picture, target, factor, windows, seen, darkness=255.0 if negative else 0.0)
                if detection is not None and (best is None or len(detection.uv) > len(best.uv)):
                    best = detection
                # Dots that are too small for one scale may show at the next.
                if best is not None and len(best.uv) == len(target.points):
                    break
                # Squares are spots too, of lattices that may fit the grid's: looked for before all else is tried.
                first_look = best is None and factor == first and negative == target.inverted
                if first_look and (board := _board_of_squares(grey, first)) is not None:
                    return Detection.nothing(
                        f"the image looks like {board}, you asked for {target.spec}", looks_like=board, another=True
                    )
                # What fills a layout of the other kind is not looked for at full size, by every window, and negative.
                if best is None and is_other_kind(seen, target):
                    return why_not_found(seen, target)
            if best is not None:
                return _with_notes(best, target, negative=negative)
        return why_not_found(seen, target)


def _board_of_squares(grey: Grey, factor: int) -> str | None:
    """The board whose squares are spots as well; a chessboard is looked for in the picture made smaller by `factor`."""
    from calibrant.detection.tags.grid_seen import aprilgrid_seen  # not needed where the board is found

    if (tags := aprilgrid_seen(grey)) is not None:
        return tags
    found = board_seen(np.ascontiguousarray(shrink(grey, factor)))
    return None if found is None else "a chessboard (or ChArUco board) of {}x{} inner corners".format(*found)


def _at_scale(
    picture: Grey,
    target: Circles,
    factor: int,
    windows: tuple[float, ...],
    seen: list[Layout],
    *,
    darkness: float,
) -> Detection | None:
    """Dots found in the picture made smaller by `factor`, by windows of one size after the other.

    Args: seen: gets the layouts of other grids; darkness: grey value where no light falls.
    """
    level = np.ascontiguousarray(shrink(picture, factor))
    found: list[Detection] = []
    unclear: list[Array] = []
    for part in windows:
        spots = find_spots(level, window_px=max(9, round(part * max(level.shape)))).scaled(factor)
        for lattice in grow_lattices(spots, with_big=target.bigdot):
            uv = spots.uv[lattice.spots]
            placement = place(target, lattice, uv, (picture.shape[1], picture.shape[0]))
            if isinstance(placement, str):
                unclear.append(uv)
                seen += layouts_of(lattice, inverted=darkness > 0)
                continue
            detection = _measured(picture, target, spots, lattice, placement, darkness=darkness)
            if not detection.found:
                continue
            if len(detection.uv) == len(target.points):
                return detection
            found.append(detection)
        # A window too small for the big dot leaves it out, or the near dots of a tilted grid; another may show them.
        if found and len(found[-1].uv) > ENOUGH * len(target.points) and _with_origin(found[-1], target):
            break
    whole = [d for d in found if not any(_is_piece(d, uv) for uv in unclear)]
    best = max(whole, key=lambda d: (_with_origin(d, target), len(d.uv)), default=None)
    return None if best is None or any(_contradicts(best, other) for other in whole) else best


def _with_origin(detection: Detection, target: Circles) -> bool:
    return not target.bigdot or int(detection.point_ids[0]) == int(target.point_ids[0])


def _is_piece(detection: Detection, uv: Array) -> bool:
    """Whether the dots found are some of a larger lattice's (n, 2) px, of which it was not clear where on the target.

    A piece of a grid shows fewer dots than there are, and fits where the whole does not.
    """
    if len(uv) <= len(detection.uv):
        return False
    away = np.asarray(cKDTree(uv).query(detection.uv)[0])
    return bool(np.count_nonzero(away < SAME_DOT_PX) > 0.5 * len(away))


def _contradicts(detection: Detection, other: Detection) -> bool:
    """Whether a grid at least half as large gives most of the same dots other numbers."""
    away, nearest = cKDTree(detection.uv).query(other.uv)
    same = np.asarray(away) < SAME_DOT_PX
    alike = detection.point_ids[np.asarray(nearest)[same]] == other.point_ids[same]
    return bool(2 * len(other.uv) >= len(detection.uv) and np.count_nonzero(~alike) > 0.5 * len(other.uv))


def _measured(
    grey: Grey, target: Circles, spots: Spots, lattice: Lattice, placement: Placement, *, darkness: float
) -> Detection:
    order = np.argsort(placement.index)
    order = order[placement.index[order] >= 0]
    index, chosen = placement.index[order], lattice.spots[order]
    rough = Spots(spots.uv[chosen], spots.shape[chosen], spots.area[chosen])
    ellipses = refine_spots(grey, rough, room=_room(spots, chosen), darkness=darkness)
    good = (
        np.isfinite(ellipses.sigma_px)
        & (ellipses.contrast > LEAST_CONTRAST)
        & (ellipses.noise < MOST_MISFIT * ellipses.contrast)
    )
    steps = target.steps[index].astype(np.float64)
    while good.sum() >= max(least_dots(target), LEAST_FIT * len(index)):
        maps = fit_local_maps(steps, steps[good], ellipses.uv[good], np.full(int(good.sum()), CENTRE_SIGMA_PX))
        # The maps predict where neighbours' ellipses put this one's centre; both are moved alike.
        error = np.linalg.norm(maps.centres - ellipses.uv, axis=1) / maps.square_px
        excess = np.where(maps.determined & good, error / np.maximum(AGREEMENT_STEPS, 1.0 / maps.square_px), 0.0)
        if excess.max() <= 1.0:
            sigma = ellipses.sigma_px[good]
            uv, sigma = true_centres(steps[good], ellipses.uv[good], ellipses.shape[good], sigma)
            return Detection(target.point_ids[index[good]], uv, sigma)
        good &= excess < max(1.0, 0.7 * excess.max())
    return Detection.nothing("a grid of spots was seen, but they are not round enough, or too blurred, to be dots")


def _room(spots: Spots, chosen: NDArray[np.int64]) -> Array:
    """How far each dot's window may reach, in half axes: halfway to the outline of the nearest spots."""
    near = np.asarray(cKDTree(spots.uv).query(spots.uv[chosen], k=min(7, len(spots)))[1])[:, 1:]
    offset = spots.uv[near] - spots.uv[chosen][:, None]
    away = np.sqrt(np.einsum("nki,nij,nkj->nk", offset, np.linalg.inv(spots.shape[chosen]), offset))
    other = np.sqrt(spots.area[near] / spots.area[chosen][:, None])
    # Specks inside the dot itself are no neighbours.
    gap = np.where(away > 1.0, 1.0 + 0.5 * (away - 1.0 - other), np.inf)
    return np.maximum(gap.min(axis=1), 1.2)


def _with_notes(detection: Detection, target: Circles, *, negative: bool) -> Detection:
    notes = []
    if negative != target.inverted:
        colours = "light dots on a dark ground: add :inverted" if negative else "dark dots: leave :inverted out"
        notes.append(f"The grid has {colours} in the spec to say so.")
    if target.turns_unnoticed_deg is not None:
        notes.append(
            f"A grid of {target.columns}x{target.rows} circles looks the same turned by {target.turns_unnoticed_deg}°: "
            "circles are numbered with x running right or down in the image. hand-eye tells by the robot's motion "
            "which way it is; elsewhere keep its turn about the viewing direction within ±45° of upright in all views, "
            "or use one with a big dot, or an asymmetric one of odd rows."
        )
    return replace(detection, notes=tuple(notes))
