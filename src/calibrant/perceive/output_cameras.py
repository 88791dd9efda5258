"""Which pinhole shall an undistorted image be of? The same scale at the axis, or as much of the picture as asked for.

    alpha = 0: every output pixel has a source;  alpha = 1: every source pixel is shown

as OpenCV's getOptimalNewCameraMatrix: the border of the source image, seen as x = X/Z, y = Y/Z, has an inner and an
outer rectangle; each fills the output image by its own fx, fy, cx, cy, and alpha goes from one to the other linearly.
"""

from __future__ import annotations

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.errors import InputError

Size = tuple[int, int]

BORDER_POINTS = 9
"""Points on each side of the border that are looked at, as OpenCV does, so that the cameras are the same."""
WIDEST_DEG = 75.0
"""Farthest from the axis that a pinhole is made to show: there it is stretched 15-fold (1 / cos^2), and at 90 degrees
without end. A fisheye's border is taken to be there where it lies beyond."""


def axis_camera(camera: Camera, *, image_size: Size | None = None) -> Camera:
    """The pinhole with the camera's scale and pixel at the axis, cv2.undistort's choice; scaled to another image size.

    fx, fy: pixels per radian at the axis, which are the camera's own fx, fy for perspective models.
    """
    _, J, _ = camera.model.project_with_jacobians(camera.values, [0.0, 0.0, 1.0])
    cx, cy = camera.project([0.0, 0.0, 1.0])
    size = image_size or camera.image_size
    sx, sy = size[0] / camera.image_size[0], size[1] / camera.image_size[1]
    # A pixel's centre has whole coordinates: the image spans -1/2 to width - 1/2.
    return pinhole(sx * J[0, 0], sy * J[1, 1], sx * (cx + 0.5) - 0.5, sy * (cy + 0.5) - 0.5, size)


def focal_camera(camera: Camera, focal_px: float, *, image_size: Size | None = None) -> Camera:
    """The pinhole with a focal length, px, and its principal point at the image's centre."""
    if not (np.isfinite(focal_px) and focal_px > 0):
        raise InputError(f"the focal length is {focal_px:g} px; expected one above 0")
    width, height = size = image_size or camera.image_size
    return pinhole(focal_px, focal_px, (width - 1) / 2, (height - 1) / 2, size)


def optimal_camera(camera: Camera, alpha: float, *, image_size: Size | None = None) -> Camera:
    """The pinhole between one that shows sources alone (alpha 0) and one that shows every source pixel (alpha 1).

    Raises: InputError for alpha outside of 0 to 1, or a camera whose border leaves no rectangle ahead of it.
    """
    if not 0 <= alpha <= 1:
        raise InputError(f"alpha is {alpha:g}; expected 0 (no pixel without a source) to 1 (every source pixel shown)")
    xy = _border(camera)
    left, right, top, bottom = xy[:, 0, 0], xy[:, -1, 0], xy[0, :, 1], xy[-1, :, 1]
    inner = np.array([left.max(), right.min(), top.max(), bottom.min()])
    outer = np.array([left.min(), right.max(), top.min(), bottom.max()])
    if inner[1] <= inner[0] or inner[3] <= inner[2]:
        raise InputError("the camera's border leaves no rectangle ahead of it; choose --focal and --size")
    size = image_size or camera.image_size
    fx, fy, cx, cy = (1 - alpha) * _filling(inner, size) + alpha * _filling(outer, size)
    return pinhole(fx, fy, cx, cy, size)


def pinhole(fx: float, fy: float, cx: float, cy: float, image_size: Size) -> Camera:
    """A pinhole camera of known parameters."""
    return Camera.create("pinhole", {"fx": fx, "fy": fy, "cx": cx, "cy": cy}, image_size=image_size)


def _filling(rectangle: Array, size: Size) -> Array:
    """fx, fy, cx, cy that map left, right, top, bottom of x, y to the first and last pixels."""
    x0, x1, y0, y1 = rectangle
    fx, fy = (size[0] - 1) / (x1 - x0), (size[1] - 1) / (y1 - y0)
    return np.array([fx, fy, -fx * x0, -fy * y0])


def _border(camera: Camera) -> Array:
    """X/Z, Y/Z (9, 9, 2) of pixels spread over the image; `WIDEST_DEG` at most, in the pixel's direction."""
    return flattened(border_rays(camera))


def border_rays(camera: Camera) -> Array:
    """Directions (9, 9, 3) of pixels spread over the image, its border among them."""
    width, height = camera.image_size
    uv = np.stack(
        np.meshgrid(np.linspace(0, width - 1, BORDER_POINTS), np.linspace(0, height - 1, BORDER_POINTS)), axis=-1
    )
    rays = camera.unproject(uv)
    middle = camera.project([0.0, 0.0, 1.0])
    # A pixel without a ray lies beyond the lens's image circle: its direction from the middle is all that is known.
    return np.where(np.isfinite(rays), rays, np.concatenate([uv - middle, np.zeros((*uv.shape[:-1], 1))], axis=-1))


def flattened(rays: Array) -> Array:
    """X/Z, Y/Z (..., 2) of directions (..., 3); `WIDEST_DEG` from the axis at most."""
    across = np.hypot(rays[..., 0], rays[..., 1])
    slope = np.tan(np.arctan2(across, rays[..., 2]).clip(0, np.deg2rad(WIDEST_DEG)))
    return rays[..., :2] * (slope / np.where(across > 0, across, 1.0))[..., None]
