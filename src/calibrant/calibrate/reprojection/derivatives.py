"""Pixels of points and their derivatives by the compiled model: a fraction of the time of NumPy's."""

from __future__ import annotations

import numpy as np

from calibrant.arrays import Array, Indices
from calibrant.cameras import Camera


def turned(T: Array, points: Array, offsets: Indices) -> Array:
    """Points (N, 3) of views laid end to end, in their cameras' axes without the place: (3, N), R_v p.

    Args: T (n, 4, 4), T_camera_target of each view; offsets (n + 1,), where its points begin. By whole axes: a product
    of each point with its matrix takes several times as long.
    """
    R = np.repeat(T[:, :3, :3].reshape(-1, 9).T, np.diff(offsets), axis=1)
    x, y, z = np.ascontiguousarray(points.T)
    return np.stack([R[3 * i] * x + R[3 * i + 1] * y + R[3 * i + 2] * z for i in range(3)])


def derivatives(camera: Camera, points: Array) -> tuple[Array, Array, Array]:
    """Pixels (N, 2), d pixel / d point (N, 2, 3) and / d parameters (N, 2, k) of points (N, 3), camera frame, metres.

    As `CameraModel.project_with_jacobians`, NaN where the camera sees nothing. Each number of a point lies beside those
    of its neighbours: moved to the front, an axis is contiguous.
    """
    n, k = len(points), len(camera.values)
    uv, J_point, J_lens = np.empty((2, n)), np.empty((6, n)), np.empty((2 * k, n))
    camera.model.rows()(n, camera.values, np.ascontiguousarray(points.T), uv, J_point, J_lens)
    return uv.T, np.moveaxis(J_point.reshape(2, 3, n), 2, 0), np.moveaxis(J_lens.reshape(2, k, n), 2, 0)
