"""Depth pictures taken from many poses, moved into the base by the calibration: how far their surfaces are apart.

A point of picture i is looked up in picture j where it lands there, and its distance from the surface of j is told
along that surface's normal,

    d = n_j . (p_i - p_j),    p_i = A_i X p,

so that only what both saw counts, and no point needs its own partner. Depth noise averages out over a block of pixels;
what is left of the blocks is what the calibration, the robot and the depth camera's own scale make:

    var d = n^T [(J_i - J_j) C_X (J_i - J_j)^T + C_robot,i + C_robot,j] n + (sigma_z^2 / samples)_i + (...)_j

J_i the map from an error of X to the point. An error of X that moves all clouds alike is not seen: poses must differ.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array, Mask
from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.perceive.registered_depth.noise import DepthNoise
from calibrant.verification.touch.placing import robot_covariance
from calibrant.verification.unchanged.robot_noise import RobotSide

BLOCK_PX = 16
"""Side of a block of pixels: some 200 depths, whose noise is then a tenth."""
LEAST_SHARE = 0.5
"""Of a block's pixels that must be on the same surface in both."""
NEAR_M = 0.03
"""Farther apart, two surfaces are two things, one before the other."""
SLANT = 0.5
"""Cosine between a normal and the ray below which a surface is seen too much from the side to tell distances."""
JUMP = 0.02
"""Of the depth, between neighbours that are on one surface: tilted by 60 deg it steps by 0.3 % a pixel at 600 px."""


@dataclass(frozen=True, eq=False)
class Cloud:
    """A depth picture in the depth camera's grid: points (h, w, 3), metres, in that camera; normals (h, w, 3); good
    (h, w); T_base_depth (4, 4) by the calibration, T_base_gripper (4, 4) by the robot."""

    name: str
    points: Array
    normals: Array
    good: Mask
    T_base_depth: Array
    T_base_gripper: Array


@dataclass(frozen=True, eq=False)
class Pair:
    """How far two clouds are apart: distances (k,) of blocks, metres, with variance (k,) as predicted."""

    name: str
    distances: Array
    variance: Array

    @property
    def rms(self) -> float:
        """RMS distance, metres."""
        return float(np.sqrt(np.mean(self.distances**2)))

    @property
    def expected(self) -> float:
        """RMS distance that is predicted, metres."""
        return float(np.sqrt(np.mean(self.variance)))


