"""Textured planes, spheres and boxes as two cameras see them, with the true depth of every pixel."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.geometry import se3, so3
from calibrant.opencv import cv2

Solid = Callable[[Array, Array], Array]
"""From an origin (3,) and rays (n, 3) to the distance along each, infinite where it is missed."""


def plane(point: Array, normal: Array) -> Solid:
    """An endless plane."""

    def hit(o: Array, d: Array) -> Array:
        with np.errstate(divide="ignore"):
            t = ((point - o) @ normal) / (d @ normal)
        return np.where(t > 0, t, np.inf)

    return hit


def sphere(centre: Array, radius: float) -> Solid:
    """A sphere."""

    def hit(o: Array, d: Array) -> Array:
        b, c = d @ (o - centre), (o - centre) @ (o - centre) - radius**2
        root = b * b - c
        return np.where(root > 0, -b - np.sqrt(np.maximum(root, 0)), np.inf)

    return hit


def box(T_scene_box: Array, half: Array) -> Solid:
    """A box of half sides about a frame's origin."""

    def hit(o: Array, d: Array) -> Array:
        back = se3.inverse(T_scene_box)
        p, r = se3.apply(back, o), d @ back[:3, :3].T
        near, far = (-np.sign(r) * half - p) / r, (np.sign(r) * half - p) / r
        t = near.max(axis=1)
        return np.where(t < far.min(axis=1), t, np.inf)

    return hit


def scene(distance: float) -> list[Solid]:
    """A slanted wall with a sphere and a turned box before it, sized to the distance, metres."""
    s = distance
    turned = se3.make(so3.exp([0.5, 0.6, 0.2]), [-0.22 * s, 0.05 * s, 0.95 * s])
    return [
        plane(np.array([0.0, 0.0, 1.15 * s]), np.array([0.25, 0.1, -1.0]) / np.linalg.norm([0.25, 0.1, -1.0])),
        sphere(np.array([0.25 * s, -0.05 * s, s]), 0.18 * s),
        box(turned, np.array([0.12, 0.10, 0.14]) * s),
    ]


def depth_along(solids: list[Solid], camera: Camera, T_scene_camera: Array, uv: Array) -> Array:
    """Points (..., 3) in the camera's frame that pixels (..., 2) see; NaN for none."""
    rays = camera.unproject(uv).reshape(-1, 3)
    t = np.min([s(T_scene_camera[:3, 3], rays @ T_scene_camera[:3, :3].T) for s in solids], axis=0)
    return np.where(np.isfinite(t)[:, None], rays * t[:, None], np.nan).reshape(*uv.shape[:-1], 3)


def photograph(
    solids: list[Solid], camera: Camera, T_scene_camera: Array, *, grain: float, rng: np.random.Generator, noise: float
) -> np.ndarray:
    """A picture (h, w), 8 bits: each pixel the mean of 4 rays, blurred like a lens does; grain: metres of the texture's
    finest wave; noise: grey levels."""
    w, h = camera.image_size
    total = np.zeros((h, w))
    u, v = np.meshgrid(np.arange(w), np.arange(h))
    for du in (-0.25, 0.25):
        for dv in (-0.25, 0.25):
            p = depth_along(solids, camera, T_scene_camera, np.stack([u + du, v + dv], axis=-1).astype(float))
            total += _texture(se3.apply(T_scene_camera, p), grain) / 4
    total = cv2.GaussianBlur(total, (0, 0), 0.5)
    return np.clip(np.rint(total + rng.normal(0, noise, total.shape)), 0, 255).astype(np.uint8)


def _texture(p: Array, grain: float) -> Array:
    """Grey of a solid of many waves in all directions, 20 to 235."""
    rng = np.random.default_rng(99)
    out = np.zeros(p.shape[:-1])
    for _ in range(24):
        k = rng.normal(size=3)
        k *= 2 * np.pi / (grain * rng.uniform(1, 5)) / np.linalg.norm(k)
        out += np.sin(p @ k + rng.uniform(0, 2 * np.pi))
    return 127.5 + np.clip(out * 26, -107, 107)
