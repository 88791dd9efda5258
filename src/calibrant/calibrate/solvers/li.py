"""Li, Wang and Wu: AX = ZB as one linear system in both rotations and both translations.

A. Li, L. Wang, D. Wu, "Simultaneous robot-world and hand-eye calibration using dual-quaternions and Kronecker product",
International Journal of the Physical Sciences 5(10), 2010.
"""

from __future__ import annotations

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.solvers.relative import PosePairs
from calibrant.calibrate.solvers.solver import HandEyeSolver
from calibrant.calibrate.solvers.translation import with_translations
from calibrant.geometry import se3, so3


def li(pairs: PosePairs) -> tuple[Array, Array]:
    """Least squares of, with D_i = B_i^-1 and vec by rows,

        [ R_A (x) I_3   -I_3 (x) R_D^T       0     0   ] [vec R_X]   [ 0 ]
        [     0         I_3 (x) t_D^T     -R_A    I_3  ] [vec R_Z] = [t_A]
                                                         [  t_X  ]
                                                         [  t_Z  ]

    The nearest rotations are taken, and the translations are solved again for them. Lengths are divided by the typical
    motion, so that the weight between the rows does not depend on the unit. One row more than in the paper,
    trace(R_0^T R_X) = 3 with a rough R_0 (true to second order), holds the scale of the rotations where t_A cannot:
    when the robot turns on the spot.
    """
    n, D = len(pairs), se3.inverse(pairs.B)
    R_A, R_D = pairs.A[:, :3, :3], D[:, :3, :3]
    t_A, t_D = pairs.A[:, :3, 3] / pairs.length, D[:, :3, 3] / pairs.length
    eye = np.eye(3)
    rows = np.zeros((n, 12, 24))
    rows[:, :9, :9] = np.einsum("nij,kl->nikjl", R_A, eye).reshape(n, 9, 9)
    rows[:, :9, 9:18] = -np.einsum("ij,nlk->nikjl", eye, R_D).reshape(n, 9, 9)
    rows[:, 9:, 9:18] = np.einsum("ij,nk->nijk", eye, t_D).reshape(n, 3, 9)
    rows[:, 9:, 18:21] = -R_A
    rows[:, 9:, 21:] = eye
    known = np.concatenate([np.zeros((n, 9)), t_A], axis=1)
    scale = np.sqrt(n) * np.concatenate([pairs.rough_rotation.reshape(-1), np.zeros(15)])  # as heavy as one row a pose
    stacked = np.concatenate([rows.reshape(-1, 24), scale[None]])
    solution = np.linalg.lstsq(stacked, np.append(known, 3 * np.sqrt(n)), rcond=None)[0]
    R_X, R_Z = so3.nearest(solution[:18].reshape(2, 3, 3))
    return with_translations(pairs, R_X, R_Z)


LI = HandEyeSolver("li", "Li, Wang and Wu 2010", li)
