"""Points in space from matches in two pictures or more, each with its covariance.

Three estimates, all linear to first order in what they rest on: with the pixels' prediction m(X, c) of a point X by the
calibration c, and weights W of a method,

    dX = A (dm - J_c dc),    A = (J_X^T W J_X)^-1 J_X^T W,

    Cov(X) = A Cov(m) A^T + (A J_c) Cov(c) (A J_c)^T

    midpoint    the point nearest to the rays: W weighs distances from rays, (range x angle)^2
    linear      homogeneous equations X - x Z, Y - y Z of each camera: W weighs (depth x slope)^2
    optimal     least squares in pixels over their noise, W = 1 / sigma^2: the most likely point
                (Hartley and Zisserman, Multiple View Geometry, 2nd ed., chapter 12)

The second term is shared: all points of a scene move together by it, and their mean does not lower it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array, Mask
from calibrant.calibrate.stereo.depth import point_certainty
from calibrant.errors import InputError
from calibrant.geometry import se3, triangulation
from calibrant.perceive.stereo.eyes import Eyes

Method = Literal["midpoint", "linear", "optimal"]
METHODS: tuple[Method, ...] = get_args(Method)
_STEPS = 20
_SETTLED = 1e-12
"""A step smaller than this part of the distance is rounding."""


@dataclass(frozen=True, eq=False)
class StereoPoints:
    """Points (n, 3), metres, first camera's frame, NaN where their rays do not meet ahead of the cameras.

    noise, calibration (n, 3, 3): covariance by the matches' noise, each point's own, and by the calibration, which all
    share; by_calibration (n, 3, p): d point / d of what `Eyes.covariance` is of. residuals_px (n,): RMS over cameras of
    what the pixels are off from the point, per point over both axes.
    """

    points: Array
    noise: Array
    calibration: Array
    by_calibration: Array
    residuals_px: Array

    @property
    def covariance(self) -> Array:
        """(n, 3, 3), square metres: both sources."""
        return self.noise + self.calibration

    @property
    def sigma_z(self) -> Array:
        """1 sigma of each point's depth in the first camera, metres."""
        return np.sqrt(self.covariance[:, 2, 2])

    @property
    def found(self) -> Mask:
        """Which points (n,) have a place."""
        return np.asarray(np.isfinite(self.points).all(axis=1))


def points_from_matches(
    eyes: Eyes, uv: ArrayLike, *, sigma_px: float | Sequence[float] = 0.5, method: Method = "optimal"
) -> StereoPoints:
    """Points and their covariance from their pixels.

    Args: uv (cameras, n, 2), NaN where a camera does not see the point; sigma_px: noise of a matched pixel per axis,
    one for all cameras or one each. Raises: InputError for shapes that do not fit, a point that fewer than two cameras
    see, an unknown method, noise that is not above 0.
    """
    m = np.asarray(uv, dtype=np.float64)
    count = len(eyes.cameras)
    if m.ndim != 3 or m.shape[0] != count or m.shape[2] != 2:
        raise InputError(f"matches of {count} cameras are pixels ({count}, n, 2), got {m.shape}")
    if method not in METHODS:
        raise InputError(f"unknown method {method!r}; expected one of {', '.join(METHODS)}")
    sigma = np.broadcast_to(np.asarray(sigma_px, dtype=np.float64), (count,))
    if not np.all((sigma > 0) & np.isfinite(sigma)):
        raise InputError(f"the noise of the matches is {sigma.tolist()} px; expected numbers above 0")
    seen: Mask = np.asarray(np.isfinite(m).all(axis=2))
    lonely = np.flatnonzero(seen.sum(axis=0) < 2)
    if len(lonely):
        raise InputError(f"match {lonely[0]} is seen by fewer than two cameras; leave it out")
    rays = np.stack([camera.unproject(pixels) for camera, pixels in zip(eyes.cameras, m)])
    seen = np.asarray(seen & np.isfinite(rays).all(axis=2))
    X = _start(eyes, rays, seen, method)
    if method == "optimal":
        X = _most_likely(eyes, X, m, seen, sigma)
    return _with_covariance(eyes, X, m, seen, sigma, method)


def _start(eyes: Eyes, rays: Array, seen: Mask, method: Method) -> Array:
    """Midpoints, or the solutions of the linear equations; NaN where rays are parallel or meet behind a camera."""
    X = np.full((rays.shape[1], 3), np.nan)
    T = eyes.T_first_camera
    d = np.where(seen[..., None], np.einsum("cij,cnj->cni", T[:, :3, :3], rays), 0.0)
    # Parallel rays have no point; `triangulate` would refuse all for one.
    pairs = np.einsum("cni,eni->nce", d, d) * (seen.T[:, :, None] & seen.T[:, None, :])
    both = (seen.T[:, :, None] & seen.T[:, None, :]) & ~np.eye(len(d), dtype=bool)
    apart = np.any(both & (1 - np.abs(pairs) > 1e-12), axis=(1, 2))
    if not apart.any():
        return X
    solve = triangulation.triangulate_linear if method == "linear" else triangulation.triangulate
    X[apart] = solve(np.where(seen[..., None], rays, np.nan)[:, apart], T_world_camera=T)
    ahead = np.ones(len(X), dtype=np.bool_)
    for T_i, r, s in zip(T, rays, seen):
        q = se3.apply(se3.inverse(T_i), X)
        with np.errstate(invalid="ignore"):
            ahead &= ~s | (np.einsum("ni,ni->n", q, np.where(s[:, None], r, 0.0)) > 0)
    X[~ahead] = np.nan
    return X


