"""Where a tool's tip is on the flange: by touching one point from several sides, or by watching the tip with a camera.

Touching. The tip p (flange frame) rests on one point c (base frame) in every pose:

    R_i p + t_i = c        linear in (p, c): [R_i, -I] [p; c] = -t_i

Turning about one axis alone leaves p along that axis undetermined.

Seeing. A calibrated camera that stands still sees the tip at the pixel u_i:

    project(T_camera_base (R_i p + t_i)) = u_i

from a linear start (the tip lies on every ray, (I - d d^T)(R_i p + t_i - o) = 0) by Gauss-Newton. What is uncertain of
the camera's place shifts the tip in all views alike: with N the normal matrix and J_T the derivative by the camera,
C = sigma^2 N^-1 + G C_T G^T, G = -N^-1 J^T J_T.

The noise is that of the residuals, sigma^2 = r^T r / (residuals - unknowns): it holds what the robot, the touch or the
eye did wrong.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calibrant.cameras import Camera
from calibrant.data import RobotPoses, TransformEstimate
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3, so3

Array = NDArray[np.float64]

LEAST_TOUCHES = 4
"""Three poses give 9 equations for 6 unknowns, but one bad touch among three cannot be told from the others."""
LEAST_SIGHTS = 3
"""Two views give 4 equations for 3 unknowns: a third tells whether they agree."""
WEAK = 1e-3
"""Smallest singular value over the largest at which a direction counts as turned about: rotations of 0.1 degrees, which
nobody means, would multiply the touch's error by a thousand."""
MAX_ITERATIONS = 20
SETTLED = 1e-12
"""Metres: a step far below rounding of robot poses."""


@dataclass(frozen=True, eq=False)
class ToolTip:
    """The tip p (3,) in the flange frame, metres, with its covariance (3, 3).

    residuals (n,): what each pose is off by, in `unit` (mm for touches, px for views); sigma: their noise per axis, the
    same unit; point (3,): what was touched, base frame, metres, None for a seen tip.
    """

    tip: Array
    covariance: Array
    residuals: Array
    sigma: float
    unit: str
    ids: tuple[str, ...]
    point: Array | None = None

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
    point = tips.mean(axis=0)
    residuals = tips - point
    sigma = float(np.sqrt(np.sum(residuals**2) / (3 * n - 6)))
    covariance = sigma**2 * np.linalg.inv(spread.T @ spread)
    return ToolTip(p, covariance, 1e3 * np.linalg.norm(residuals, axis=1), 1e3 * sigma, "mm", poses.ids, point)


def tip_by_sight(
    T_base_flange: RobotPoses | ArrayLike, uv: ArrayLike, *, camera: Camera, base_camera: TransformEstimate
) -> ToolTip:
    """The tip from poses (n, 4, 4), n >= 3, in which a camera that stands still sees it at uv (n, 2) px.

    Args: base_camera, T_base_camera with its covariance, which enters the tip's. Raises: InputError for too few views,
    shapes that do not fit, pixels without a ray; RefusedError when the views do not determine the tip.
    """
    poses = T_base_flange if isinstance(T_base_flange, RobotPoses) else RobotPoses.from_matrices(T_base_flange)
    pixels = np.asarray(uv, dtype=np.float64)
    n = len(poses)
    if pixels.shape != (n, 2) or not np.all(np.isfinite(pixels)):
        raise InputError(f"{n} poses need {n} finite pixels (n, 2), got shape {pixels.shape}")
    if n < LEAST_SIGHTS:
        raise InputError(f"{n} views of the tip; at least {LEAST_SIGHTS} are needed, with the tool turned between them")
    T_camera_base = se3.inverse(base_camera.matrix)
    T_camera_flange = T_camera_base @ poses.T_base_gripper
    p = _on_rays(T_camera_flange, camera, pixels)
    for _ in range(MAX_ITERATIONS):
        r, J, _ = _sight(T_camera_flange, camera, pixels, p)
        step = np.linalg.lstsq(J, -r, rcond=None)[0]
        p = np.asarray(p + step)
        if np.linalg.norm(step) < SETTLED:
            break
    r, J, J_seen = _sight(T_camera_flange, camera, pixels, p)
    N = np.linalg.inv(J.T @ J)
    sigma = float(np.sqrt(r @ r / (2 * n - 3)))
    covariance = np.asarray(sigma**2 * N, dtype=np.float64)
    if base_camera.covariance is not None:
        J_camera = J_seen @ _seen_from_camera(base_camera.matrix, T_camera_flange, p)
        G = -N @ J.T @ J_camera.reshape(-1, 6)
        covariance += G @ base_camera.covariance @ G.T
    return ToolTip(p, covariance, np.linalg.norm(r.reshape(-1, 2), axis=1), sigma, "px", poses.ids)


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


def _sight(T_camera_flange: Array, camera: Camera, uv: Array, p: Array) -> tuple[Array, Array, Array]:
    """Residuals (2n,), d / d p (2n, 3), and d pixel / d point in the camera (n, 2, 3)."""
    seen = se3.apply(T_camera_flange, p)
    pixels, J_point, _ = camera.model.project_with_jacobians(camera.values, seen)
    if not np.all(np.isfinite(pixels)):
        raise RefusedError(
            "the views contradict each other: the tip they agree on is behind the camera in some of them"
        )
    return (pixels - uv).ravel(), (J_point @ T_camera_flange[:, :3, :3]).reshape(-1, 3), J_point


def _seen_from_camera(T_base_camera: Array, T_camera_flange: Array, p: Array) -> Array:
    """d (tip in the camera) / d T_base_camera, (n, 3, 6): p_c = R^T (p_base - t), d p_c = R^T [hat(p_base - t), -I]."""
    Rt = T_base_camera[:3, :3].T
    arm = se3.apply(T_camera_flange, p) @ Rt  # p_base - t, base axes
    J = np.empty((len(arm), 3, 6))
    J[:, :, :3] = Rt @ so3.hat(arm)
    J[:, :, 3:] = -Rt
    return J
