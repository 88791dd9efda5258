"""Where a known camera puts the corners of a ChArUco board: the second pass, for lenses that bend a board too much."""

from __future__ import annotations

import numpy as np

from calibrant.cameras.camera import Camera
from calibrant.detection.charuco.corners import Corners
from calibrant.detection.local_homography import LocalMaps
from calibrant.targets.charuco import Charuco

STEP_SQUARES = 0.2
"""Half the step of the differences that give a square's size in the image; a lens bends little over it."""
LEAST_AGREEING = 4
AGREEMENT_SQUARES = 0.02
"""A quarter of what neighbours are allowed: a camera fitted to many views puts corners to a tenth of a pixel."""


def maps_from_camera(corners: Corners, target: Charuco, camera: Camera) -> LocalMaps | None:
    """Where the camera puts every corner of the board, not a number where it sees none; None when the corners found
    do not determine it.

    The rays r of the corners found are a homography of the board's plane, r x H (x, y, 1) = 0: fitted to all of them by
    singular values (R. Hartley, A. Zisserman, Multiple View Geometry, 4.1; unit rays, as points on a plane run off to
    infinity in a wide lens) and projected through the camera; fitted again to those that agree with it.
    """
    rays = camera.unproject(corners.uv)
    use = np.asarray(np.isfinite(rays).all(axis=1))
    xy = target.points[:, :2] / target.square
    maps = None
    for _ in range(2):
        if use.sum() < LEAST_AGREEING:
            break
        index = corners.index[use]
        maps = _maps(_homography(xy[index], rays[use]), xy, index, rays[use], camera)
        use = use & agrees(corners, maps)
    return maps


def agrees(corners: Corners, maps: LocalMaps) -> np.ndarray:
    """Which corners (n,) lie where the maps of all corners put them."""
    off = np.linalg.norm(corners.uv - maps.centres[corners.index], axis=1)
    return np.asarray(off <= np.maximum(AGREEMENT_SQUARES * maps.square_px[corners.index], 1.0))


def _maps(H: np.ndarray, xy: np.ndarray, seen: np.ndarray, rays: np.ndarray, camera: Camera) -> LocalMaps:
    """The maps around xy (n, 2) squares through the board's plane and the camera."""
    steps = STEP_SQUARES * np.array([[0.0, 0.0], [1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    places = xy[:, None] + steps
    p = np.concatenate([places, np.ones((*places.shape[:2], 1))], axis=-1) @ H.T
    p *= np.sign(np.median(np.einsum("ni,ni->n", p[seen, 0], rays)))
    uv = camera.project(p.reshape(-1, 3)).reshape(places.shape)
    uv[~np.isfinite(uv).all(axis=(1, 2))] = np.nan
    along_x, along_y = (0.5 * (uv[:, k] - uv[:, k + 1]) / STEP_SQUARES for k in (1, 3))
    h = np.zeros((len(xy), 8))
    h[:, [0, 3]], h[:, [1, 4]] = np.nan_to_num(along_x), np.nan_to_num(along_y)
    return LocalMaps(h, uv[:, 0], np.zeros(len(xy)))


def _homography(xy: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """H (3, 3) with rays (n, 3) along H (x, y, 1) for xy (n, 2), up to a factor."""
    mean = xy.mean(axis=0)
    scale = np.sqrt(2.0) / max(float(np.linalg.norm(xy - mean, axis=1).mean()), 1e-12)
    T = np.array([[scale, 0.0, -scale * mean[0]], [0.0, scale, -scale * mean[1]], [0.0, 0.0, 1.0]])
    a = np.column_stack([xy, np.ones(len(xy))]) @ T.T
    x, y, z = (rays[:, k : k + 1] for k in range(3))
    zero = np.zeros_like(a)
    cross = [np.hstack([zero, -z * a, y * a]), np.hstack([z * a, zero, -x * a]), np.hstack([-y * a, x * a, zero])]
    return np.asarray(np.linalg.svd(np.concatenate(cross))[2][-1].reshape(3, 3) @ T)
