"""The one place that knows how OpenCV's versions differ (4.12 ... 5.x): dictionaries, markers, corner refinement.

Only what every one of these versions has is used: the classes of cv2.aruco, not its old free functions, which 5.0
dropped. Dictionaries are kept by name, never by OpenCV's numbers, which change between versions.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array, Grey
from calibrant.opencv import cv2
from calibrant.targets.apriltag3 import FAMILIES, tag_cells
from calibrant.targets.charuco import Charuco
from calibrant.targets.dictionaries import dictionary_name

VERSION = tuple(int(n) for n in cv2.__version__.split(".")[:2])
# Before 4.14 its CharucoDetector counted from the corner of the top left pixel, unlike the rest of the library
# (measured on drawn boards; a test watches it).
MOST_REMAPPED = 2**15 - 1
"""Pixels a side from which on OpenCV's remap refuses: it counts them in 16 bits."""
CHARUCO_OFFSET_PX = 0.5 if VERSION < (4, 14) else 0.0


@dataclass(frozen=True, eq=False)
class Markers:
    """Markers read in an image: ids (n,); corners (n, 4, 2) pixels, from the marker's own top left, clockwise."""

    ids: NDArray[np.int64]
    corners: Array

    def __len__(self) -> int:
        return len(self.ids)

    def subset(self, keep: NDArray[np.bool_]) -> Markers:
        """The markers where keep (n,) is true."""
        return Markers(self.ids[keep], self.corners[keep])

    @classmethod
    def of(cls, corners: Any, ids: Any) -> Markers:
        """Markers from what OpenCV returns: a sequence of (1, 4, 2) arrays and (n, 1) ids, or None."""
        if ids is None or len(ids) == 0:
            return cls(np.empty(0, np.int64), np.empty((0, 4, 2)))
        return cls(np.asarray(ids, np.int64).ravel(), np.asarray(corners, np.float64).reshape(-1, 4, 2))


@lru_cache(maxsize=64)
def dictionary(name: str) -> Any:
    """OpenCV's dictionary of that name. Raises: InputError for an unknown one."""
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary_name(name)))


@lru_cache(maxsize=256)
def marker_cells(name: str, marker_id: int) -> NDArray[np.bool_]:
    """The marker's cells with its border of one cell, (bits + 2, bits + 2): true is paper, false is ink.

    A tag of one of AprilTag 3's families as it is printed, (total, total). Raises: as `tag_codes`.
    """
    if name in FAMILIES:
        return tag_cells(name, marker_id)
    side = int(dictionary(name).markerSize) + 2
    cells = np.asarray(cv2.aruco.generateImageMarker(dictionary(name), marker_id, side), dtype=np.uint8) > 127
    cells.setflags(write=False)
    return cells


def shrink(grey: Grey, factor: int) -> Grey:
    """The image made smaller by a whole factor, each pixel the mean of factor x factor."""
    if factor == 1:
        return grey
    size = (grey.shape[1] // factor, grey.shape[0] // factor)
    cropped = grey[: size[1] * factor, : size[0] * factor]
    return np.asarray(cv2.resize(cropped, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def sample(grey: Grey | NDArray[np.float32], uv: Array) -> Array:
    """Grey values at pixels (n, m, 2), bilinear, (n, m); outside the image the nearest pixel's."""
    if max(*grey.shape, *uv.shape[:2]) >= MOST_REMAPPED:
        return _sample_large(grey, uv)
    maps = np.asarray(uv, dtype=np.float32)
    return np.asarray(
        cv2.remap(grey, maps[..., 0], maps[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), np.float64
    )


def _sample_large(grey: Grey | NDArray[np.float32], uv: Array) -> Array:
    """As `sample`, for pictures and lists that OpenCV's remap does not take."""
    high = np.array(grey.shape[::-1]) - 1
    at = np.clip(np.nan_to_num(uv), 0, high)
    whole = np.minimum(at.astype(np.int64), np.maximum(high - 1, 0))
    u, v = np.moveaxis(whole, -1, 0)
    fu, fv = np.moveaxis(at - whole, -1, 0)
    right, below = np.minimum(u + 1, high[0]), np.minimum(v + 1, high[1])
    upper = (1.0 - fu) * grey[v, u] + fu * grey[v, right]
    return np.asarray((1.0 - fv) * upper + fv * ((1.0 - fu) * grey[below, u] + fu * grey[below, right]))


def refine_corners(grey: Grey, uv: Array, half_window_px: int) -> Array:
    """Corners (n, 2) moved to where the grey-value gradients of a square window around are orthogonal to the rays."""
    if len(uv) == 0:
        return np.empty((0, 2))
    start = np.ascontiguousarray(uv, dtype=np.float32).reshape(-1, 1, 2)
    # 30 steps of at least 1/500 px: below the noise of any corner, above single precision.
    stop = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 30, 0.002)
    window = (half_window_px, half_window_px)
    return np.asarray(cv2.cornerSubPix(grey, start, window, (-1, -1), stop), np.float64).reshape(-1, 2)


def charuco_corners(grey: Grey, target: Charuco) -> tuple[NDArray[np.int64], Array]:
    """Ids (n,) and pixels (n, 2) by OpenCV's own CharucoDetector, the one to compare with, in our pixel convention."""
    board = cv2.aruco.CharucoBoard(
        (target.columns, target.rows), target.square, target.marker, dictionary(target.dictionary)
    )
    board.setLegacyPattern(target.legacy)
    image = np.asarray(255 - grey, np.uint8) if target.inverted else grey
    uv, ids, _, _ = cv2.aruco.CharucoDetector(board).detectBoard(image)
    if ids is None or len(ids) == 0:
        return np.empty(0, np.int64), np.empty((0, 2))
    return np.asarray(ids, np.int64).ravel(), np.asarray(uv, np.float64).reshape(-1, 2) - CHARUCO_OFFSET_PX
