"""Tsai and Lenz: the rotation as a linear problem in the modified Rodrigues vector.

R. Y. Tsai, R. K. Lenz, "A new technique for fully autonomous and efficient 3D robotics hand/eye calibration", IEEE
Transactions on Robotics and Automation 5(3), 1989.
"""

from __future__ import annotations

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.solvers.relative import PosePairs
from calibrant.calibrate.solvers.solver import HandEyeSolver
from calibrant.calibrate.solvers.translation import separable
from calibrant.geometry import so3

HALF_TURNS = (
    np.diag([1.0, 1.0, 1.0]),
    np.diag([1.0, -1.0, -1.0]),
    np.diag([-1.0, 1.0, -1.0]),
    np.diag([-1.0, -1.0, 1.0]),
)
"""The identity and the half turns about x, y, z. Any rotation is within 120 degrees of one of them."""


def tsai(pairs: PosePairs) -> tuple[Array, None]:
    """Solve [P_A + P_B]_x p = P_B - P_A with P = 2 sin(theta / 2) n; p = tan(theta_X / 2) n_X; then t_X.

    p is infinite for a camera turned by half a turn, so the camera frame is first turned by the half turn (or none)
    that leaves X the smallest rotation: R_X = R' H, P_B -> H P_B.
    """
    m = pairs.motions
    P_A, P_B = 2 * m.quaternion_a[:, 1:], 2 * m.quaternion_b[:, 1:]
    solved = [(_rodrigues_vector(P_A, P_B @ H.T), H) for H in HALF_TURNS]
    p, H = min(solved, key=lambda candidate: float(np.linalg.norm(candidate[0])))
    return separable(pairs, so3.from_quaternion_wxyz(np.concatenate([[1.0], p])) @ H)


def _rodrigues_vector(P_A: Array, P_B: Array) -> Array:
    """p (3,) of the linear problem, by least squares."""
    p = np.linalg.lstsq(so3.hat(P_A + P_B).reshape(-1, 3), (P_B - P_A).reshape(-1), rcond=None)[0]
    return np.asarray(p, dtype=np.float64)


TSAI = HandEyeSolver("tsai", "Tsai and Lenz 1989", tsai)
