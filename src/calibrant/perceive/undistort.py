"""Undistortion: an image as another camera, mostly a pinhole, would have taken it from the same place.

    p = unproject_output(u, v),  (u', v') = project_source(p),  output(u, v) = source(u', v')

by bilinear interpolation at 1/32 px, the grid that OpenCV's undistort uses, so that the pixels are the same as its
where it has the model (document 000, slide on undistortion; OpenCV manual, initUndistortRectifyMap). Any camera model
serves on either side. Pixels without a source, outside of the image or of the model's valid field, are black.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array, Mask
from calibrant.cameras import Camera
from calibrant.errors import InputError
from calibrant.opencv import cv2
from calibrant.perceive.rectangles import Rectangle, largest_rectangle

STEPS = 32
"""OpenCV's remap interpolates at 1/32 px."""
NO_SOURCE = -1.0
"""What the maps hold where there is no source: a pixel and a neighbour outside of every image, which gives black."""
_PIXELS_AT_ONCE = 100_000
"""Rows of the map that are computed together: their intermediate arrays stay below a hundred megabytes."""
_FARTHEST = 32_000.0
"""Pixels are stored in 16 bits; farther ones are outside of every image anyway."""


@dataclass(frozen=True, eq=False)
class Maps:
    """From an output image to a source image: source, the camera; map_u, map_v (h, w): source pixel of every output
    pixel, NaN where there is none."""

    source: Camera
    map_u: Array
    map_v: Array

    def apply(self, image: NDArray[Any]) -> NDArray[Any]:
        """The image of the output camera, of the image's own depth and channels.

        image (h, w) or (h, w, channels) of the source camera, 8 or 16 bits or floating point.
        Raises: InputError for an image of another size than the source camera's.
        """
        self.require(image)
        whole, fraction = self._fixed_point()
        return cv2.remap(image, whole, fraction, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=0)

    def require(self, image: NDArray[Any]) -> None:
        """Raises: InputError for an image (h, w, ...) of another size than the source camera's."""
        height, width = image.shape[:2]
        if (width, height) != self.source.image_size:
            w, h = self.source.image_size
            raise InputError(f"the image is {width}x{height} px, the camera is for images of {w}x{h} px")

    def _fixed_point(self) -> tuple[NDArray[np.int16], NDArray[np.uint16]]:
        """The maps as remap wants them: whole pixels, and the 32nds of u and v in one number."""
        u, v = (np.rint(np.clip(m, -_FARTHEST, _FARTHEST) * STEPS).astype(np.int32) for m in self.finite_maps())
        fraction = (v & (STEPS - 1)) * STEPS + (u & (STEPS - 1))
        return np.stack([u >> 5, v >> 5], axis=-1).astype(np.int16), fraction.astype(np.uint16)

    def finite_maps(self) -> tuple[Array, Array]:
        """The maps (h, w) with `NO_SOURCE` in place of NaN, for cv2.remap in other programs."""
        u, v = (np.where(np.isnan(m), NO_SOURCE, m) for m in (self.map_u, self.map_v))
        return u, v

    @property
    def valid(self) -> Mask:
        """Which output pixels (h, w) have a source: the four pixels it is interpolated from lie in the image."""
        width, height = self.source.image_size
        rim = 0.5 / STEPS  # what is that close to the outermost pixel's centre is taken from there
        with np.errstate(invalid="ignore"):
            across = (self.map_u >= -rim) & (self.map_u <= width - 1 + rim)
            return across & (self.map_v >= -rim) & (self.map_v <= height - 1 + rim)

    @property
    def region(self) -> Rectangle:
        """A largest rectangle of output pixels that all have a source."""
        return largest_rectangle(self.valid)


@dataclass(frozen=True, eq=False)
class Undistortion(Maps):
    """The maps to the images of another camera, `output`, at the same place; build it with `undistortion`."""

    output: Camera


def undistortion(source: Camera, output: Camera) -> Undistortion:
    """The maps that turn images of `source` into images of `output`, for cameras at the same place.

    Raises: InputError for a camera of parallel rays.
    """
    _refuse_parallel_rays(output)
    maps = maps_of(source, output.unproject, output.image_size)
    return Undistortion(source, maps.map_u, maps.map_v, output)


def maps_of(source: Camera, rays: Callable[[Array], Array], image_size: tuple[int, int]) -> Maps:
    """The maps to an output image whose pixels (..., 2) see along `rays` (..., 3) of the source camera's frame.

    image_size: (width, height) of the output; rays of NaN have no source. Raises: InputError for a source of parallel
    rays.
    """
    _refuse_parallel_rays(source)
    width, height = image_size
    maps = np.empty((2, height, width))
    rows = max(1, _PIXELS_AT_ONCE // width)
    for first in range(0, height, rows):
        last = min(height, first + rows)
        u, v = np.meshgrid(np.arange(width, dtype=np.float64), np.arange(first, last, dtype=np.float64))
        maps[:, first:last] = np.moveaxis(_seen_along(source, rays(np.stack([u, v], axis=-1))), -1, 0)
    maps.setflags(write=False)
    return Maps(source, maps[0], maps[1])


def _refuse_parallel_rays(camera: Camera) -> None:
    if camera.model.projection == "parallel":
        raise InputError(
            f"a camera of the {camera.model.name} model has parallel rays, which no other camera has; its images "
            "are not distorted"
        )


def _seen_along(source: Camera, rays: Array) -> Array:
    """Pixels (..., 2) of `source` that see along rays (..., 3); NaN where none does."""
    known: Mask = np.asarray(np.isfinite(rays).all(axis=-1))
    p = np.where(known[..., None], rays, [0.0, 0.0, 1.0])
    # Beyond the fold of a polynomial the same picture comes again, mirrored.
    known &= source.model.sees(source.values, p) & source.model.inside(source.values, p)
    return np.where(known[..., None], source.project(p), np.nan)
