"""Where a tool's tip is on the flange: by touching one point from several sides, or by watching the tip with a camera.

Touching. The tip p (flange frame) rests on one point c (base frame) in every pose:

    R_i p + t_i = c        linear in (p, c): [R_i, -I] [p; c] = -t_i

Turning about one axis alone leaves p along that axis undetermined.

Seeing. A calibrated camera that stands still sees the tip at the pixel u_i:

    project(T_camera_base (R_i p + t_i)) = u_i

from a linear start (the tip lies on every ray, (I - d d^T)(R_i p + t_i - o) = 0) by Gauss-Newton. The camera's place
and lens, c, are uncertain, and shift the tip in all views alike: they are unknowns too, within their joint covariance
C = L L^T, c = c_0 + L z,

    min |r(p, c)|^2 / sigma^2 + |z|^2.

The noise is that of the residuals, sigma^2 = r^T r / nu with nu the residuals to spare (`optimize.noise`): it holds
what the robot, the touch or the eye did wrong. Estimated from few, it makes the covariance nu / (nu - 2) times as
large, the variance of Student's t. A pose is at odds with the others when leaving it out lowers the sum of squares more
than chance would: for its d residuals e with covariance Q, T = e^T Q^-1 e, (T / d) (nu - d) / (nu - T) ~ F(d, nu - d).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.data import RobotPoses, TransformEstimate
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3, so3
from calibrant.optimize.chances import f_tail

LEAST_TOUCHES = 4
"""Three poses give 9 equations for 6 unknowns, but one bad touch among three cannot be told from the others."""
TOUCH_MM = (3.0, 10.0)
"""Touches that agree to no more than this, 1 sigma per axis: doubtful, and none. A hand guides a tip to a mark within a
millimetre, and the worst arm stands within two of where it says; ten are poses that do not touch one point."""
LEAST_SIGHTS = 3
"""Two views give 4 equations for 3 unknowns: a third tells whether they agree."""
WEAK = 1e-3
"""Smallest singular value over the largest at which a direction counts as turned about: rotations of 0.1 degrees, which
nobody means, would multiply the touch's error by a thousand."""
MAX_ITERATIONS = 50
LEAST_PX = 1e-6
"""Pixels: noise below what cameras and rounding have."""
SETTLED = 1e-12
"""Metres: a step far below rounding of robot poses."""


@dataclass(frozen=True, eq=False)
class ToolTip:
    """The tip p (3,) in the flange frame, metres, with its covariance (3, 3).

    residuals (n,): what each pose is off by, in `unit` (mm for touches, px for views); sigma: their noise per axis, the
    same unit; chances (n,): probability that noise alone puts a pose as far from what the others say; point (3,): what
    was touched, base frame, metres, None for a seen tip; of_camera: part of the variance that is the camera's own place
    and lens.
    """

    tip: Array
    covariance: Array
    residuals: Array
    sigma: float
    unit: str
    ids: tuple[str, ...]
    chances: Array
    point: Array | None = None
    of_camera: float = 0.0

    @property
    def sigma_mm(self) -> Array:
        """1 sigma of the tip along the flange's x, y, z, millimetres."""
        return 1e3 * np.sqrt(np.diag(self.covariance))


def tip_by_touch(T_base_flange: RobotPoses | ArrayLike) -> ToolTip:
    """The tip from poses (n, 4, 4), n >= 4, in which it touches one and the same point.

    Raises: InputError for fewer poses or matrices that are not rigid; RefusedError when the orientations are too alike,
    naming the direction that stays open.
    """
    poses = T_base_flange if isinstance(T_base_flange, RobotPoses) else RobotPoses.from_matrices(T_base_flange)
    n = len(poses)
    if n < LEAST_TOUCHES:
        raise InputError(f"{n} touches; at least {LEAST_TOUCHES} are needed, with the tool tilted to several sides")
    R, t = poses.T_base_gripper[:, :3, :3], poses.T_base_gripper[:, :3, 3]
    # c is eliminated first: its best value is the mean of the tips, so only differences of rotations tell p.
    spread = (R - R.mean(axis=0)).reshape(-1, 3)
    _, values, directions = np.linalg.svd(spread, full_matrices=False)
    if values[-1] < WEAK * np.sqrt(n):
        raise RefusedError(_undetermined(values, directions, n))
    p: Array = np.linalg.lstsq(spread, -(t - t.mean(axis=0)).ravel(), rcond=None)[0].astype(np.float64)
    tips = np.asarray(R @ p + t)
    point: Array = np.mean(tips, axis=0, dtype=np.float64)
    residuals = tips - point
    spare = 3 * n - 6
    sigma = float(np.sqrt(np.sum(residuals**2) / spare))
    unit: Array = np.linalg.inv(spread.T @ spread).astype(np.float64)
    # What a pose's own residual loses to the fit: its share of the point, and of the tip.
    centred = spread.reshape(n, 3, 3)
    Q = np.eye(3) * (1 - 1 / n) - centred @ unit @ np.swapaxes(centred, -1, -2)
    chances = _chances(residuals, sigma**2 * Q, spare)
    off = np.asarray(1e3 * np.linalg.norm(residuals, axis=1), dtype=np.float64)
    covariance: Array = (_student(spare) * sigma**2 * unit).astype(np.float64)
    return ToolTip(p, covariance, off, 1e3 * sigma, "mm", poses.ids, chances, point)


