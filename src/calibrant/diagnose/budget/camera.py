"""How certain a calibrated camera is, where it matters: at a pixel, at a point, at a frame of the working volume.

First order from the covariances that a result carries; nothing but the result file is needed. Errors of different
results (a camera's lens, its mounting) are taken as independent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.data import TransformEstimate
from calibrant.errors import InputError
from calibrant.optimize import uncertainty


def of_pixel(camera: Camera, p_camera: ArrayLike, *, of_p_camera: ArrayLike | None = None) -> Array:
    """Covariance (..., 2, 2), square pixels, of where a point (..., 3), camera frame, appears.

    C = J_k C_k J_k^T + J_p C_p J_p^T: the lens, and the point's own covariance (..., 3, 3) when it is given.
    Raises: InputError for a camera without covariance.
    """
    _, J_point, J_camera = camera.model.project_with_jacobians(camera.values, p_camera)
    out = J_camera @ _covariance(camera) @ np.swapaxes(J_camera, -1, -2)
    if of_p_camera is not None:
        out = out + J_point @ np.asarray(of_p_camera, dtype=np.float64) @ np.swapaxes(J_point, -1, -2)
    return out


def of_position(camera: Camera, p_camera: ArrayLike, *, sigma_depth: float = 0.0, sigma_px: float = 0.0) -> Array:
    """Covariance (..., 3, 3), square metres, of a point that is located by its pixel and its depth z.

    The point's offset from the ray follows from the pixel's: J_xy dxy = -J_k dk + noise of the pixel, z held; the depth
    moves the point along its ray. Args: p_camera (..., 3) metres; sigma_depth metres; sigma_px of the pixel per axis.
    """
    p = np.asarray(p_camera, dtype=np.float64)
    _, J_point, _ = camera.model.project_with_jacobians(camera.values, p)
    pixel = of_pixel(camera, p) + sigma_px**2 * np.eye(2)
    inverse = np.linalg.inv(J_point[..., :2])
    across = inverse @ pixel @ np.swapaxes(inverse, -1, -2)
    along = p / p[..., 2:]
    out = sigma_depth**2 * along[..., :, None] * along[..., None, :]
    out[..., :2, :2] += across
    return out


def of_point(transform: TransformEstimate, p_child: ArrayLike, *, of_p_child: ArrayLike | None = None) -> Array:
    """Covariance (..., 3, 3), square metres along the parent's axes, of points known in the child's frame.

    Raises: InputError for a transform without covariance.
    """
    return uncertainty.of_point(transform.matrix, _spread(transform), p_child, of_p_b=of_p_child)


def of_product(transforms: Sequence[TransformEstimate | ArrayLike]) -> TransformEstimate:
    """The product of transforms with its covariance; plain matrices (a robot's pose) are taken as exact.

    The names of the frames at its ends come from the first and the last estimate.
    """
    matrices = [t.matrix if isinstance(t, TransformEstimate) else np.asarray(t, dtype=np.float64) for t in transforms]
    covariances = [t.covariance if isinstance(t, TransformEstimate) else None for t in transforms]
    known = [t for t in transforms if isinstance(t, TransformEstimate)]
    if not known:
        raise InputError("the uncertainty of a chain needs at least one estimated transform in it")
    T, C = uncertainty.of_product(matrices, covariances)
    return TransformEstimate(known[0].parent, known[-1].child, T, C)


@dataclass(frozen=True, eq=False)
class Volume:
    """1 sigma position error over a box, millimetres: sigma_mm (n,) at points (n, 3), its worst place and its mean."""

    points: Array
    sigma_mm: Array

    @property
    def worst(self) -> tuple[float, Array]:
        """The largest sigma, millimetres, and where it is."""
        i = int(np.argmax(self.sigma_mm))
        return float(self.sigma_mm[i]), self.points[i]

    @property
    def mean_mm(self) -> float:
        return float(np.sqrt(np.mean(self.sigma_mm**2)))


def over_volume(transform: TransformEstimate, low: ArrayLike, high: ArrayLike, *, steps: int = 5) -> Volume:
    """Position error, sqrt(trace C), on a grid over a box of the child's frame (metres) that a transform carries over.

    For a camera on a robot: the working volume in front of the camera, as the robot will see it.
    """
    a, b = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
    if a.shape != (3,) or b.shape != (3,) or not np.all(np.isfinite([a, b])) or np.any(b < a):
        raise InputError(
            f"a working volume is two corners (3,) with low <= high, metres, got {a.tolist()} and {b.tolist()}"
        )
    axes = [np.linspace(x, y, steps if y > x else 1) for x, y in zip(a, b)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    C = of_point(transform, points)
    return Volume(points, 1e3 * np.sqrt(np.trace(C, axis1=-2, axis2=-1)))


def _covariance(camera: Camera) -> Array:
    if camera.covariance is None:
        raise InputError("the camera has no covariance: it was written by hand or by a program that states none")
    return camera.covariance


def _spread(transform: TransformEstimate) -> Array:
    if transform.covariance is None:
        raise InputError(f"the transform {transform.parent} -> {transform.child} has no covariance")
    return transform.covariance
