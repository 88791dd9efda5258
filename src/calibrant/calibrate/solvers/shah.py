"""Shah: both rotations of AX = ZB from one singular value decomposition of a sum of Kronecker products.

M. Shah, "Solving the robot-world/hand-eye calibration problem using the Kronecker product", ASME Journal of Mechanisms
and Robotics 5(3), 2013.
"""

from __future__ import annotations

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.solvers.relative import PosePairs
from calibrant.calibrate.solvers.solver import HandEyeSolver
from calibrant.calibrate.solvers.translation import with_translations
from calibrant.geometry import so3


def shah(pairs: PosePairs) -> tuple[Array, Array]:
    """Maximise sum trace(R_Z^T R_A R_X R_B) = vec(R_Z)^T K vec(R_X), K = sum R_A (x) R_B^T, vec by rows.

    The first singular vectors of K, made rotations, are R_Z and R_X; their common sign is the one with det > 0. Then
    both translations by linear least squares.
    """
    K = np.einsum("nij,nlk->ikjl", pairs.A[:, :3, :3], pairs.B[:, :3, :3]).reshape(9, 9)
    U, _, Vt = np.linalg.svd(K)
    u, v = U[:, 0].reshape(3, 3), Vt[0].reshape(3, 3)
    sign = np.sign(np.linalg.det(v))
    return with_translations(pairs, so3.nearest(sign * v), so3.nearest(sign * u))


SHAH = HandEyeSolver("shah", "Shah 2013", shah)
