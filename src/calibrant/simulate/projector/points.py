"""A camera beside a projector, boards before both, and the points that a perfect or a noisy decoding would give."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.data import Observations, View
from calibrant.data.observations import Carried
from calibrant.errors import InputError
from calibrant.geometry import se3, so3

STEP_M = 1e-5
"""Over the board, for the slopes: far more than rounding, far less than a lens bends over."""
MOST_TRIES = 10_000
MARGIN_PX = 5.0


@dataclass(frozen=True, eq=False)
class ProjectorPair:
    """A camera, a projector as an inverse camera, and where the projector is: T_camera_projector (4, 4)."""

    camera: Camera
    projector: Camera
    T_camera_projector: Array

    def lit(self, T_camera_target: Array, points: Array) -> tuple[Array, Array]:
        """Pixels (n, 2) of points (n, 3), target frame, in the camera and in the projector."""
        p = se3.apply(T_camera_target, points)
        return self.camera.project(p), self.projector.project(se3.apply(se3.inverse(self.T_camera_projector), p))

    def slope(self, T_camera_target: Array, points: Array) -> Array:
        """d q / d u (n, 2, 2) of a board's points, z = 0: how the projector's pixel moves with the camera's."""
        du, dq = [], []
        for axis in np.eye(3)[:2]:
            (u1, q1), (u0, q0) = (self.lit(T_camera_target, points + s * STEP_M * axis) for s in (1, -1))
            du.append(u1 - u0)
            dq.append(q1 - q0)
        return np.stack(dq, axis=-1) @ np.linalg.inv(np.stack(du, axis=-1))


def example_pair(
    *, shift: float = 0.5, focal_px: float = 1500.0, image_size: tuple[int, int] = (1280, 960),
    projector_size: tuple[int, int] = (1024, 768),
) -> ProjectorPair:  # fmt: skip
    """A camera right of and below a projector whose lens is shifted by a part of its picture's height, as for a table.

    focal_px: of the projector, in pixels at a width of 1024.
    """
    (w, h), (pw, ph) = image_size, projector_size
    f, g = 1.1 * w, focal_px * pw / 1024
    lens = {"k1": -0.1, "k2": 0.05, "k3": 0.0, "p1": 5e-4, "p2": -3e-4}
    camera = Camera.create(
        "brown", {"fx": f, "fy": 1.001 * f, "cx": 0.504 * w, "cy": 0.49 * h, **lens}, image_size=image_size
    )
    mild = {"k1": -0.05, "k2": 0.02, "k3": 0.0, "p1": 2e-4, "p2": 4e-4}
    at = {"fx": g, "fy": 1.002 * g, "cx": (pw - 1) / 2, "cy": (ph - 1) / 2 + shift * ph}
    projector = Camera.create("brown", {**at, **mild}, image_size=projector_size)
    tilt = np.arctan(shift * ph / g)
    T = se3.make(so3.exp(np.array([0.8 * tilt, 0.15, 0.01])), np.array([-0.25, 0.24 * shift, 0.02]))
    return ProjectorPair(camera, projector, T)


def board_poses(
    pair: ProjectorPair, points: Array, count: int, rng: np.random.Generator, *, distance: tuple[float, float]
) -> Array:
    """T_camera_target (count, 4, 4) of boards that camera and projector see whole, tilted up to about 40 degrees.

    Raises: InputError where the two share too little.
    """
    out: list[Array] = []
    middle = se3.make(np.eye(3), -points.mean(axis=0))
    for _ in range(MOST_TRIES):
        if len(out) == count:
            return np.stack(out)
        turn = rng.normal(size=3) * np.array([0.3, 0.3, 0.3])
        z = rng.uniform(*distance)
        x, y = rng.uniform(-0.3, 0.3) * z, rng.uniform(-0.25, 0.25) * z
        T = se3.make(so3.exp(turn), np.array([x, y, z])) @ middle
        u, q = pair.lit(T, points)
        if _inside(u, pair.camera.image_size) and _inside(q, pair.projector.image_size):
            out.append(T)
    raise InputError(f"camera and projector see a board of this size together in {len(out)} of {MOST_TRIES} tries")


def carried_views(
    pair: ProjectorPair, points: Array, poses: Array, rng: np.random.Generator, *, corner_px: float, decoded_px: float
) -> Observations:
    """Views of both at poses (m, 4, 4): corners with noise, carried into the projector by a decoding with its own."""
    views: list[View] = []
    ids = np.arange(len(points))
    for k, T in enumerate(poses):
        u, q = pair.lit(T, points)
        slope = pair.slope(T, points)
        error = corner_px * rng.normal(size=u.shape)
        carried = np.einsum("nij,nj->ni", slope, error)
        found = q + carried + decoded_px * rng.normal(size=q.shape)
        name = f"{k:02d}"
        views += [
            View(name, points, u + error, ids, "camera"),
            View(name, points, found, ids, "projector", carried=Carried("camera", u + error, slope)),
        ]
    return Observations(tuple(views), {"camera": pair.camera.image_size, "projector": pair.projector.image_size})


def _inside(uv: Array, size: tuple[int, int]) -> bool:
    limit = np.array(size) - 1 - MARGIN_PX
    return bool(np.isfinite(uv).all() and np.all(uv > MARGIN_PX) and np.all(uv < limit))
