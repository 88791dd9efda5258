"""From an ideal pinhole picture to that of a lens: which larger pinhole picture to draw, and how to resample it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.opencv import cv2
from calibrant.simulate.render import pixel_rays

_MARGIN_PX = 2
"""Around what the lens sees: the neighbours that interpolation takes."""


@dataclass(frozen=True, eq=False)
class LensMap:
    """rays (h, w, 3) of the camera's pixels with z = 1; K and size of the pinhole picture that holds all of them; u, v
    (h, w) float32, where in it each pixel lies, or None where both are one; fixed: the same in whole numbers."""

    rays: Array
    K: Array
    size: tuple[int, int]
    u: NDArray[np.float32] | None
    v: NDArray[np.float32] | None
    fixed: tuple[NDArray[np.int16], NDArray[np.uint16]] | None = None

    def colour(self, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """The camera's picture out of the pinhole's."""
        if self.fixed is None:
            return picture
        out = cv2.remap(picture, *self.fixed, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(out, dtype=np.uint8)

    def depth(
        self, picture: NDArray[np.float32], rows: slice = slice(None), columns: slice = slice(None)
    ) -> NDArray[np.float32]:
        """The same for depth, or a part of it: of the nearest pixel, as depths of two things have no mean."""
        if self.u is None or self.v is None:
            return np.ascontiguousarray(picture[rows, columns])
        u, v = (np.ascontiguousarray(m[rows, columns]) for m in (self.u, self.v))
        out = cv2.remap(picture, u, v, cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(out, dtype=np.float32)


def lens_map(camera: Camera) -> LensMap:
    """For a camera whose field is below 180 degrees. The pinhole picture has the camera's own scale at its middle."""
    unit = pixel_rays(camera)
    rays = unit / unit[..., 2:]
    K = camera.K
    width, height = camera.image_size
    at = rays[..., :2] * np.array([K[0, 0], K[1, 1]]) + np.array([K[0, 2], K[1, 2]])
    grid = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)
    if np.abs(at - grid).max() < 1e-3:
        return LensMap(rays, K, (width, height), None, None)
    low = np.floor(at.min(axis=(0, 1))) - _MARGIN_PX
    high = np.ceil(at.max(axis=(0, 1))) + _MARGIN_PX
    shifted = K.copy()
    shifted[:2, 2] -= low
    size = (int(high[0] - low[0]) + 1, int(high[1] - low[1]) + 1)
    u, v = (np.ascontiguousarray((at - low)[..., k], dtype=np.float32) for k in (0, 1))
    # Places to 1/32 px, as OpenCV's interpolation of bytes has them anyway.
    whole, parts = cv2.convertMaps(u, v, cv2.CV_16SC2)
    fixed = (np.asarray(whole, dtype=np.int16), np.asarray(parts, dtype=np.uint16))
    return LensMap(rays, shifted, size, u, v, fixed)
