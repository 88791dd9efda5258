"""Things that light falls on: a board, a plane, a sphere, a box. Rays meet them; nothing bends or glows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from calibrant.arrays import Array, Mask
from calibrant.geometry import se3

FAR = np.inf


@dataclass(frozen=True, eq=False)
class Hit:
    """Where rays meet a surface: distance (n,) along unit rays, infinite for none; outward normals (n, 3); albedo
    (n,)."""

    distance: Array
    normal: Array
    albedo: Array


class Surface(Protocol):
    """What a ray can meet."""

    def hit(self, origin: Array, rays: Array) -> Hit:
        """Args: origin (3,), metres; rays (n, 3), unit."""
        ...


@dataclass(frozen=True, eq=False)
class Plane:
    """The plane z = 0 of a frame at T_world_plane (4, 4), facing -z, where |x|, |y| <= half (2,), metres.

    squares: a chessboard's inner corners along x and y from its origin, side metres, bent by `bend_m` (at the middle of
    its length, over its ends) where that is not 0.
    """

    T_world_plane: Array
    half: tuple[float, float] = (FAR, FAR)
    albedo: float = 0.8
    squares: tuple[int, int, float] | None = None
    dark: float = 0.06
    bend_m: float = 0.0

    def hit(self, origin: Array, rays: Array) -> Hit:
        """The nearer side of the sheet; a bend is met by two steps of Newton's."""
        back = se3.inverse(self.T_world_plane)
        o, d = se3.apply(back, origin[None])[0], rays @ back[:3, :3].T
        with np.errstate(divide="ignore", invalid="ignore"):
            t = -o[2] / d[:, 2]
            for _ in range(3 if self.bend_m else 0):
                p = o + t[:, None] * d
                height, slope = self._bend(p[:, 0])
                t = t - (p[:, 2] - height) / (d[:, 2] - slope * d[:, 0])
        p = o + np.where(np.isfinite(t), t, 0.0)[:, None] * d
        there = (t > 1e-6) & self._inside(p)
        slope = self._bend(p[:, 0])[1] if self.bend_m else np.zeros(len(p))
        normal = np.stack([slope, np.zeros(len(p)), -np.ones(len(p))], axis=1)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        return Hit(np.where(there, t, FAR), normal @ self.T_world_plane[:3, :3].T, self._albedo(p))

    def _middle(self) -> tuple[float, float]:
        if self.squares is None:
            return 0.0, 0.0
        n, m, side = self.squares
        return (n - 1) * side / 2, (m - 1) * side / 2

    def _inside(self, p: Array) -> Mask:
        x, y = self._middle()
        return np.asarray((np.abs(p[:, 0] - x) <= self.half[0]) & (np.abs(p[:, 1] - y) <= self.half[1]))

    def _bend(self, x: Array) -> tuple[Array, Array]:
        """Height and its slope, a parabola over the half length."""
        u = (x - self._middle()[0]) / self.half[0]
        return self.bend_m * (1 - u * u), -2 * self.bend_m * u / self.half[0]

    def _albedo(self, p: Array) -> Array:
        if self.squares is None:
            return np.full(len(p), self.albedo)
        n, m, side = self.squares
        i, j = np.floor(p[:, 0] / side) + 1, np.floor(p[:, 1] / side) + 1
        printed = (i >= 0) & (i <= n) & (j >= 0) & (j <= m) & ((i + j) % 2 == 0)
        return np.where(printed, self.dark, self.albedo)


@dataclass(frozen=True, eq=False)
class Sphere:
    """A sphere of a radius about a centre (3,), metres."""

    centre: Array
    radius: float
    albedo: float = 0.8

    def hit(self, origin: Array, rays: Array) -> Hit:
        """The nearer of two points."""
        o = origin - self.centre
        b = rays @ o
        root = b * b - (o @ o - self.radius**2)
        t = -b - np.sqrt(np.maximum(root, 0.0))
        there = (root > 0) & (t > 1e-6)
        p = o + np.where(there, t, 0.0)[:, None] * rays
        return Hit(np.where(there, t, FAR), p / self.radius, np.full(len(rays), self.albedo))


@dataclass(frozen=True, eq=False)
class Box:
    """A box of half sides (3,), metres, about the origin of a frame at T_world_box (4, 4)."""

    T_world_box: Array
    half: Array
    albedo: float = 0.8

    def hit(self, origin: Array, rays: Array) -> Hit:
        """The face through which a ray enters, by slabs."""
        back = se3.inverse(self.T_world_box)
        o, d = se3.apply(back, origin[None])[0], rays @ back[:3, :3].T
        with np.errstate(divide="ignore", invalid="ignore"):
            near = (-np.sign(d) * self.half - o) / d
            far = (np.sign(d) * self.half - o) / d
        near, far = np.where(np.isnan(near), -FAR, near), np.where(np.isnan(far), FAR, far)
        t, face = near.max(axis=1), near.argmax(axis=1)
        there = (t < far.min(axis=1)) & (t > 1e-6)
        normal = np.zeros_like(d)
        normal[np.arange(len(d)), face] = -np.sign(d[np.arange(len(d)), face])
        return Hit(np.where(there, t, FAR), normal @ self.T_world_box[:3, :3].T, np.full(len(rays), self.albedo))


@dataclass(frozen=True, eq=False)
class Scene:
    """Several surfaces: the nearest one is met."""

    surfaces: tuple[Surface, ...]

    def hit(self, origin: Array, rays: Array) -> Hit:
        """The nearest hit of every ray."""
        hits = [s.hit(origin, rays) for s in self.surfaces]
        first = np.argmin([h.distance for h in hits], axis=0)
        rows = np.arange(len(rays))
        pick = [np.stack([getattr(h, name) for h in hits])[first, rows] for name in ("distance", "normal", "albedo")]
        return Hit(*pick)
