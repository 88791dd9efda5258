"""A wrong marker size of a ChArUco board: the markers measured on the board that its corners define.

The four corners of each marker are carried along their rays into the board's plane; their sides over the side given.
Only the corners are used for calibration, so that a wrong marker size misleads those who use the markers alone.
"""

from __future__ import annotations

from itertools import islice

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from calibrant.data import Measured, View
from calibrant.diagnose.doctor.case import Case
from calibrant.diagnose.doctor.finding import Finding
from calibrant.errors import CalibrantError
from calibrant.geometry import se3
from calibrant.targets.charuco import Charuco
from calibrant.targets.registry import parse_target

Array = NDArray[np.float64]

PICTURES = 2
"""Pictures looked at again: each shows a dozen markers, and their corners are searched anew."""
OUTLINE_PX = 1.0
"""A marker's outline runs through the middles of its outermost pixels: each side comes out one pixel short."""
UNSURE_PX, UNSURE_SHARE = 2.0, 0.03
"""Blur and the grey of the edges move it by up to two pixels more, of some tens; 3 % on top is a printed size."""
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
    if abs(value - 1) < max(unsure, sigma * float(stdtrit(len(found) - 1, 0.999))):
        return []
    message = (
        f"the markers measure {1e3 * value * target.marker:.3g} +- {1e3 * sigma * target.marker:.1g} mm if the squares "
        f"measure {1e3 * target.square:.4g} mm, but {1e3 * target.marker:.4g} mm were given; this calibration uses the "
        "corners of the squares alone and is not affected"
    )
    return [
        Finding("marker-size", "warn", message, 0.999, measured=Measured(value * target.marker, sigma * target.marker),
                proposal="measure a marker and correct the target's spec")
    ]  # fmt: skip


def _charuco(case: Case) -> Charuco | None:
    """The board, when it is one and its pictures are at hand."""
    if case.observations is None or case.observations.target is None or case.data.views is None:
        return None
    target = parse_target(case.observations.target)
    return target if isinstance(target, Charuco) else None


def _sides(case: Case, row: int, target: Charuco) -> tuple[Array, Array]:
    """Sides of the markers in one picture: over the side given, and in pixels."""
    from calibrant.detect.images import load_grey
    from calibrant.detect.opencv import ALL_WINDOWS, find_markers

    view: View = case.data.views[row]  # type: ignore[index]
    nothing = np.zeros(0), np.zeros(0)
    if view.file is None:
        return nothing
    try:
        markers = find_markers(load_grey(view.file), target.dictionary, windows=ALL_WINDOWS)
    except CalibrantError:  # the picture has gone since: then there is nothing to measure
        return nothing
    quads = [m for i, m in zip(markers.ids, markers.corners) if 0 <= i < target.marker_count]
    if not quads:
        return nothing
    uv = np.stack(quads).astype(np.float64)
    pixels, metres = (_lengths(corners) for corners in (uv, _on_board(case, row, uv)))
    share = metres / (target.marker * case.scale) * (1 + OUTLINE_PX / pixels)
    good = np.isfinite(share)
    return share[good], pixels[good]


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