def cloud_of(name: str, depth: Array, rays: Array, T_base_depth: Array, T_base_gripper: Array) -> Cloud:
    """A cloud from a depth picture (h, w), metres, NaN where there is none, and rays (h, w, 3) with z = 1."""
    z = np.where(depth > 0, depth, np.nan).astype(np.float64)
    smooth = _smoothed(z)
    points = rays * smooth[..., None]
    along = np.full_like(points, np.nan)
    down = np.full_like(points, np.nan)
    along[:, 1:-1] = points[:, 2:] - points[:, :-2]
    down[1:-1] = points[2:] - points[:-2]
    normals = np.cross(along, down)
    length = np.linalg.norm(normals, axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        normals = normals / length[..., None]
        sight = points / np.linalg.norm(points, axis=-1)[..., None]
        seen = np.sum(normals * sight, axis=-1)
        flat = (np.abs(along[..., 2]) < JUMP * smooth) & (np.abs(down[..., 2]) < JUMP * smooth)
        good = np.isfinite(z) & np.isfinite(length) & flat & (np.abs(seen) > SLANT)
    return Cloud(
        name, rays * z[..., None], np.where(seen[..., None] > 0, -normals, normals), good, T_base_depth, T_base_gripper
    )


def _smoothed(z: Array, reach: int = 2) -> Array:
    """Mean of what is known around each pixel: normals of single pixels are noise."""
    known = np.isfinite(z)
    total, count = np.where(known, z, 0.0), known.astype(np.float64)
    for axis in (0, 1):
        total, count = (_running(v, reach, axis) for v in (total, count))
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(count > 0, total / count, np.nan)


def _running(v: Array, reach: int, axis: int) -> Array:
    width = [(reach + 1, reach) if k == axis else (0, 0) for k in range(2)]
    sums = np.cumsum(np.pad(v, width), axis=axis)
    n = v.shape[axis]
    return np.asarray(
        np.take(sums, np.arange(2 * reach + 1, n + 2 * reach + 1), axis) - np.take(sums, np.arange(n), axis)
    )


def compare(first: Cloud, second: Cloud, K: Array, side: RobotSide, noise: DepthNoise) -> Pair | None:
    """How far the first cloud is from the second's surface, block by block; None where they share none.

    Args: K (3, 3) of the depth camera, by which the second is looked up (lenses of depth cameras are rectified).
    """
    T = se3.inverse(second.T_base_depth) @ first.T_base_depth
    p = se3.apply(T, first.points[first.good])
    rows, columns = np.nonzero(first.good)
    with np.errstate(invalid="ignore", divide="ignore"):
        uv = p[:, :2] / p[:, 2:] * [K[0, 0], K[1, 1]] + K[:2, 2]
    h, w = second.good.shape
    u, v = (np.rint(np.nan_to_num(c, nan=-1.0)).astype(np.int64) for c in uv.T)
    inside = (u >= 0) & (v >= 0) & (u < w) & (v < h) & (p[:, 2] > 0)
    inside[inside] = second.good[v[inside], u[inside]]
    if not inside.any():
        return None
    p, u, v, rows, columns = p[inside], u[inside], v[inside], rows[inside], columns[inside]
    n = second.normals[v, u]
    d = np.sum(n * (p - second.points[v, u]), axis=1)
    turned = first.normals[rows, columns] @ T[:3, :3].T
    near = (np.abs(d) < NEAR_M) & (np.sum(turned * n, axis=1) > SLANT)
    return _by_block(first, second, p[near], n[near], d[near], (rows[near], columns[near]), side, noise)


def _by_block(
    first: Cloud,
    second: Cloud,
    p: Array,
    n: Array,
    d: Array,
    at: tuple[Array, Array],
    side: RobotSide,
    noise: DepthNoise,
) -> Pair | None:
    """Distances of blocks of the first picture. p, n: in the second's camera."""
    across = -(-first.good.shape[1] // BLOCK_PX)
    block = (np.asarray(at[0]) // BLOCK_PX * across + np.asarray(at[1]) // BLOCK_PX).astype(np.int64)
    counts = np.bincount(block)
    kept = np.flatnonzero(counts >= LEAST_SHARE * BLOCK_PX**2)
    if not len(kept):
        return None
    mean = np.bincount(block, d)[kept] / counts[kept]
    middle = np.stack([np.bincount(block, p[:, k])[kept] / counts[kept] for k in range(3)], axis=1)
    normal = np.stack([np.bincount(block, n[:, k])[kept] / counts[kept] for k in range(3)], axis=1)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    base = se3.apply(second.T_base_depth, middle)
    along = normal @ second.T_base_depth[:3, :3].T
    variance = _calibration(first, second, base, along, side)
    for cloud in (first, second):
        z = se3.apply(se3.inverse(cloud.T_base_depth), base)[:, 2]
        samples = counts[kept] / max(noise.pixels_per_sample, 1.0)
        variance = variance + noise.sigma_z(z) ** 2 / samples + (noise.scale_sigma * z) ** 2
    return Pair(f"{first.name} on {second.name}", mean, variance)


def _calibration(first: Cloud, second: Cloud, base: Array, along: Array, side: RobotSide) -> Array:
    """Variance (k,) of distances of points (k, 3) along directions (k, 3), by the calibration and the robot's poses."""
    maps, own = [], np.zeros(len(base))
    C_robot = robot_covariance(side)
    for cloud in (first, second):
        in_gripper = se3.apply(se3.inverse(cloud.T_base_gripper), base)
        R = cloud.T_base_gripper[:3, :3]
        # X <- retract(X, (omega, v)): the point moves by R (omega x R_X p + v), R_X p its arm from the camera.
        J = R @ np.concatenate(
            [-so3.hat(in_gripper - side.X[:3, 3]), np.broadcast_to(np.eye(3), (len(base), 3, 3))], -1
        )
        maps.append(np.einsum("ka,kai->ki", along, J))
        arm = base - cloud.T_base_gripper[:3, 3]
        M = np.concatenate([-so3.hat(arm), np.broadcast_to(np.eye(3), (len(base), 3, 3))], -1)
        m = np.einsum("ka,kai->ki", along, M)
        own = own + np.einsum("ki,ij,kj->k", m, C_robot, m)
    differ = maps[0] - maps[1]
    return np.asarray(own + np.einsum("ki,ij,kj->k", differ, side.covariance[:6, :6], differ))


def all_pairs(clouds: Sequence[Cloud], K: Array, side: RobotSide, noise: DepthNoise) -> tuple[Pair, ...]:
    """Every cloud against every other one. Raises: InputError for fewer than two, or none that share a surface."""
    if len(clouds) < 2:
        raise InputError("clouds agree with each other, or not: give the depth of two poses or more")
    found = [compare(a, b, K, side, noise) for i, a in enumerate(clouds) for b in clouds[i + 1 :]]
    pairs = tuple(p for p in found if p is not None)
    if not pairs:
        raise InputError(
            "no two depth pictures show the same surface where the calibration puts them: they must overlap, and a "
            "calibration that is off by more than 3 cm, or poses of other pictures, leave none"
        )
    return pairs
