"""What cameras of scenes have in common: where they look, and their field of view in pixels.

T_world_optical = T_world_camera diag(1, -1, -1, 1)     a camera that looks along its -z, y up (OpenGL)
f = n / 2 / tan(fov / 2)                                n pixels over the angle fov
u = W/2 + shift - 1/2                                   pixel (0, 0) is the middle of the first one
"""

from __future__ import annotations

import math

import numpy as np

from calibrant.cameras import Camera
from calibrant.errors import InputError
from calibrant.formats.cameras.camera_format import MOST_PIXELS_A_SIDE, Size

TURNED = np.diag([1.0, -1.0, -1.0, 1.0])
"""Half a turn about x: between looking along -z with y up, and optical axes. It is its own inverse."""


def focal_of(pixels: float, angle_deg: float, where: str) -> float:
    """Focal length in pixels of an angle of view over so many. Raises: InputError for an angle beyond (0, 180)."""
    if not 0 < angle_deg < 180:
        raise InputError(f"{where}: a field of view of {angle_deg:g} degrees; expected between 0 and 180")
    return pixels / 2 / math.tan(math.radians(angle_deg) / 2)


def angle_of(pixels: float, focal_px: float) -> float:
    """The angle of view in degrees over so many pixels: inverse of `focal_of`."""
    return math.degrees(2 * math.atan(pixels / 2 / focal_px))


def pinhole(size: Size, focal: tuple[float, float], shift: tuple[float, float], where: str) -> Camera:
    """A camera of focal lengths (px) whose principal point lies `shift` (px, right and down) off the image's middle.

    Raises: InputError for focal lengths that are none, an image of no size.
    """
    if not all(0 < f < 1e12 for f in focal):
        raise InputError(f"{where}: focal lengths of {focal[0]:g} and {focal[1]:g} px; expected some above 0")
    if not all(1 <= n <= MOST_PIXELS_A_SIDE for n in size):
        raise InputError(f"{where}: images of {size[0]}x{size[1]} px; expected 1 to {MOST_PIXELS_A_SIDE} a side")
    cx, cy = (n / 2 + s - 0.5 for n, s in zip(size, shift))
    if not (-size[0] < cx < 2 * size[0] and -size[1] < cy < 2 * size[1]):
        raise InputError(f"{where}: the principal point ({cx:g}, {cy:g}) px lies beyond any shift of the lens")
    return Camera.create("pinhole", {"fx": focal[0], "fy": focal[1], "cx": cx, "cy": cy}, image_size=size)


def shift_of(camera: Camera) -> tuple[float, float]:
    """How far the principal point lies right and down of the image's middle, pixels: inverse of `pinhole`."""
    p = camera.parameters
    width, height = camera.image_size
    return p["cx"] + 0.5 - width / 2, p["cy"] + 0.5 - height / 2


def same_focal(camera: Camera, where: str) -> float:
    """The focal length of a camera with square pixels. Raises: InputError where fx and fy differ by what shows."""
    p, (width, height) = camera.parameters, camera.image_size
    off_px = abs(p["fx"] / p["fy"] - 1) * max(width, height) / 2
    if off_px > 1e-6:
        raise InputError(
            f"{where} has square pixels alone; fx = {p['fx']:.6g} and fy = {p['fy']:.6g} px differ by {off_px:.2g} px "
            "at the image's edge. Calibrate with the aspect ratio fixed, or write another format"
        )
    return float(p["fx"])
