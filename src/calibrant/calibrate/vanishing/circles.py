"""Straight edges as great circles: the plane through the camera's centre that holds an edge, with its uncertainty.

A lens of any kind sees a straight edge along rays r_i of one plane, n . r_i = 0. With g_i = |d (n . r_i) / d uv_i| the
distance of point i from its arc is (n . r_i) / g_i pixels, and n minimises the sum of their squares:

    Lambda = sum r_i r_i^T / g_i^2,    n its eigenvector of the least eigenvalue,    C_n = pinv(Lambda) across n.

All that follows needs C_n for a noise of 1 px per point only: it scales with the square of the noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.cameras import CameraModel
from calibrant.detection.line_segments import Segments
from calibrant.errors import InputError

ROUNDS = 3
"""g depends on n; from n of equal weights it settles in two rounds to rounding."""
BENT = 4.0
"""Times the typical rms at which an edge is no straight one: a railing, a cable, two edges taken for one."""
LEAST_SIGMA_PX = 1e-3


@dataclass(frozen=True, eq=False)
class Circles:
    """Great circles of m edges: normals (m, 3), unit; covariance (m, 3, 3) for 1 px of noise a point.

    counts (m,): points of an edge; rms_px (m,): of the points across their arc, two values freed that it takes up.
    """

    normals: Array
    covariance: Array
    counts: NDArray[np.int64]
    rms_px: Array

    def __len__(self) -> int:
        return len(self.normals)

    def only(self, keep: NDArray[np.bool_]) -> Circles:
        """The circles where keep (m,) is true."""
        return Circles(self.normals[keep], self.covariance[keep], self.counts[keep], self.rms_px[keep])


def great_circles(model: CameraModel, values: Array, segments: Segments) -> Circles:
    """Great circles of edges seen by a camera. Raises: InputError for points that the camera has no ray for."""
    rays, J = _rays(model, values, segments.uv)
    starts, counts = segments.offsets[:-1], np.diff(segments.offsets)
    edge = np.repeat(np.arange(len(counts)), counts)
    weight = np.ones(len(rays))
    normals = np.empty((len(counts), 3))
    moments = np.empty((len(counts), 3, 3))
    for _ in range(ROUNDS):
        moments = np.add.reduceat(weight[:, None, None] * rays[:, :, None] * rays[:, None, :], starts, axis=0)
        normals = np.linalg.eigh(moments)[1][:, :, 0]
        slope = np.einsum("nij,ni->nj", J, normals[edge])
        weight = 1 / np.sum(slope**2, axis=1)
    squares = weight * np.sum(rays * normals[edge], axis=1) ** 2
    rms = np.sqrt(np.add.reduceat(squares, starts) / np.maximum(counts - 2, 1))
    spread, axes = np.linalg.eigh(moments)
    inverse = 1 / spread[:, 1:]
    covariance = np.einsum("mij,mj,mkj->mik", axes[:, :, 1:], inverse, axes[:, :, 1:])
    return Circles(normals, covariance, counts, rms)


def straight(circles: Circles) -> NDArray[np.bool_]:
    """Which edges (m,) are as straight as the others."""
    typical = float(np.median(circles.rms_px))
    return circles.rms_px <= BENT * max(typical, LEAST_SIGMA_PX)


def point_noise(circles: Circles) -> float:
    """Noise of an edge's points across it, px, pooled over straight edges."""
    freedom = np.maximum(circles.counts - 2, 1)
    return max(float(np.sqrt(np.sum(circles.rms_px**2 * freedom) / freedom.sum())), LEAST_SIGMA_PX)


def _rays(model: CameraModel, values: Array, uv: Array) -> tuple[Array, Array]:
    """Unit rays (N, 3) and d ray / d uv (N, 3, 2), by central differences over a pixel: rays bend far less."""
    h = 0.5
    steps = h * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])
    rays = model.unproject(values, (uv + steps[:, None]).reshape(-1, 2)).reshape(5, -1, 3)
    if not np.all(np.isfinite(rays)):
        bad = uv[~np.isfinite(rays).all(axis=(0, 2))][0]
        raise InputError(
            f"the camera has no ray for the edge point ({bad[0]:.1f}, {bad[1]:.1f}) px: its model does not reach that "
            "far; is it the camera that took the image?"
        )
    J = np.stack([rays[1] - rays[2], rays[3] - rays[4]], axis=-1) / (2 * h)
    return rays[0], J