def tip_by_sight(
    T_base_flange: RobotPoses | ArrayLike,
    uv: ArrayLike,
    *,
    camera: Camera,
    base_camera: TransformEstimate,
    covariance: ArrayLike | None = None,
) -> ToolTip:
    """The tip from poses (n, 4, 4), n >= 3, in which a camera that stands still sees it at uv (n, 2) px.

    Args: base_camera, T_base_camera; covariance (6 + k, 6 + k) of it and the camera's parameters together, by default
    their own ones, as if independent. Raises: InputError for too few views, shapes that do not fit, pixels without a
    ray; RefusedError when the views do not determine the tip.
    """
    poses = T_base_flange if isinstance(T_base_flange, RobotPoses) else RobotPoses.from_matrices(T_base_flange)
    pixels = np.asarray(uv, dtype=np.float64)
    n = len(poses)
    if pixels.shape != (n, 2) or not np.all(np.isfinite(pixels)):
        raise InputError(f"{n} poses need {n} finite pixels (n, 2), got shape {pixels.shape}")
    if n < LEAST_SIGHTS:
        raise InputError(f"{n} views of the tip; at least {LEAST_SIGHTS} are needed, with the tool turned between them")
    root = _tip_root(camera, base_camera, covariance)
    T_camera_flange = se3.inverse(base_camera.matrix) @ poses.T_base_gripper
    # The tip, then the camera's deviations z from where it was calibrated, in units of their sigma.
    x = np.concatenate([_on_rays(T_camera_flange, camera, pixels), np.zeros(root.shape[1])])
    prior = np.diag(np.concatenate([np.zeros(3), np.ones(root.shape[1])]))
    r, A = _sight(poses.T_base_gripper, camera, base_camera.matrix, pixels, x, root)
    variance = max(float(np.sum(np.linalg.lstsq(A[:, :3], r, rcond=None)[1])) / (2 * n - 3), LEAST_PX**2)
    spare = 2.0 * n - 3
    for _ in range(MAX_ITERATIONS):
        normal = A.T @ A / variance + prior
        step = np.linalg.solve(normal, -A.T @ r / variance - prior @ x)
        x = np.asarray(x + step)
        r, A = _sight(poses.T_base_gripper, camera, base_camera.matrix, pixels, x, root)
        spare = float(2 * n - np.trace(np.linalg.solve(A.T @ A / variance + prior, A.T @ A / variance)))
        before, variance = variance, max(float(r @ r) / spare, LEAST_PX**2)
        if np.linalg.norm(step[:3]) < SETTLED and abs(variance - before) < 1e-6 * variance:
            break
    C = np.asarray(np.linalg.inv(A.T @ A / (variance * _student(spare)) + prior), dtype=np.float64)
    parts = A.reshape(n, 2, -1)
    Q = variance * np.eye(2) - parts @ np.linalg.inv(A.T @ A / variance + prior) @ np.swapaxes(parts, -1, -2)
    off = r.reshape(n, 2)
    chances = _chances(off, Q, spare) if variance > LEAST_PX**2 else np.ones(n)
    of_noise = variance * _student(spare) * np.linalg.inv(A[:, :3].T @ A[:, :3])
    return ToolTip(
        x[:3], C[:3, :3], np.linalg.norm(off, axis=1), float(np.sqrt(variance)), "px", poses.ids, chances,
        of_camera=float(max(1 - np.trace(of_noise) / np.trace(C[:3, :3]), 0.0)),
    )  # fmt: skip


def _student(spare: float) -> float:
    """Variance of Student's t with that many residuals to spare; below 3 it has none, and 3 stands for it."""
    nu = max(spare, 3.0)
    return nu / (nu - 2)


