"""What a camera that stands sees every day: a wall with things on it, photographed in another light, from where it was
pushed to, with something in front that does not stay where it is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.opencv import cv2
from calibrant.simulate.background import clutter
from calibrant.simulate.render import pixel_rays

_FINER = 2
"""Texels of the wall a pixel: an edge is then no coarser than the lens's blur."""
_MARGIN = 1.25
"""The wall is larger than the picture, so that a pushed camera still looks at it."""


@dataclass(frozen=True, eq=False)
class Wall:
    """A plane at z = distance (metres) before the camera as it stood, its drawing (h, w) of grey 0..1, and how many
    metres a texel is."""

    drawing: NDArray[np.float32]
    distance: float
    texel: float


def wall(camera: Camera, *, rng: np.random.Generator, distance: float = 1.5, shapes: int = 120) -> Wall:
    """A wall that fills the picture of a camera. Args: distance, metres; shapes: sharp things on it."""
    width, height = (round(_MARGIN * _FINER * n) for n in camera.image_size)
    texel = distance / float(camera.parameters["fx"]) / _FINER
    return Wall(clutter((width, height), shapes=shapes, rng=rng), distance, texel)


def photograph_wall(
    scene: Wall,
    camera: Camera,
    T_then_now: Array,
    *,
    rng: np.random.Generator,
    box: tuple[int, int, NDArray[np.float32]] | None = None,
    uneven_light: float = 0.3,
    noise_grey: float = 3.0,
) -> NDArray[np.uint8]:
    """The photo (h, w) of a camera at T_then_now (4, 4) from where it stood.

    box: column, row and drawing (h, w) of something in front of the wall, in pixels; uneven_light: relative fall of the
    light, in a direction and with an exposure of this photo's own.
    """
    width, height = camera.image_size
    rays = pixel_rays(camera) @ T_then_now[:3, :3].T
    origin = T_then_now[:3, 3]
    along = (scene.distance - origin[2]) / rays[..., 2]
    at = (origin[:2] + along[..., None] * rays[..., :2]) / scene.texel
    rows, columns = scene.drawing.shape
    u, v = ((at[..., k] + n / 2).astype(np.float32) for k, n in ((0, columns), (1, rows)))
    image = np.asarray(cv2.remap(scene.drawing, u, v, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT))
    if box is not None:
        column, row, drawing = box
        image[row : row + drawing.shape[0], column : column + drawing.shape[1]] = drawing
    turn = rng.uniform(0, 2 * np.pi)
    x, y = np.linspace(-1, 1, width)[None, :], np.linspace(-1, 1, height)[:, None]
    ramp = 1 - uneven_light * (0.5 + 0.35 * (np.cos(turn) * x + np.sin(turn) * y))
    image = (20 + 205 * image) * ramp * rng.uniform(0.75, 1.1)
    image = cv2.GaussianBlur(image.astype(np.float32), (0, 0), 0.8)
    image = image + noise_grey * rng.standard_normal(image.shape)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)
