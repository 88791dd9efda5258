"""Pictures of a room: a box seen from inside, with panels on its walls, all edges along three orthogonal directions.

A ray of the camera meets the wall whose distance along it is least; what is painted there is the grey of the pixel. A
pixel whose corners and middle meet the same paint takes its grey, any other the mean over 64 points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.opencv import cv2

_SAMPLES = 8
"""Along each side of a pixel on an edge."""


@dataclass(frozen=True, eq=False)
class Room:
    """A box with the camera in its middle: half (3,) its half widths, metres.

    panels (6, k, 4): low and high corners of the panels on each wall (-x, +x, -y, +y, -z, +z) in the two coordinates
    that vary there; greys (6, k + 1), the wall's own first.
    """

    half: Array
    panels: Array
    greys: Array


def room(rng: np.random.Generator, *, half: tuple[float, float, float] = (2.0, 1.4, 3.0), panels: int = 7) -> Room:
    """A room with panels (windows, doors, cupboards) at random places on each wall."""
    size = np.array(half)
    corners = np.empty((6, panels, 4))
    for wall in range(6):
        reach = np.delete(size, wall // 2)
        middle = rng.uniform(-0.8, 0.8, (panels, 2)) * reach
        extent = rng.uniform(0.08, 0.35, (panels, 2)) * reach
        corners[wall] = np.concatenate([middle - extent, middle + extent], axis=1)
    return Room(size, corners, rng.uniform(30, 225, (6, panels + 1)))


def render_room(
    scene: Room,
    camera: Camera,
    R_camera_scene: Array,
    *,
    rng: np.random.Generator,
    blur_px: float = 0.7,
    noise_grey: float = 2.0,
) -> NDArray[np.uint8]:
    """The picture (h, w) of a room from its middle, by a camera turned by R_camera_scene (3, 3)."""
    width, height = camera.image_size
    corners = np.stack(np.meshgrid(np.arange(width + 1) - 0.5, np.arange(height + 1) - 0.5), axis=-1)
    middles = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).astype(np.float64)
    at_corners, at_middles = (_paint(scene, camera, R_camera_scene, uv) for uv in (corners, middles))
    image = _grey(scene, at_middles)
    around = (at_corners[:-1, :-1], at_corners[1:, :-1], at_corners[:-1, 1:], at_corners[1:, 1:])
    mixed = np.any([a != at_middles for a in around], axis=0)
    inside = (np.arange(_SAMPLES) + 0.5) / _SAMPLES - 0.5
    offsets = np.stack(np.meshgrid(inside, inside), axis=-1).reshape(-1, 2)
    fine = _paint(scene, camera, R_camera_scene, middles[mixed][:, None] + offsets)
    image[mixed] = _grey(scene, fine).mean(axis=-1)
    if blur_px > 0:
        image = np.asarray(cv2.GaussianBlur(image, (0, 0), blur_px))
    image = image + noise_grey * rng.standard_normal(image.shape)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def _paint(scene: Room, camera: Camera, R_camera_scene: Array, uv: Array) -> NDArray[np.int64]:
    """What the rays of pixels (…, 2) meet: wall * (panels + 1) + panel, panel 0 being the wall itself."""
    rays = camera.unproject(uv) @ R_camera_scene
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = scene.half / np.abs(rays)
    axis = np.argmin(np.where(np.isfinite(distance), distance, np.inf), axis=-1)
    reach = np.take_along_axis(distance, axis[..., None], axis=-1)
    hit = np.where(np.isfinite(reach), reach, 0.0) * rays
    wall = 2 * axis + (np.take_along_axis(rays, axis[..., None], axis=-1)[..., 0] > 0)
    count = scene.panels.shape[1]
    out = wall * (count + 1)
    others = np.array([[1, 2], [0, 2], [0, 1]])
    a, b = (np.take_along_axis(hit, others[axis][..., k, None], axis=-1)[..., 0] for k in (0, 1))
    for panel in range(count):
        low_a, low_b, high_a, high_b = np.moveaxis(scene.panels[wall, panel], -1, 0)
        painted = (a > low_a) & (a < high_a) & (b > low_b) & (b < high_b)
        out = np.where(painted, wall * (count + 1) + panel + 1, out)
    return out


def _grey(scene: Room, paint: NDArray[np.int64]) -> Array:
    return scene.greys.reshape(-1)[paint]