def _chances(residuals: Array, Q: Array, spare: float) -> Array:
    """Probability (n,) of residuals (n, d), of covariance Q (n, d, d), as large as these by noise alone; see above."""
    d = residuals.shape[1]
    if not np.any(residuals) or spare <= d:
        return np.ones(len(residuals))
    # A pose that alone tells something leaves nothing of its residual in that direction: Q is singular there.
    T = np.einsum("ni,nij,nj->n", residuals, np.linalg.pinv(Q, rcond=1e-9, hermitian=True), residuals)
    T = np.minimum(T, spare * (1 - 1e-12))
    return f_tail(d, spare - d, T / d * (spare - d) / (spare - T))


def _tip_root(camera: Camera, base_camera: TransformEstimate, covariance: ArrayLike | None) -> Array:
    """L (6 + k, m) with L L^T the covariance of the camera's place and parameters, no column for what is exact."""
    k = len(camera.values)
    if covariance is None:
        C = np.zeros((6 + k, 6 + k))
        C[:6, :6] = 0.0 if base_camera.covariance is None else base_camera.covariance
        C[6:, 6:] = 0.0 if camera.covariance is None else camera.covariance
    else:
        C = np.asarray(covariance, dtype=np.float64)
        if C.shape != (6 + k, 6 + k):
            raise InputError(f"the covariance of place and camera is ({6 + k}, {6 + k}), got {C.shape}")
    scale = np.sqrt(np.maximum(np.diag(C), 0.0))
    free = scale > 0
    values, vectors = np.linalg.eigh(C[np.ix_(free, free)] / np.outer(scale[free], scale[free]))
    keep = values > 1e-12
    root = np.zeros((6 + k, int(keep.sum())))
    root[free] = scale[free, None] * vectors[:, keep] * np.sqrt(values[keep])
    return root


def _undetermined(values: Array, directions: Array, n: int) -> str:
    open_ = values < WEAK * np.sqrt(n)
    if open_.all():
        return "all touches have the same orientation: nothing tells where the tip is; tilt the tool between touches"
    axis = ", ".join(f"{c:+.2f}" for c in directions[-1])
    return (
        f"all touches turn about one axis, ({axis}) in the flange frame: where the tip is along it stays open; tilt "
        "the tool about another axis as well"
    )


def _on_rays(T_camera_flange: Array, camera: Camera, uv: Array) -> Array:
    """The flange point (3,) nearest to all rays: sum_i (I - d d^T)(R_i p + t_i) = 0 in least squares."""
    d = camera.unproject(uv)
    lost = ~np.isfinite(d).all(axis=1)
    if lost.any():
        raise InputError(f"view {int(np.flatnonzero(lost)[0])}: the pixel lies outside the camera's valid field")
    off = np.eye(3) - d[:, :, None] * d[:, None, :]
    A = (off @ T_camera_flange[:, :3, :3]).reshape(-1, 3)
    b = -(off @ T_camera_flange[:, :3, 3, None]).ravel()
    values = np.linalg.svd(A, compute_uv=False)
    if values[-1] < WEAK * values[0]:
        raise RefusedError("the views do not determine the tip: turn the tool between them, about several axes")
    return np.asarray(np.linalg.lstsq(A, b, rcond=None)[0], dtype=np.float64)


def _sight(
    T_base_flange: Array, camera: Camera, T_base_camera: Array, uv: Array, x: Array, root: Array
) -> tuple[Array, Array]:
    """Residuals (2n,) and their derivative (2n, 3 + m) by the tip and the camera's deviations."""
    change = root @ x[3:]
    place, values = se3.retract(T_base_camera, change[:6]), camera.values + change[6:]
    T = se3.inverse(place) @ T_base_flange
    seen = se3.apply(T, x[:3])
    pixels, J_point, J_camera = camera.model.project_with_jacobians(values, seen)
    if not np.all(np.isfinite(pixels)):
        raise RefusedError(
            "the views contradict each other: the tip they agree on is behind the camera in some of them"
        )
    of_place = np.concatenate([J_point @ _seen_from_camera(place, T, x[:3]), J_camera], axis=-1)
    A = np.concatenate([J_point @ T[:, :3, :3], of_place @ root], axis=-1)
    return (pixels - uv).ravel(), A.reshape(-1, len(x))


def _seen_from_camera(T_base_camera: Array, T_camera_flange: Array, p: Array) -> Array:
    """d (tip in the camera) / d T_base_camera, (n, 3, 6): p_c = R^T (p_base - t), d p_c = R^T [hat(p_base - t), -I]."""
    Rt = T_base_camera[:3, :3].T
    arm = se3.apply(T_camera_flange, p) @ Rt  # p_base - t, base axes
    J = np.empty((len(arm), 3, 6))
    J[:, :, :3] = Rt @ so3.hat(arm)
    J[:, :, 3:] = -Rt
    return J
