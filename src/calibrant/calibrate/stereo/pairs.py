"""What both eyes of a pair saw of the target at one moment, and how far it is from their common geometry."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array, Indices
from calibrant.cameras import Camera
from calibrant.data import View
from calibrant.data.details import EpipolarErrors, PairErrors
from calibrant.geometry import se3
from calibrant.geometry.projective import epipolar_distance, epipolar_lines, fundamental_from_transform
from calibrant.geometry.triangulation import refine_points, triangulate

STEEPEST = float(np.cos(np.deg2rad(85)))
"""Rays further from the axis have no undistorted pixel that says anything: it runs off to infinity at 90 degrees."""
_STEP = 0.25
"""Pixels: small beside what a lens changes over, large beside the rounding of its inverse."""


@dataclass(frozen=True, eq=False)
class Seen:
    """Points of the target that both cameras saw at a moment: ids (n,), points (n, 3), pixels (n, 2) in each image."""

    moment: str
    left: str
    right: str
    point_ids: Indices
    points: Array
    uv_left: Array
    uv_right: Array


def seen_by_both(left: Iterable[View], right: Iterable[View]) -> list[Seen]:
    """The pairs of views of one moment, with the points that are in both; none for a pair without a common point."""
    other = {v.moment: v for v in right}
    out = []
    for a in left:
        b = other.get(a.moment)
        if b is None:
            continue
        ids, i, j = np.intersect1d(a.point_ids, b.point_ids, return_indices=True)
        if len(ids):
            out.append(Seen(a.moment, a.id, b.id, ids.astype(np.int64), a.points[i], a.uv[i], b.uv[j]))
    return out


def undistorted(camera: Camera, uv: Array) -> Array:
    """Pixels (n, 2) as the camera without distortion has them, K ray / ray_z; NaN beyond `STEEPEST`."""
    rays = camera.unproject(uv)
    z = rays[..., 2:]
    with np.errstate(invalid="ignore", divide="ignore"):
        flat = np.where(z > STEEPEST, rays / z, np.nan)
    return np.asarray((flat @ camera.K.T)[..., :2])


def fundamental(left: Camera, right: Camera, T_left_right: Array) -> Array:
    """F (3, 3) with u_right^T F u_left = 0 for undistorted pixels (u, v, 1)."""
    return fundamental_from_transform(se3.inverse(T_left_right), K_a=left.K, K_b=right.K)


def epipolar_errors(
    pairs: Sequence[Seen], left: Camera, right: Camera, T_left_right: Array, *, sigma_px: tuple[float, float]
) -> EpipolarErrors | None:
    """How far each point lies from the line of its partner, in both images; None where no pair has a point.

    sigma_px: noise per axis of each camera. A distance is off by that of both points, each as its lens and the scale
    of the two images carry it: a small image's tenth of a pixel is half a pixel in a large one.
    """
    F = fundamental(left, right, T_left_right)
    found: dict[str, PairErrors] = {}
    every, expected = [], []
    for pair in pairs:
        a, b = undistorted(left, pair.uv_left), undistorted(right, pair.uv_right)
        ok = np.all(np.isfinite(a) & np.isfinite(b), axis=1)
        if not ok.any():
            continue
        a, b = a[ok], b[ok]
        noise = [
            sigma * _stretch(camera, uv[ok])
            for camera, uv, sigma in zip((left, right), (pair.uv_left, pair.uv_right), sigma_px)
        ]
        expected += [_variance(F.T, b, a, *noise[::-1]), _variance(F, a, b, *noise)]
        in_left, in_right = epipolar_distance(F.T, b, a), epipolar_distance(F, a, b)
        both = np.concatenate([in_left, in_right])
        every.append(both)
        found[pair.moment] = PairErrors(
            pair.left,
            pair.right,
            *_spread(both),
            tuple(int(i) for i in pair.point_ids[ok]),
            tuple(in_left.tolist()),
            tuple(in_right.tolist()),
        )
    if not every:
        return None
    made = float(np.sqrt(np.nanmean(np.concatenate(expected))))
    return EpipolarErrors(*_spread(np.concatenate(every)), made, found)


def _stretch(camera: Camera, uv: Array) -> Array:
    """Derivative (n, 2, 2) of `undistorted` by the pixel, by central differences."""
    moved = [undistorted(camera, uv + step) - undistorted(camera, uv - step) for step in _STEP * np.eye(2)]
    return np.stack(moved, axis=-1) / (2 * _STEP)


def _variance(F_b_a: Array, a: Array, b: Array, noise_a: Array, noise_b: Array) -> Array:
    """Variance (n,) of `epipolar_distance(F_b_a, a, b)` of points on their lines.

    noise (n, 2, 2): roots of the points' covariances. The distance is u_b^T F u_a / |(F u_a)_12|, so that it changes
    with the points by (F^T u_b)_12 and (F u_a)_12 over that.
    """
    by_b = epipolar_lines(F_b_a, a)[:, :2]
    slope = np.linalg.norm(a @ F_b_a[:2, :2].T + F_b_a[:2, 2], axis=1, keepdims=True)
    by_a = (b @ F_b_a[:2, :2] + F_b_a[2, :2]) / slope
    return np.asarray(
        sum(np.sum(np.einsum("ni,nij->nj", d, root) ** 2, axis=1) for d, root in ((by_a, noise_a), (by_b, noise_b)))
    )


def _spread(values: Array) -> tuple[float, float, float]:
    """rms, least and largest."""
    return float(np.sqrt(np.mean(values**2))), float(values.min()), float(values.max())


def triangulated(pair: Seen, left: Camera, right: Camera, T_left_right: Array) -> Array:
    """The points (n, 3) in the left camera's frame, metres, with the least squared angles to their rays; NaN where a
    lens has no ray: a model that does not fit folds within the picture."""
    T = np.stack([np.eye(4), T_left_right])
    rays = np.stack([left.unproject(pair.uv_left), right.unproject(pair.uv_right)])
    ok = np.isfinite(rays).all(axis=(0, 2))
    found = np.full(rays.shape[1:], np.nan)
    if ok.any():
        rays = rays[:, ok]
        found[ok] = refine_points(triangulate(rays, T_world_camera=T), rays, T_world_camera=T)
    return found
