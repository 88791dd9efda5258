"""Points with and without depth, seen by cameras of the lecture's lens models: what the classical methods are fed."""

from __future__ import annotations

import numpy as np

from calibrant.cameras import Camera
from calibrant.geometry import se3, so3

SIZE = (1280, 1024)
CENTRE = np.array([630.0, 520.0])
ASPECT = 0.98

BOARD = np.array([[0.03 * x, 0.03 * y, 0.0] for y in range(-3, 4) for x in range(-4, 5)])
"""9 x 7 points, 30 mm apart, the origin in their middle: its middle row and column are the axes."""

SOLID = np.random.default_rng(5).uniform(-0.1, 0.1, (24, 3))

LENSES = {"pinhole": {}, "division": {"l1": -0.12}, "inverse_brown": {"k1": 0.1}, "brown": {"k1": -0.11}}


def camera(radial: str = "pinhole", *, fx: float = 900.0) -> Camera:
    terms = {"fx": fx, "fy": ASPECT * fx, "cx": CENTRE[0], "cy": CENTRE[1], **LENSES[radial]}
    return Camera.create(radial, terms, image_size=SIZE)


def pose(seed: int, *, tilt: float = 0.6, distance: float = 0.6) -> np.ndarray:
    """T_camera_target tilted by `tilt` radians about some axis of the image, its origin off both axes of the image."""
    rng = np.random.default_rng(seed)
    around = rng.uniform(0, 2 * np.pi)
    R = so3.exp(tilt * np.array([np.cos(around), np.sin(around), 0])) @ so3.exp([0, 0, rng.uniform(-np.pi, np.pi)])
    x, y = rng.uniform(0.02, 0.08, 2) * rng.choice([-1, 1], 2)
    return se3.make(R, [x, y, distance])


def seen(lens: Camera, T: np.ndarray, points: np.ndarray, *, noise: float = 0.0, seed: int = 0) -> np.ndarray:
    """Pixels (n, 2) of points, with Gaussian noise of 1 sigma per axis."""
    uv = lens.project(se3.apply(T, points))
    assert np.all(np.isfinite(uv))
    return uv + noise * np.random.default_rng(seed).standard_normal(uv.shape)


def deviation(found: Camera, truth: Camera, T: np.ndarray, T_truth: np.ndarray) -> float:
    """Largest deviation: of parameters, relative to themselves where above 1, and of pose elements, metres."""
    off = [abs(v - truth.parameters.get(n, 0.0)) / max(1.0, abs(v)) for n, v in found.parameters.items()]
    return max(*off, float(np.abs(T - T_truth).max()))
