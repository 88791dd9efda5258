"""Two eyes with a known truth: cameras, places, covariance, and points seen by both."""

from __future__ import annotations

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.geometry import se3, so3
from calibrant.perceive.stereo.eyes import Eyes

LEFT = Camera.create(
    "brown",
    {"fx": 530.0, "fy": 528.0, "cx": 322.0, "cy": 238.0, "k1": -0.2, "k2": 0.08, "p1": 0.001},
    image_size=(640, 480),
)
RIGHT = Camera.create(
    "brown", {"fx": 545.0, "fy": 546.0, "cx": 315.0, "cy": 243.0, "k1": -0.15, "p2": -0.001}, image_size=(640, 480)
)
T_LEFT_RIGHT = se3.make(so3.exp([0.02, -0.06, 0.01]), [0.12, 0.004, 0.01])


def made_eyes(*, seed: int = 0, scale: float = 1.0, T: Array = T_LEFT_RIGHT) -> Eyes:
    """The pair with a covariance of the size that a calibration has, its parts in common off the diagonal."""
    rng = np.random.default_rng(seed)
    lens = [0.4, 0.4, 0.5, 0.5, 5e-4, 1e-3, 5e-5, 5e-5, 1e-3]
    sigma = scale * np.array([3e-4] * 3 + [5e-5] * 3 + lens + lens)
    root = sigma[:, None] * (np.eye(len(sigma)) + 0.3 * rng.normal(size=(len(sigma), len(sigma))))
    return Eyes(("left", "right"), (LEFT, RIGHT), np.stack([np.eye(4), T]), root @ root.T)


def small_eyes(*, T: Array = T_LEFT_RIGHT) -> Eyes:
    """The pair with pictures of half the size, exactly known: for what is rendered."""
    cameras = []
    for c in (LEFT, RIGHT):
        half = {
            n: 0.5 * v if n in ("fx", "fy") else 0.5 * (v + 0.5) - 0.5 if n in ("cx", "cy") else v
            for n, v in c.parameters.items()
        }
        cameras.append(Camera.create("brown", half, image_size=(320, 240)))
    return Eyes(("left", "right"), (cameras[0], cameras[1]), np.stack([np.eye(4), T]), np.zeros((24, 24)))


def drawn_eyes(eyes: Eyes, rng: np.random.Generator) -> Eyes:
    """Eyes as a calibration might have found them whose truth is `eyes`."""
    delta = np.linalg.cholesky(eyes.covariance) @ rng.normal(size=len(eyes.covariance))
    T = np.stack([np.eye(4), se3.retract(eyes.T_first_camera[1], delta[:6])])
    cameras = tuple(
        Camera(c.model, c.image_size, c.values + delta[eyes.lens_columns(i)]) for i, c in enumerate(eyes.cameras)
    )
    return Eyes(eyes.names, cameras, T, eyes.covariance)


def seen_points(eyes: Eyes, n: int, rng: np.random.Generator, *, depth: tuple[float, float] = (0.5, 2.0)) -> Array:
    """Points (n, 3), first camera's frame, that both cameras see."""
    out = np.zeros((0, 3))
    width, height = eyes.cameras[0].image_size
    while len(out) < n:
        uv = rng.uniform([20, 20], [width - 20, height - 20], (4 * n, 2))
        rays = eyes.cameras[0].unproject(uv)
        X = rays / rays[:, 2:] * rng.uniform(*depth, (4 * n, 1))
        other = eyes.cameras[1].project(se3.apply(se3.inverse(eyes.T_first_camera[1]), X))
        keep = np.all((other > 0) & (other < [width - 1, height - 1]), axis=1)
        out = np.concatenate([out, X[keep]])
    return out[:n]


def pixels_of(eyes: Eyes, X: Array) -> Array:
    """Pixels (cameras, n, 2) of points in the first camera's frame."""
    return np.stack([c.project(se3.apply(se3.inverse(T), X)) for c, T in zip(eyes.cameras, eyes.T_first_camera)])
