"""Where a known camera puts the corners of a ChArUco board: the second pass, for lenses that bend a board too much."""

from __future__ import annotations

import numpy as np

from calibrant.cameras.camera import Camera
from calibrant.detect.charuco_corners import CORNER_SIGMA_PX, Anchors, Corners
from calibrant.targets.charuco import Charuco


def anchors_from_camera(corners: Corners, target: Charuco, camera: Camera) -> Anchors | None:
    """Predicted positions of all corners of the board, or None when the corners found do not determine them.

    Rays of the corners found, on the plane z = 1, are a homography of the board's plane: fitted to all of them by
    singular values (R. Hartley, A. Zisserman, Multiple View Geometry, 4.1) and projected through the camera.
    """
    rays = camera.unproject(corners.uv)
    ahead = np.all(np.isfinite(rays), axis=1) & (rays[:, 2] > 0.05)  # within 87 degrees of the axis
    if ahead.sum() < 4:
        return None
    xy = target.points[:, :2] / target.square
    H = _homography(xy[corners.index[ahead]], rays[ahead, :2] / rays[ahead, 2:])
    on_plane = np.column_stack([xy, np.ones(len(xy))]) @ H.T
    on_plane *= np.sign(np.median(on_plane[corners.index, 2]))
    uv = camera.project(on_plane)
    seen = np.all(np.isfinite(uv), axis=1) & (on_plane[:, 2] > 0)
    # A corner found is known better than predicted; leaving it out of the predictions lets it speak for itself.
    seen[corners.index] = False
    known = Anchors(xy[corners.index], corners.uv, np.full(len(corners), CORNER_SIGMA_PX))
    return known.joined(xy[seen], uv[seen], CORNER_SIGMA_PX)


def _homography(xy: np.ndarray, plane: np.ndarray) -> np.ndarray:
    T_xy, T_plane = _normalising(xy), _normalising(plane)
    a = np.column_stack([xy, np.ones(len(xy))]) @ T_xy.T
    b = np.column_stack([plane, np.ones(len(plane))]) @ T_plane.T
    zero = np.zeros_like(a)
    rows = np.concatenate([np.hstack([zero, -a, b[:, 1:2] * a]), np.hstack([a, zero, -b[:, 0:1] * a])])
    H = np.linalg.svd(rows)[2][-1].reshape(3, 3)
    return np.linalg.solve(T_plane, H @ T_xy)


def _normalising(xy: np.ndarray) -> np.ndarray:
    mean = xy.mean(axis=0)
    scale = np.sqrt(2.0) / max(float(np.linalg.norm(xy - mean, axis=1).mean()), 1e-12)
    return np.array([[scale, 0.0, -scale * mean[0]], [0.0, scale, -scale * mean[1]], [0.0, 0.0, 1.0]])
