"""Points in space from the rays that see them in two or more views (lecture 000, epipolar geometry and triangulation).

Views are given by rays in their own camera frames, as `Camera.unproject` returns them, so any lens model serves.
A ray of NaN means that the view does not see the point. No check is made that a point lies in front of its cameras.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.geometry import se3

_PARALLEL = 1e-12
"""sin^2 of the angle between rays below which depth is lost: 1e-6 rad is a thousandth of a pixel at f = 1000 px."""

_REFINE_ITERATIONS = 20
_REFINE_STOP = 1e-12
"""A step smaller than this fraction of the distance is rounding; three to five steps reach it on good rays."""


def triangulate(rays: ArrayLike, *, T_world_camera: ArrayLike) -> Array:
    """The points nearest to their rays: min over X of sum_i |(I - d_i d_i^T)(X - c_i)|^2, a linear 3x3 system.

    d_i = R_i ray_i and c_i = t_i are direction and origin of ray i in the world. With two views it is the midpoint of
    the common perpendicular.
    Args: rays (views, n, 3), camera frames, any length, NaN where unseen; T_world_camera (views, 4, 4), metres.
    Returns: (n, 3), metres, world frame.
    Raises: InputError for fewer than two views of a point, parallel rays, shapes that do not fit.
    """
    directions, seen, T = _checked_rays(rays, T_world_camera)
    d = np.einsum("vij,vnj->vni", T[:, :3, :3], directions)
    across = (np.eye(3) - d[..., :, None] * d[..., None, :]) * seen[..., None, None]
    normal = across.sum(axis=0)
    # For two rays the smallest eigenvalue is 1 - |cos| of their angle, sin^2 / 2 when it is small.
    parallel = np.flatnonzero(np.linalg.eigvalsh(normal)[:, 0] < _PARALLEL)
    if len(parallel):
        raise InputError(f"point {parallel[0]}: its rays are parallel, so its depth is unknown; move the cameras apart")
    right = np.einsum("vnij,vj->ni", across, T[:, :3, 3])
    return np.linalg.solve(normal, right[..., None])[..., 0]


def triangulate_linear(rays: ArrayLike, *, T_world_camera: ArrayLike) -> Array:
    """The points that solve X_c - x Z_c = 0, Y_c - y Z_c = 0 of all views by least squares, (x, y, 1) along the ray.

    (X_c, Y_c, Z_c) is the point in camera c, so that a view counts by the point's depth in it (Hartley and Zisserman,
    12.2, inhomogeneous; the lecture's slide 37 in normalised coordinates).
    Args, returns: as `triangulate`. Raises: as there, and InputError for a ray that does not point ahead.
    """
    directions, seen, T = _checked_rays(rays, T_world_camera)
    if np.any(directions[..., 2] <= 0):
        raise InputError("the linear equations take rays ahead of their cameras, z > 0; use `triangulate`")
    xy = directions[..., :2] / directions[..., 2:]
    B = np.concatenate([np.broadcast_to(np.eye(2), (*xy.shape[:2], 2, 2)), -xy[..., None]], axis=-1)
    B = B * seen[..., None, None]
    T_camera_world = se3.inverse(T)
    A = B @ T_camera_world[:, None, :3, :3]
    right = -np.einsum("vnkj,vj->vnk", B, T_camera_world[:, :3, 3])
    normal = np.einsum("vnki,vnkj->nij", A, A)
    values = np.linalg.eigvalsh(normal)
    parallel = np.flatnonzero(values[:, 0] < _PARALLEL * values[:, 2])
    if len(parallel):
        raise InputError(f"point {parallel[0]}: its rays are parallel, so its depth is unknown; move the cameras apart")
    return np.linalg.solve(normal, np.einsum("vnki,vnk->ni", A, right)[..., None])[..., 0]


def refine_points(p_world: ArrayLike, rays: ArrayLike, *, T_world_camera: ArrayLike) -> Array:
    """The points with the least squared angles to their rays, by Gauss-Newton from a start such as `triangulate`.

    The residual of view i is B_i^T q / |q|, q the point in camera i and B_i two axes across the ray. Unlike the
    linear solution it does not favour near views; with equal pixel noise it is the maximum-likelihood point to first
    order near the optical axis. A point whose step no longer lowers its error keeps its place.
    Args: p_world (n, 3); rays and T_world_camera as `triangulate`. Returns (n, 3), metres. Raises: as `triangulate`.
    """
    directions, seen, T = _checked_rays(rays, T_world_camera)
    X = np.array(p_world, dtype=np.float64)
    if X.shape != directions.shape[1:]:
        raise InputError(f"expected {directions.shape[1:]} start points for these rays, got {X.shape}")
    T_camera_world = se3.inverse(T)
    axes = _across(directions) * seen[..., None, None]
    error, J = _ray_angles(X, axes, T_camera_world)
    for _ in range(_REFINE_ITERATIONS):
        step = -np.linalg.solve(np.einsum("vnki,vnkj->nij", J, J), np.einsum("vnki,vnk->ni", J, error)[..., None])
        candidate = X + step[..., 0]
        new_error, new_J = _ray_angles(candidate, axes, T_camera_world)
        better = np.sum(new_error**2, axis=(0, 2)) < np.sum(error**2, axis=(0, 2))
        X = np.where(better[:, None], candidate, X)
        error = np.where(better[None, :, None], new_error, error)
        J = np.where(better[None, :, None, None], new_J, J)
        small = np.linalg.norm(step[..., 0], axis=-1) < _REFINE_STOP * np.linalg.norm(X - T[0, :3, 3], axis=-1)
        if np.all(small | ~better):
            break
    return X


def _ray_angles(X: Array, axes: Array, T_camera_world: Array) -> tuple[Array, Array]:
    """Residuals (views, n, 2) and their derivatives by X (views, n, 2, 3); see `refine_points`."""
    q = se3.apply(T_camera_world[:, None], X)
    distance = np.linalg.norm(q, axis=-1)[..., None]
    unit = q / distance
    error = np.einsum("vnki,vni->vnk", axes, unit)
    J_q = (axes - error[..., None] * unit[..., None, :]) / distance[..., None]
    return error, np.einsum("vnki,vij->vnkj", J_q, T_camera_world[:, :3, :3])


def _across(directions: Array) -> Array:
    """Two unit vectors across each direction and each other: (..., 3) -> (..., 2, 3)."""
    helper = np.eye(3)[np.argmin(np.abs(directions), axis=-1)]
    first = np.cross(directions, helper)
    first /= np.linalg.norm(first, axis=-1, keepdims=True)
    return np.stack([first, np.cross(directions, first)], axis=-2)


def _checked_rays(rays: ArrayLike, T_world_camera: ArrayLike) -> tuple[Array, Array, Array]:
    """Unit rays (views, n, 3), +z where unseen; seen (views, n) as 0 or 1; the transforms."""
    r = np.asarray(rays, dtype=np.float64)
    T = se3.check(T_world_camera, name="T_world_camera")
    if r.ndim != 3 or r.shape[-1] != 3 or T.shape != (len(r), 4, 4):
        raise InputError(f"expected rays (views, n, 3) and T_world_camera (views, 4, 4), got {r.shape} and {T.shape}")
    seen = np.all(np.isfinite(r), axis=-1)
    views = seen.sum(axis=0)
    lonely = np.flatnonzero(views < 2)
    if len(lonely):
        raise InputError(f"point {lonely[0]} is seen by {views[lonely[0]]} views; its position needs at least two")
    length = np.linalg.norm(r, axis=-1)
    if np.any(length[seen] == 0):
        raise InputError("a ray has length 0; mark a point that a view does not see with NaN")
    unit = np.where(seen[..., None], r, [0.0, 0.0, 1.0]) / np.where(seen, length, 1.0)[..., None]
    return unit, seen.astype(np.float64), T
