"""Features as they are wanted and as they are seen, in coordinates that do not know the lens."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3
from calibrant.servoing.sight.interaction import point_rows

CERTAIN = 3.0
"""Sigmas of the worst direction within which a distance is with 99 % chance or more."""


@dataclass(frozen=True, eq=False)
class Features:
    """Points of one picture: ids (n,); uv (n, 2) pixels; sigma_px (n,) per axis; xy (n, 2) normalised and slope
    (n, 2, 2), d xy / d uv; depth (n,) metres; points (n, 3) of the target, its frame, and T_camera_target (4, 4), where
    there is a model; time_s on the robot's clock."""

    ids: NDArray[np.int64]
    uv: Array
    sigma_px: Array
    xy: Array
    slope: Array
    depth: Array
    points: Array | None = None
    T_camera_target: Array | None = None
    time_s: float = 0.0

    def __len__(self) -> int:
        return len(self.ids)

    @property
    def middle_depth(self) -> float:
        """Mean depth, metres."""
        return float(self.depth.mean())

    @property
    def weights(self) -> Array:
        """(2 n, 2 n) in blocks: W with |W e|^2 = sum over points of (pixels / sigma)^2, e normalised."""
        root = np.linalg.inv(self.slope) / self.sigma_px[:, None, None]
        out = np.zeros((2 * len(self), 2 * len(self)))
        for i, block in enumerate(root):
            out[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = block
        return out

    def only(self, ids: NDArray[np.int64]) -> Features:
        """Those of these ids, in their order; all are there."""
        row = {int(label): i for i, label in enumerate(self.ids)}
        rows = np.array([row[int(label)] for label in ids], dtype=np.int64)
        return replace(
            self, ids=self.ids[rows], uv=self.uv[rows], sigma_px=self.sigma_px[rows], xy=self.xy[rows],
            slope=self.slope[rows], depth=self.depth[rows], points=None if self.points is None else self.points[rows],
        )  # fmt: skip


def features_of(
    camera: Camera,
    ids: NDArray[np.int64],
    uv: Array,
    sigma_px: Array,
    depth: Array,
    *,
    points: Array | None = None,
    T_camera_target: Array | None = None,
    time_s: float = 0.0,
) -> Features:
    """Pixels (n, 2) freed of the lens. Raises: InputError for pixels outside the lens's valid field."""
    around = uv + np.array([[[0.0, 0.0]], [[1.0, 0.0]], [[0.0, 1.0]]])
    rays = camera.unproject(around)
    if not np.isfinite(rays).all() or np.any(rays[..., 2] <= 0):
        raise InputError("features lie outside the camera's valid field; is it the camera that took the picture?")
    xy = rays[..., :2] / rays[..., 2:]
    slope = np.stack([xy[1] - xy[0], xy[2] - xy[0]], axis=-1)
    return Features(ids, uv, sigma_px, xy[0], slope, depth, points, T_camera_target, time_s)


def shared(seen: Features, wanted: Features, *, least: int) -> tuple[Features, Features]:
    """Both with the points they have in common, in one order. Raises: RefusedError for fewer than `least`."""
    ids = np.intersect1d(wanted.ids, seen.ids)
    if len(ids) < least:
        raise RefusedError(
            f"{len(ids)} of the {len(wanted)} features that are wanted are in the picture; {least} are needed: is it "
            "the target that was taught, and is it whole in the picture?"
        )
    return seen.only(ids), wanted.only(ids)


def averaged(several: list[Features]) -> Features:
    """The mean of features of pictures from one place, of those that all show; sigma falls with their root."""
    ids = several[0].ids
    for other in several[1:]:
        ids = np.intersect1d(ids, other.ids)
    same = [f.only(ids) for f in several]
    last = same[-1]
    poses = [f.T_camera_target for f in same if f.T_camera_target is not None]
    return replace(
        last, uv=np.mean([f.uv for f in same], axis=0), xy=np.mean([f.xy for f in same], axis=0),
        depth=np.mean([f.depth for f in same], axis=0), sigma_px=last.sigma_px / np.sqrt(len(same)),
        T_camera_target=se3.mean(np.stack(poses)) if len(poses) == len(same) else last.T_camera_target,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Remaining:
    """What is left to go: delta (6,), the camera's way from where it is wanted to where it is, along its own axes
    (radians, metres), its covariance (6, 6), and noise: times their sigma that the features disagree by."""

    delta: Array
    covariance: Array
    noise: float

    @property
    def mm(self) -> float:
        """Distance, millimetres."""
        return 1e3 * float(np.linalg.norm(self.delta[3:]))

    @property
    def deg(self) -> float:
        """Turn, degrees."""
        return float(np.rad2deg(np.linalg.norm(self.delta[:3])))

    @property
    def sigma_mm(self) -> float:
        """1 sigma of the distance's worst direction, millimetres."""
        return 1e3 * float(np.sqrt(max(np.linalg.eigvalsh(self.covariance[3:, 3:])[-1], 0.0)))

    @property
    def within_99_mm(self) -> float:
        """Distance that what remains is below with 99 % chance: the mean and three sigmas of its worst direction."""
        return self.mm + CERTAIN * self.sigma_mm

    @property
    def within_99_deg(self) -> float:
        """The same of the turn, degrees."""
        return self.deg + CERTAIN * self.sigma_deg

    @property
    def sigma_deg(self) -> float:
        """1 sigma of the turn's worst direction, degrees."""
        return float(np.rad2deg(np.sqrt(max(np.linalg.eigvalsh(self.covariance[:3, :3])[-1], 0.0))))


def remaining(seen: Features, wanted: Features, subspace: Array) -> Remaining:
    """The small motion of the camera, of the twists that `subspace` (6, k) spans, that explains the difference.

        delta = S (S^T L^T C^-1 L S)^-1 S^T L^T C^-1 (s - s*),   C = C_s + C_s*

    C is scaled by what the difference leaves unexplained, where the features are more than are needed: noise that was
    stated too small does not make the answer too certain.
    """
    sigma = np.hypot(seen.sigma_px, wanted.sigma_px)
    W = replace(wanted, sigma_px=sigma).weights
    e = W @ (seen.xy - wanted.xy).ravel()
    L = W @ (0.5 * (point_rows(wanted.xy, wanted.depth) + point_rows(seen.xy, seen.depth))) @ subspace
    P = np.linalg.pinv(L)
    step = P @ e
    spare = len(e) - subspace.shape[1]
    left = float(np.sqrt(np.sum((e - L @ step) ** 2) / spare)) if spare > 0 else 1.0
    C = subspace @ (P @ P.T) @ subspace.T * max(left, 1.0) ** 2
    return Remaining(subspace @ step, C, left)
