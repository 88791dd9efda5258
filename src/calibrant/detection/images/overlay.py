"""A picture of what was found: every point, the order they are numbered in, the origin and the axes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calibrant.data import View
from calibrant.detection.images.images import to_grey8
from calibrant.opencv import cv2

POINT, ORDER, X_AXIS, Y_AXIS = (80, 220, 80), (200, 160, 60), (60, 60, 230), (60, 200, 60)
"""Colours in BGR; x red and y green, as axes are drawn everywhere."""
FRACTION_BITS = 4
"""OpenCV draws at sixteenths of a pixel."""


def draw(image: NDArray, view: View) -> NDArray[np.uint8]:
    """A copy (h, w, 3) BGR of an image (h, w) or (h, w, 3) with the points of a view drawn over it."""
    canvas = np.repeat(to_grey8(image)[..., np.newaxis], 3, axis=2)
    if len(view) == 0:
        return canvas
    # Drawn for a picture about 1000 pixels wide, and larger in larger ones.
    unit = max(canvas.shape[1] / 1000, 0.6)
    width = max(1, round(unit))
    order = np.argsort(view.point_ids)
    uv, points = view.uv[order], view.points[order]
    cv2.polylines(canvas, [_fixed(uv)], False, ORDER, width, cv2.LINE_AA, FRACTION_BITS)
    for at in uv:
        radius = int(4 * unit * 2**FRACTION_BITS)
        cv2.circle(canvas, tuple(int(v) for v in _fixed(at)), radius, POINT, width, cv2.LINE_AA, FRACTION_BITS)
    for axis, colour, name in ((0, X_AXIS, "x"), (1, Y_AXIS, "y")):
        end = _neighbour(points, axis)
        if end is not None:
            _arrow(canvas, uv[0], uv[end], colour, name, unit)
    for index in {0, len(uv) - 1}:
        write_label(canvas, str(int(view.point_ids[order][index])), uv[index], (255, 255, 255), unit)
    return canvas


def _fixed(uv: NDArray[np.float64]) -> NDArray[np.int32]:
    return np.rint(uv * 2**FRACTION_BITS).astype(np.int32)


def _neighbour(points: NDArray[np.float64], axis: int) -> int | None:
    """Index of the point furthest from the first along one axis of the target, on the same line; None without one."""
    offset = points - points[0]
    span = np.ptp(points, axis=0).max()
    on_line = (np.abs(np.delete(offset, axis, axis=1)).max(axis=1) < 1e-6 * span) & (offset[:, axis] > 0)
    candidates = np.flatnonzero(on_line)
    return None if len(candidates) == 0 else int(candidates[np.argmax(offset[candidates, axis])])


def _arrow(canvas: NDArray, start: NDArray, end: NDArray, colour: tuple[int, int, int], name: str, unit: float) -> None:
    first, last = (tuple(int(v) for v in np.rint(p)) for p in (start, end))
    tip = 12 * unit / max(float(np.linalg.norm(end - start)), 1.0)
    cv2.arrowedLine(canvas, first, last, colour, max(2, round(2 * unit)), cv2.LINE_AA, tipLength=min(tip, 0.3))
    write_label(canvas, name, end, colour, unit)


def write_label(canvas: NDArray, text: str, at: NDArray, colour: tuple[int, int, int], unit: float) -> None:
    """Text beside a pixel, drawn into a BGR canvas. Args: unit: as many pixels as one of a picture 1000 wide."""
    corner = (int(at[0] + 6 * unit), int(at[1] - 6 * unit))
    size = 0.55 * unit
    # A dark outline keeps the text readable on white squares.
    for shade, width in (((0, 0, 0), 3), (colour, 1)):
        cv2.putText(
            canvas, text, corner, cv2.FONT_HERSHEY_SIMPLEX, size, shade, max(1, round(width * unit)), cv2.LINE_AA
        )
