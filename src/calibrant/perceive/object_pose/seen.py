"""What a colour picture and a depth picture show around one segment, ready to be compared with a shape."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array, Mask
from calibrant.errors import RefusedError
from calibrant.geometry import se3
from calibrant.opencv import cv2
from calibrant.perceive.colour.segments import Segment
from calibrant.perceive.registered_depth.noise import DepthNoise
from calibrant.perceive.registered_depth.planes import Plane, find_plane, rays_of
from calibrant.perceive.registered_depth.register import DepthRig, RegisteredDepth, register_depth

RIM_PX = 2
"""Depths this near to an outline mix object and background: a matching window's or an interpolation's reach."""
AROUND = 1.5
"""The table is looked for around the segment's box, by this many of its sizes to each side, and 40 pixels at least."""
_LEAST_AROUND_PX = 40
_APART_PX = 4


@dataclass(frozen=True, eq=False)
class Scene:
    """A picture with depth. colour (h, w, 3) float32; rig; registered: the depth in the colour picture's grid;
    staircase: height of the steps that edges have in the picture, px.

    It is 1 where a pixel is one sample of the scene, as renderers without multisampling draw, and the safe figure where
    nothing is known; 1/4 where it averages 4 x 4; 0 where lens and pixel blur before anything is sampled.
    """

    colour: NDArray[Any]
    rig: DepthRig
    registered: RegisteredDepth
    staircase: float = 1.0

    @classmethod
    def of(
        cls,
        colour: NDArray[Any],
        depth: NDArray[Any],
        rig: DepthRig,
        *,
        noise: DepthNoise,
        staircase: float = 1.0,
    ) -> Scene:
        """Raises: InputError, RefusedError as `register_depth`."""
        return cls(colour.astype(np.float32), rig, register_depth(depth, rig, noise=noise), staircase)

    @property
    def noise(self) -> DepthNoise:
        """As expected of the depth camera."""
        return self.registered.noise

    @cached_property
    def rays(self) -> Array:
        """Of the depth camera's pixels (h, w, 3), z = 1."""
        return rays_of(self.rig.depth)

    @cached_property
    def lands(self) -> NDArray[np.int64]:
        """Colour pixel (h, w), flat index, where each depth pixel lands; -1 for none."""
        z = self.registered.depth
        if self.rig.is_aligned:
            return np.where(np.isfinite(z), np.arange(z.size).reshape(z.shape), -1)
        width, height = self.rig.colour.image_size
        p = se3.apply(self.rig.T_colour_depth, self.rays * z[..., None])
        uv = np.rint(np.nan_to_num(self.rig.colour.project(p), nan=-1.0)).astype(np.int64)
        inside = (uv >= 0).all(axis=-1) & (uv[..., 0] < width) & (uv[..., 1] < height) & np.isfinite(z)
        return np.where(inside, uv[..., 1] * width + uv[..., 0], -1)

    def depth_pixels(self, mask: Mask) -> Mask:
        """The depth camera's pixels that land within a mask of the colour picture."""
        return np.asarray((self.lands >= 0) & mask.ravel()[np.maximum(self.lands, 0)])

    def table(self, segment: Segment, others: Sequence[Segment] = ()) -> Plane:
        """The plane around a segment, depth camera's frame. Raises: RefusedError as `find_plane`."""
        x, y, w, h = segment.box
        more = round(max(AROUND * max(w, h), _LEAST_AROUND_PX))
        height, width = segment.mask.shape
        around = np.zeros((height, width), dtype=np.bool_)
        around[max(y - more, 0) : y + h + more, max(x - more, 0) : x + w + more] = True
        size = 2 * _APART_PX + 1
        for s in (segment, *others):
            around &= cv2.dilate(s.mask.astype(np.uint8), np.ones((size, size), np.uint8)) == 0
        region = self.depth_pixels(around)
        return find_plane(self.registered.depth, self.rays, region, noise=self.noise)

    def inner(self, segment: Segment) -> Mask:
        """The depth camera's pixels that see the segment's inside."""
        size = 2 * RIM_PX + 1
        return self.depth_pixels(cv2.erode(segment.mask.astype(np.uint8), np.ones((size, size), np.uint8)) > 0)


def require_depth(scene: Scene, inner: Mask, table: Plane | None) -> None:
    """Raises: RefusedError where neither the object nor the table below it has depth."""
    if not inner.any() and table is None:
        raise RefusedError(
            "there is no depth on the object and no table around it: nothing tells how far it is. Too near for the "
            "depth camera, too shiny, or the depth of another picture?"
        )
