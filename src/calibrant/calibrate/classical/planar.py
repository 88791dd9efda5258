"""Closed-form start for planar targets: homographies, focal lengths, poses (Zhang 2000, "A flexible new technique").

A plane's homography is H ~ K [r1 r2 t]. With the principal point p taken at the image's centre and no skew, the two
conditions r1 . r2 = 0 and |r1| = |r2| of every view are linear in (1/fx^2, 1/fy^2). Fixing p costs nothing that the
refinement does not recover and keeps the start stable with few views, where Zhang's full form is not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.calibrate.reprojection.factor import StackedViews
from calibrant.errors import InputError
from calibrant.geometry import se3, so3

DEGENERATE_PIVOT = 1e-9
"""Pivot ratio of the normalised normal equations below which points lie on a line: their scatter is below 3e-5 of the
target's size, less than any detector resolves."""


@dataclass(frozen=True, eq=False)
class PlanarPoints:
    """Points of a plane: xy (N, 2) in the plane's own frame, metres; T_plane_target (4, 4) leads there."""

    xy: Array
    T_plane_target: Array


@dataclass(frozen=True, eq=False)
class PlaneViews:
    """Views of a plane, and what each shows of it.

    xy, T_plane_target as in `PlanarPoints`; H (m, 3, 3) from plane to pixels; good (m,) where it is determined.
    """

    xy: Array
    T_plane_target: Array
    H: Array
    good: NDArray[np.bool_]

    def only(self, views: StackedViews, keep: NDArray[np.bool_]) -> PlaneViews:
        """The views where keep (m,) is true."""
        rows = np.repeat(keep, np.diff(views.offsets))
        return PlaneViews(self.xy[rows], self.T_plane_target, self.H[keep], self.good[keep])


def see_plane(views: StackedViews) -> PlaneViews:
    """The target's plane and the homography of every view. Raises: InputError when the points lie in no plane."""
    planar = in_plane(views.points)
    H, good = homographies(planar.xy, views.uv, views.offsets)
    return PlaneViews(planar.xy, planar.T_plane_target, H, good)


def in_plane(points: Array) -> PlanarPoints:
    """Coordinates of target points in their common plane; z = 0 stays as it is.

    Args: points (N, 3), metres. Raises: InputError when the points do not lie in one plane.
    """
    if np.all(points[:, 2] == 0):
        return PlanarPoints(np.ascontiguousarray(points[:, :2]), np.eye(4))
    centre = points.mean(axis=0)
    _, spread, axes = np.linalg.svd(points - centre, full_matrices=False)
    if spread[2] > 1e-6 * spread[0]:
        off = 1e3 * spread[2] / np.sqrt(len(points))
        raise InputError(
            f"the target's points do not lie in a plane (they leave it by {off:.2g} mm rms); a target with depth needs "
            "a start value: give --initial camera.json"
        )
    R = axes if np.linalg.det(axes) > 0 else axes * [[1], [1], [-1]]
    T = se3.make(R, -R @ centre)
    return PlanarPoints(np.ascontiguousarray(se3.apply(T, points)[:, :2]), T)


def homographies(xy: Array, image: Array, offsets: NDArray[np.int64]) -> tuple[Array, NDArray[np.bool_]]:
    """Homographies (m, 3, 3) from plane to image of every view, and which views determine theirs."""
    from calibrant.calibrate.classical import planar_kernels

    m = len(offsets) - 1
    H, condition = np.empty((m, 3, 3)), np.empty(m)
    planar_kernels.homographies(np.ascontiguousarray(xy), np.ascontiguousarray(image), offsets, H, condition)
    good = (np.diff(offsets) >= 4) & (condition > DEGENERATE_PIVOT) & np.isfinite(H).all(axis=(1, 2))
    return H, good


def focal_lengths(H: Array, centre: Array) -> tuple[float, float] | None:
    """fx, fy from homographies (m, 3, 3), principal point held at `centre`; None when the views do not show them.

    Least absolute residuals by reweighting, so that a misread board among good ones does not bend the start.
    """
    shift = np.array([[1, 0, -centre[0]], [0, 1, -centre[1]], [0, 0, 1.0]])
    h = shift @ H
    h = h / np.linalg.norm(h[:, :, :2], axis=(1, 2), keepdims=True)
    a, b = h[:, :, 0], h[:, :, 1]
    rows = np.concatenate([a[:, :2] * b[:, :2], a[:, :2] ** 2 - b[:, :2] ** 2])
    right = -np.concatenate([a[:, 2] * b[:, 2], a[:, 2] ** 2 - b[:, 2] ** 2])
    for columns in (rows, rows.sum(axis=1, keepdims=True)):  # then one focal length, when two are not determined
        solution = _least_absolute(columns, right)
        if solution is not None and np.all(solution > 0):
            f = 1 / np.sqrt(solution)
            # Nobody builds a lens whose focal lengths differ by more than a factor of two: such a pair is noise.
            if 0.5 < f[0] / f[-1] < 2:
                return float(f[0]), float(f[-1])
    return None


def _least_absolute(columns: Array, right: Array) -> Array | None:
    """x with the least sum of |columns x - right|, by reweighted normal equations; None when they are singular."""
    stacked = np.concatenate([columns.T, right[None]])
    k = columns.shape[1]
    weights: Array = np.ones(len(right))
    solution = [0.0] * k
    for _ in range(10):
        # At most two unknowns: Cramer's rule on numbers is ten times faster than the general solver here.
        N = ((stacked[:k] * weights) @ stacked.T).tolist()
        if k == 1:
            determinant, size, found = N[0][0], 1.0, [N[0][1]]
        else:
            (a, b, u), (_, d, v) = N
            determinant, size, found = a * d - b * b, a * d, [u * d - b * v, a * v - b * u]
        # Columns closer to parallel than 1e-6 say nothing about both unknowns: rounding of the homographies is larger.
        if not determinant > 1e-12 * size:
            return None
        before, solution = solution, [x / determinant for x in found]
        if all(abs(x - old) < 1e-4 * abs(x) for x, old in zip(solution, before)):
            break  # half that in the focal length: a start
        residual = np.abs(np.array([*solution, -1.0]) @ stacked)
        weights = 1 / np.maximum(residual, 1e-3 * float(residual.sum()) / len(right) + 1e-300)
    return np.array(solution)


def poses(H: Array, K: Array) -> Array:
    """T_camera_plane (m, 4, 4) from homographies: [r1 r2 t] ~ K^-1 H, r orthonormalised, the plane in front."""
    a = np.linalg.inv(K) @ H
    lengths = np.sqrt(np.einsum("nij,nij->nj", a, a))
    # `homographies` scales H so that the points' centroid has a positive third coordinate: it is in front already.
    a *= (2 / (lengths[:, 0] + lengths[:, 1]))[:, None, None]
    R = np.empty_like(a)
    R[:, :, :2] = a[:, :, :2]
    R[:, :, 2] = (so3.hat(a[:, :, 0]) @ a[:, :, 1, None])[:, :, 0]
    return se3.make(so3.nearest(R), a[:, :, 2])


def start_poses(xy: Array, normalised: Array, offsets: NDArray[np.int64]) -> tuple[Array, NDArray[np.bool_]]:
    """T_camera_plane (m, 4, 4) from points in the plane and on the normalised image plane (x/z, y/z)."""
    H, good = homographies(xy, normalised, offsets)
    T = np.tile(np.eye(4), (len(H), 1, 1))
    T[:, 2, 3] = 1.0
    T[good] = poses(H[good], np.eye(3))
    return T, good
