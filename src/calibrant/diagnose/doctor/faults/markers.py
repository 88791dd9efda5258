"""A wrong marker size of a ChArUco board: the markers measured on the board that its corners define.

The four corners of each marker are carried along their rays into the board's plane; their sides over the side given.
Only the corners are used for calibration, so that a wrong marker size misleads those who use the markers alone.
"""

from __future__ import annotations

from itertools import islice
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.data import Measured, View
from calibrant.diagnose.doctor.evidence.case import Case
from calibrant.diagnose.doctor.evidence.finding import Finding
from calibrant.errors import CalibrantError
from calibrant.geometry import se3
from calibrant.optimize.chances import t_tail

if TYPE_CHECKING:
    from calibrant.targets.charuco import Charuco

PICTURES = 2
"""Pictures looked at again: each shows a dozen markers, and their corners are searched anew."""
UNSURE_PX, UNSURE_SHARE = 1.0, 0.03
"""Overexposed paper eats up to half a pixel of ink on each side; 3 % on top is a printed size."""
SURE = 0.999
"""Probability that a difference is no chance, for it to be said."""
REACH_CELLS = 0.8
"""Profiles across an edge stay within the marker's border, one cell wide, and as far off the next square."""
LEAST_SIDES = 12


def examine(case: Case) -> list[Finding]:
    """Do the markers have the size given, relative to the squares?"""
    target = _charuco(case)
    if target is None or case.camera is None:
        return []
    best = sorted(case.index, key=lambda i: -len(case.data.views[i]))  # type: ignore[index]
    measured = [_sides(case, int(i), target) for i in islice(best, PICTURES)]
    found, pixels = (np.concatenate([np.zeros(0), *part]) for part in zip(*measured))
    if len(found) < LEAST_SIDES:
        return []
    value = float(np.median(found))
    sigma = 1.4826 * float(np.median(np.abs(found - value))) / np.sqrt(len(found))
    unsure = UNSURE_SHARE + UNSURE_PX / float(np.median(pixels))
    away = abs(value - 1)
    if away < unsure or (sigma > 0 and t_tail(len(found) - 1, away / sigma) > 1 - SURE):
        return []
    message = (
        f"the markers measure {1e3 * value * target.marker:.3g} ± {1e3 * sigma * target.marker:.1g} mm if the squares "
        f"measure {1e3 * target.square:.4g} mm, but {1e3 * target.marker:.4g} mm were given; this calibration uses the "
        "corners of the squares alone and is not affected"
    )
    return [
        Finding("marker-size", "warn", message, SURE, measured=Measured(value * target.marker, sigma * target.marker),
                proposal="measure a marker and correct the target's spec")
    ]  # fmt: skip


def _charuco(case: Case) -> Charuco | None:
    """The board, when it is one and its pictures are at hand."""
    if case.observations is None or case.observations.target is None or case.data.views is None:
        return None
    from calibrant.targets.charuco import Charuco
    from calibrant.targets.registry import parse_target

    target = parse_target(case.observations.target)
    return target if isinstance(target, Charuco) else None


def _sides(case: Case, row: int, target: Charuco) -> tuple[Array, Array]:
    """Sides of the markers in one picture: over the side given, and in pixels."""
    from calibrant.detection.images.images import load_grey

    view: View = case.data.views[row]  # type: ignore[index]
    nothing = np.zeros(0), np.zeros(0)
    if view.file is None:
        return nothing
    try:
        uv = _quads(load_grey(view.file), target)
    except CalibrantError:  # the picture has gone since: then there is nothing to measure
        return nothing
    if len(uv) == 0:
        return nothing
    pixels, metres = (_lengths(corners) for corners in (uv, _on_board(case, row, uv)))
    share = metres / (target.marker * case.scale)
    good = np.isfinite(share)
    return share[good], pixels[good]


def _quads(grey: NDArray[np.uint8], target: Charuco) -> Array:
    """The outlines (k, 4, 2) px of the board's markers in a picture, each side where its edge is."""
    from calibrant.detection.opencv import marker_cells
    from calibrant.detection.tags.quad_edges import refine_quads
    from calibrant.detection.tags.search import Effort, find_markers

    dark = np.asarray(255 - grey, np.uint8) if target.inverted else grey
    markers = find_markers(dark, target.dictionary, Effort(1))
    markers = markers.subset((markers.ids >= 0) & (markers.ids < target.marker_count))
    gap = 0.5 * (target.square / target.marker - 1.0)
    reach = REACH_CELLS * min(1.0 / len(marker_cells(target.dictionary, 0)), gap)
    uv, sigma = refine_quads(dark, markers.corners, reach=reach)
    return uv[np.isfinite(sigma).all(axis=1)]


def _lengths(corners: Array) -> Array:
    """Sides of quadrilaterals (k, 4, 2): (4 k,)."""
    return np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1).reshape(-1)


def _on_board(case: Case, row: int, uv: Array) -> Array:
    """Pixels (k, 4, 2) on the board's plane: (k, 4, 2) metres, target frame."""
    rays = case.camera.unproject(uv.reshape(-1, 2))  # type: ignore[union-attr]
    T_target_camera = se3.inverse(case.data.B[row])
    origin, direction = T_target_camera[:3, 3], rays @ T_target_camera[:3, :3].T
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = -origin[2] / direction[:, 2]
    return (origin + reach[:, None] * direction)[:, :2].reshape(-1, 4, 2)
