"""Boxes on a table as a camera with depth sees them: rays cast, no renderer; the truth is exact."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from calibrant.cameras import Camera
from calibrant.geometry import se3

LIGHT = np.array([0.3, -0.2, 0.93])
F_B = 617.0 * 0.050
"""Focal length times baseline of a D435 at 640 x 480."""


@dataclass(frozen=True, eq=False)
class Thing:
    """A box: T_table_box, sides in metres, colour in BGR, linear, 0 to 1."""

    T_table_box: np.ndarray
    sides: np.ndarray
    colour: tuple[float, float, float] = (0.06, 0.08, 0.6)


def camera_at(f: float = 617.0, size: tuple[int, int] = (640, 480)) -> Camera:
    """A pinhole."""
    centre = {"cx": size[0] / 2 - 0.3, "cy": size[1] / 2 + 2.1}
    return Camera.create("pinhole", {"fx": f, "fy": f, **centre}, image_size=size)


def looking_down(height: float, tilt_deg: float = 0.0, turn_deg: float = 0.0) -> np.ndarray:
    """T_camera_table of a camera that looks at the table's origin from a distance."""
    from calibrant.geometry.so3 import exp

    R = np.diag([1.0, -1.0, -1.0]) @ exp([0, 0, np.deg2rad(turn_deg)])
    return se3.make(exp([np.deg2rad(tilt_deg), 0, 0]) @ R, [0, 0, height])


def cast(camera: Camera, T_camera_table: np.ndarray, things, uv: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Colours (n, 3), linear, and depths (n,) of pixels (n, 2)."""
    rays = camera.unproject(uv)
    rays = rays / rays[:, 2:]
    T_table_camera = se3.inverse(T_camera_table)
    o, d = T_table_camera[:3, 3], rays @ T_table_camera[:3, :3].T
    z = np.where(d[:, 2] < 0, -o[2] / d[:, 2], np.inf)
    colour = np.tile([0.35, 0.36, 0.37], (len(uv), 1))
    for thing in things:
        T = se3.inverse(thing.T_table_box)
        ob, db = se3.apply(T, o), d @ T[:3, :3].T
        with np.errstate(divide="ignore", invalid="ignore"):
            a, b = (-thing.sides / 2 - ob) / db, (thing.sides / 2 - ob) / db
        near, far = np.minimum(a, b), np.maximum(a, b)
        enter = near.max(axis=1)
        hit = (enter < far.min(axis=1)) & (enter > 0) & (enter < z)
        axis = near.argmax(axis=1)
        normal = -np.sign(db[np.arange(len(db)), axis])[:, None] * np.eye(3)[axis]
        light = 0.35 + 0.65 * np.clip(normal @ thing.T_table_box[:3, :3].T @ (LIGHT / np.linalg.norm(LIGHT)), 0, 1)
        z = np.where(hit, enter, z)
        colour = np.where(hit[:, None], light[:, None] * np.array(thing.colour), colour)
    return colour, z


def photograph(camera, T_camera_table, things, rng, *, blur=0.6, noise=1.5, samples=4) -> np.ndarray:
    """A picture (h, w, 3), BGR, 8 bits: pixels averaged in linear light, blurred, in sRGB's curve, with noise."""
    width, height = camera.image_size
    u, v = np.meshgrid(np.arange(width, dtype=float), np.arange(height, dtype=float))
    grid = np.stack([u, v], axis=-1)
    linear = cast(camera, T_camera_table, things, grid.reshape(-1, 2))[0].reshape(height, width, 3)
    around = np.stack([np.roll(linear, s, a) for s, a in ((0, 0), (1, 0), (-1, 0), (1, 1), (-1, 1))])
    change = cv2.dilate((np.ptp(around, axis=0).max(axis=2) > 1e-6).astype(np.uint8), np.ones((3, 3)))
    at = grid[change > 0]
    steps = (np.arange(samples) + 0.5) / samples - 0.5
    fine = [cast(camera, T_camera_table, things, at + np.array([x, y]))[0] for x in steps for y in steps]
    linear[change > 0] = np.mean(fine, axis=0)
    linear = cv2.GaussianBlur(linear, (0, 0), blur)
    srgb = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)
    return np.clip(np.rint(255 * srgb + rng.normal(0, noise, srgb.shape)), 0, 255).astype(np.uint8)


def exact_depth(camera, T_camera_table, things) -> np.ndarray:
    width, height = camera.image_size
    u, v = np.meshgrid(np.arange(width, dtype=float), np.arange(height, dtype=float))
    return cast(camera, T_camera_table, things, np.stack([u, v], -1).reshape(-1, 2))[1].reshape(height, width)


def d435(
    depth, rng, *, f_b=F_B, sigma_px=0.08, shared_px=1.0, step_px=1 / 32, rim_px=2, lost=0.02, offset_px=0.0
) -> np.ndarray:
    """Depth as a stereo camera measures it: disparities with noise that neighbours share, in steps, with holes where it
    jumps and a few elsewhere; offset_px: of all disparities, what the camera's own calibration leaves."""
    d = f_b / depth
    noise = rng.normal(0, 1, d.shape)
    if shared_px:
        noise = cv2.GaussianBlur(noise, (0, 0), shared_px)
        noise /= noise.std()
    d = np.rint((d + offset_px + sigma_px * noise) / step_px) * step_px
    kernel = np.ones((2 * rim_px + 1,) * 2)
    jump = cv2.dilate(f_b / depth, kernel) - cv2.erode(f_b / depth, kernel) > 1.5
    z = f_b / d
    z[(jump & (rng.random(d.shape) < 0.6)) | (rng.random(d.shape) < lost)] = np.nan
    return z.astype(np.float32)
