"""The steps from a picture to an object, one picture each: smoothed, enhanced, colour, edges, corners, found."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Mask
from calibrant.cameras import Camera
from calibrant.geometry import se3
from calibrant.opencv import cv2
from calibrant.perceive.colour.ranges import ColourRange
from calibrant.perceive.object_pose.poses import ObjectPose
from calibrant.perceive.object_pose.shapes import Shape

NAMES = ("1-smoothed", "2-enhanced", "3-colour", "4-segment", "5-edges", "6-corners", "7-found")
AXES = ((60, 60, 230), (60, 200, 60), (230, 120, 60))
"""Colours of x, y, z in BGR."""
_OUTLINE = (60, 220, 240)
_FRACTION = 4


def stages(
    image: NDArray[np.uint8],
    colour: ColourRange | None,
    segment: Mask,
    *,
    camera: Camera | None = None,
    shape: Shape | None = None,
    pose: ObjectPose | None = None,
) -> list[NDArray[np.uint8]]:
    """Pictures (h, w, 3) in the order of `NAMES`; the last only where a pose is given.

    image (h, w, 3) BGR; colour: the range that was looked for, None where depth cut the object out; segment (h, w).
    """
    smooth = np.asarray(cv2.bilateralFilter(image, 5, 30, 2), dtype=np.uint8)
    enhanced = _enhanced(smooth)
    mask = segment if colour is None else colour.mask(image)
    # What has the colour in grey, the rest black: the grey picture that is thresholded.
    extracted = np.where(mask, cv2.cvtColor(smooth, cv2.COLOR_BGR2GRAY), 0).astype(np.uint8)
    edges: NDArray[Any] = cv2.Canny(cv2.cvtColor(smooth, cv2.COLOR_BGR2GRAY), 40, 120)
    out = [smooth, enhanced, _three(extracted), _three(255 * segment.astype(np.uint8)), _three(edges)]
    out.append(_with_corners(smooth, segment))
    if camera is not None and shape is not None and pose is not None:
        out.append(drawn(image, camera, shape, pose))
    return out


def _three(grey: NDArray[Any]) -> NDArray[np.uint8]:
    return np.repeat(grey.astype(np.uint8)[..., None], 3, axis=2)


def _enhanced(image: NDArray[Any]) -> NDArray[np.uint8]:
    """Contrast spread tile by tile, colours kept (CLAHE on lightness)."""
    lab = cv2.cvtColor(image, cv2.COLOR_BGR2LAB)
    lab[..., 0] = cv2.createCLAHE(2.0, (8, 8)).apply(np.ascontiguousarray(lab[..., 0]))
    return np.asarray(cv2.cvtColor(lab, cv2.COLOR_LAB2BGR), dtype=np.uint8)


def _with_corners(image: NDArray[Any], segment: Mask) -> NDArray[np.uint8]:
    """The outline's corners: where its polygon, simplified by 2 % of its length, bends."""
    out = np.array(image)
    outlines, _ = cv2.findContours(segment.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    for line in outlines:
        polygon = cv2.approxPolyDP(line, 0.02 * cv2.arcLength(line, True), True)
        cv2.polylines(out, [polygon], True, _OUTLINE, 1, cv2.LINE_AA)
        for corner in polygon.reshape(-1, 2):
            cv2.circle(out, (int(corner[0]), int(corner[1])), 4, AXES[0], 1, cv2.LINE_AA)
    return np.asarray(out, dtype=np.uint8)


def drawn(image: NDArray[np.uint8], camera: Camera, shape: Shape, pose: ObjectPose) -> NDArray[np.uint8]:
    """The picture with the object's edges and axes over it."""
    out = np.ascontiguousarray(image.copy())
    edges, _ = shape.edges
    p = se3.apply(pose.matrix, shape.vertices)
    for ends in edges[:2000]:
        _line(out, camera.project(np.linspace(p[ends[0]], p[ends[1]], 9)), _OUTLINE, 1)
    length = 0.4 * shape.size
    for axis, colour in enumerate(AXES):
        tip = np.zeros(3)
        tip[axis] = length
        _line(out, camera.project(se3.apply(pose.matrix, np.linspace(np.zeros(3), tip, 9))), colour, 2)
    return np.asarray(out, dtype=np.uint8)


def _line(canvas: NDArray[np.uint8], uv: NDArray[Any], colour: tuple[int, int, int], width: int) -> None:
    if np.isfinite(uv).all() and np.abs(uv).max() < 30_000:
        points = np.rint(uv * 2**_FRACTION).astype(np.int32)
        cv2.polylines(canvas, [points], False, colour, width, cv2.LINE_AA, _FRACTION)
