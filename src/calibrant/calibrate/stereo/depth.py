"""How certain a triangulated point is: by the calibration of both eyes, and by the noise of one match.

A point p of the left camera's frame is where both residuals are least, r_l = project(theta_l, p) - u_l and
r_r = project(theta_r, T_left_right^-1 p) - u_r. With J its derivatives by p, A = J^T W J, it follows what it rests on:

    dp = -A^-1 J^T W (J_theta dtheta - du),     C_p = D C D^T + A^-1,

D = A^-1 J^T W J_theta over both lenses and the transform together, so that errors which they share cancel as they do.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.geometry import se3, so3


@dataclass(frozen=True, eq=False)
class PointCertainty:
    """Covariances (n, 3, 3), square metres along the left camera's axes: by the calibration, and by one match."""

    calibration: Array
    matching: Array

    @property
    def both(self) -> Array:
        """Their sum: they are independent."""
        return self.calibration + self.matching


def point_certainty(
    left: Camera,
    right: Camera,
    T_left_right: Array,
    points: Array,
    *,
    covariance: Array,
    sigma_px: tuple[float, float],
) -> PointCertainty:
    """Of points (n, 3) that both see, left camera's frame, metres.

    covariance (k, k): of T_left_right, the left lens and the right one (`JointCovariance.whole`); zero for
    what is exact. sigma_px: of a match, per
    axis, in each image.
    """
    p = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    R, t = T_left_right[:3, :3], T_left_right[:3, 3]
    T_right_left = se3.inverse(T_left_right)
    _, J_left, by_left = left.model.project_with_jacobians(left.values, p)
    _, J_in_right, by_right = right.model.project_with_jacobians(right.values, se3.apply(T_right_left, p))
    # q = R^T (p - t), with R <- exp(omega) R: d q = R^T [p - t]x omega - R^T dt.
    by_place = J_in_right @ np.concatenate([R.T @ so3.hat(p - t), np.broadcast_to(-R.T, (len(p), 3, 3))], axis=2)
    J = np.concatenate([J_left, J_in_right @ R.T], axis=1)
    weight = 1 / np.repeat(np.square(sigma_px), 2)
    weighted = np.swapaxes(J, 1, 2) * weight
    A = np.linalg.inv(weighted @ J)
    a, b = by_left.shape[2], by_right.shape[2]
    by_all = np.zeros((len(p), 4, a + b + 6))
    by_all[:, 2:, :6] = by_place
    by_all[:, :2, 6 : 6 + a] = by_left
    by_all[:, 2:, 6 + a :] = by_right
    D = A @ weighted @ by_all
    return PointCertainty(D @ covariance @ np.swapaxes(D, 1, 2), A)
