"""Interaction matrices: how features change with the motion of the camera.

A camera moves with the twist (omega, v), along its own axes, at its own centre; what it looks at stands still. A point
at (x, y), normalised, and depth Z then moves by (Chaumette and Hutchinson 2006, "Visual servo control, part I", eq. 11,
with rotation first as everywhere here)

    dx/dt = x y wx - (1 + x^2) wy + y wz - vx / Z + x vz / Z
    dy/dt = (1 + y^2) wx - x y wy - x wz - vy / Z + y vz / Z
"""

from __future__ import annotations

import numpy as np

from calibrant.arrays import Array
from calibrant.geometry import so3


def point_rows(xy: Array, depth: Array) -> Array:
    """d(x, y)/d(camera's twist) (2 n, 6) of points (n, 2), normalised, at depths (n,), metres.

    >>> import numpy as np
    >>> point_rows(np.array([[0.0, 0.0]]), np.array([0.5]))[0].tolist()
    [0.0, -1.0, 0.0, -2.0, 0.0, 0.0]
    """
    x, y = xy[:, 0], xy[:, 1]
    zero, near = np.zeros(len(xy)), 1.0 / depth
    rows = np.empty((len(xy), 2, 6))
    rows[:, 0] = np.stack([x * y, -(1 + x * x), y, -near, zero, x * near], axis=1)
    rows[:, 1] = np.stack([1 + y * y, -x * y, -x, zero, -near, y * near], axis=1)
    return rows.reshape(-1, 6)


def log_depth_row(xy: Array, depth: float) -> Array:
    """d log Z / d(camera's twist) (6,) of a point (2,), normalised: -vz / Z - y wx + x wy."""
    x, y = xy
    return np.array([-y, x, 0.0, 0.0, 0.0, -1.0 / depth])


def turn_rows(R_wanted_camera: Array) -> Array:
    """d log(R) / d(camera's twist) (3, 6) of the camera's rotation seen from where it is wanted.

    dR/dt = R hat(omega), so d log(R)/dt = J_l^-T(log R) omega, J_l the left Jacobian.
    """
    turn = so3.left_jacobian_inverse(so3.log(R_wanted_camera)).T
    return np.concatenate([turn, np.zeros((3, 3))], axis=1)


def shift_rows(R_wanted_camera: Array) -> Array:
    """d t / d(camera's twist) (3, 6) of the camera's centre seen from where it is wanted: R v."""
    return np.concatenate([np.zeros((3, 3)), R_wanted_camera], axis=1)