def _most_likely(eyes: Eyes, X: Array, m: Array, seen: Mask, sigma: Array) -> Array:
    """Gauss-Newton on the pixels; a point whose step does not lower its error keeps its place."""
    X = X.copy()
    error, J = _errors(eyes, X, m, seen, sigma)
    for _ in range(_STEPS):
        found: Mask = np.asarray(np.isfinite(X).all(axis=1))
        H = np.einsum("cnki,cnkj->nij", J, J)
        g = np.einsum("cnki,cnk->ni", J, error)
        H[~found] = np.eye(3)
        step = np.linalg.solve(H, np.where(found[:, None], -g, 0.0)[..., None])[..., 0]
        candidate = X + step
        new_error, new_J = _errors(eyes, candidate, m, seen, sigma)
        with np.errstate(invalid="ignore"):
            better = np.sum(new_error**2, axis=(0, 2)) < np.sum(error**2, axis=(0, 2))
            small = np.linalg.norm(step, axis=1) < _SETTLED * np.linalg.norm(X, axis=1)
        X = np.where(better[:, None], candidate, X)
        error = np.where(better[None, :, None], new_error, error)
        J = np.where(better[None, :, None, None], new_J, J)
        if np.all(small | ~better):
            break
    return X


def _errors(eyes: Eyes, X: Array, m: Array, seen: Mask, sigma: Array) -> tuple[Array, Array]:
    """(predicted - seen) / sigma (cameras, n, 2), 0 where unseen, and the derivative by X (cameras, n, 2, 3)."""
    error, J = np.zeros(m.shape), np.zeros((*m.shape, 3))
    for i, (camera, T) in enumerate(zip(eyes.cameras, eyes.T_first_camera)):
        T_camera = se3.inverse(T)
        q = se3.apply(T_camera, np.where(np.isfinite(X), X, 1.0))
        uv, J_q, _ = camera.model.project_with_jacobians(camera.values, q)
        error[i] = np.where(seen[i][:, None], (uv - m[i]) / sigma[i], 0.0)
        J[i] = np.where(seen[i][:, None, None], J_q @ T_camera[:3, :3] / sigma[i], 0.0)
    return error, J


def _with_covariance(eyes: Eyes, X: Array, m: Array, seen: Mask, sigma: Array, method: Method) -> StereoPoints:
    found: Mask = np.asarray(np.isfinite(X).all(axis=1))
    points = np.full((len(X), 3), np.nan)
    noise, calibration = np.full((2, len(X), 3, 3), np.nan)
    by = np.full((len(X), 3, len(eyes.covariance)), np.nan)
    residuals = np.full(len(X), np.nan)
    X, m, seen = X[found], m[:, found], seen[:, found]
    W, squares = np.zeros((len(m), len(X), 2, 2)), np.zeros(len(X))
    for i, (camera, T) in enumerate(zip(eyes.cameras, eyes.T_first_camera)):
        q = se3.apply(se3.inverse(T), X)
        uv, J_q, _ = camera.model.project_with_jacobians(camera.values, q)
        W[i] = np.where(seen[i][:, None, None], _weights(method, q, J_q, float(sigma[i])), 0.0)
        squares += np.where(seen[i], np.sum((uv - m[i]) ** 2, axis=1, where=np.isfinite(m[i])), 0.0)
    sure = point_certainty(
        eyes.cameras, eyes.T_first_camera, X, covariance=eyes.covariance, sigma_px=sigma.tolist(), weights=W
    )
    points[found], noise[found], calibration[found], by[found] = (
        X, sure.matching, sure.calibration, sure.by_calibration
    )  # fmt: skip
    residuals[found] = np.sqrt(squares / np.maximum(seen.sum(axis=0), 1))
    return StereoPoints(points, noise, calibration, by, residuals)


def _weights(method: Method, q: Array, J_q: Array, sigma: float) -> Array:
    """W (n, 2, 2) of a camera's pixels: what the method's own residuals make of them."""
    if method == "optimal":
        return np.broadcast_to(np.eye(2) / sigma**2, (len(q), 2, 2))
    # The pixel's offset as an offset of the point across its ray, or in the plane of equal depth: J_q B is 2 x 2.
    if method == "midpoint":
        unit = q / np.linalg.norm(q, axis=1, keepdims=True)
        helper = np.eye(3)[np.argmin(np.abs(unit), axis=1)]
        a = np.cross(unit, helper)
        a /= np.linalg.norm(a, axis=1, keepdims=True)
        B = np.stack([a, np.cross(unit, a)], axis=2)
    else:
        B = np.broadcast_to(np.eye(3)[:, :2], (len(q), 3, 2))
    back = np.linalg.inv(J_q @ B)
    return np.asarray(np.swapaxes(back, 1, 2) @ back)
