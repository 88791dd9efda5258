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
MATTERS = 0.05
"""Corners of a marker are found to about a pixel, in or out, of some tens: 5 % is the least that is its size."""
LEAST_SIDES = 12


def examine(case: Case) -> list[Finding]:
    """Do the markers have the size given, relative to the squares?"""
    target = _charuco(case)
    if target is None or case.camera is None:
        return []
    best = sorted(case.index, key=lambda i: -len(case.data.views[i]))  # type: ignore[index]
    sides = [_sides(case, int(i), target) for i in islice(best, PICTURES)]
    found = np.concatenate([np.zeros(0), *sides])
    if len(found) < LEAST_SIDES:
        return []
    value = float(np.median(found))
    sigma = 1.4826 * float(np.median(np.abs(found - value))) / np.sqrt(len(found))
    if abs(value - 1) < max(MATTERS, sigma * float(stdtrit(len(found) - 1, 0.999))):
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


def _sides(case: Case, row: int, target: Charuco) -> Array:
    """Sides of the markers in one picture, over the side given."""
    from calibrant.detect.images import load_grey
    from calibrant.detect.opencv import ALL_WINDOWS, find_markers

    view: View = case.data.views[row]  # type: ignore[index]
    if view.file is None:
        return np.zeros(0)
    try:
        markers = find_markers(load_grey(view.file), target.dictionary, windows=ALL_WINDOWS)
    except CalibrantError:  # the picture has gone since: then there is nothing to measure
        return np.zeros(0)
    quads = [m for i, m in zip(markers.ids, markers.corners) if 0 <= i < target.marker_count]
    if not quads:
        return np.zeros(0)
    corners = _on_board(case, row, np.stack(quads))
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1).reshape(-1) / (target.marker * case.scale)
    return sides[np.isfinite(sides)]


def _on_board(case: Case, row: int, uv: Array) -> Array:
    """Pixels (k, 4, 2) on the board's plane: (k, 4, 2) metres, target frame."""
    rays = case.camera.unproject(uv.reshape(-1, 2).astype(np.float64))  # type: ignore[union-attr]
    T_target_camera = se3.inverse(case.data.B[row])
    origin, direction = T_target_camera[:3, 3], rays @ T_target_camera[:3, :3].T
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = -origin[2] / direction[:, 2]
    return (origin + reach[:, None] * direction)[:, :2].reshape(-1, 4, 2)
