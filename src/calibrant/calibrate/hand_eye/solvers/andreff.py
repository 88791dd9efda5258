"""Andreff, Horaud and Espiau: rotation and translation in one linear system of Kronecker products.

N. Andreff, R. Horaud, B. Espiau, "On-line hand-eye calibration", 3DIM 1999; "Robot hand-eye calibration using
structure-from-motion", International Journal of Robotics Research 20(3), 2001.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calibrant.calibrate.hand_eye.relative import PosePairs
from calibrant.calibrate.hand_eye.solvers.solver import HandEyeSolver
from calibrant.calibrate.hand_eye.solvers.translation import separable
from calibrant.geometry import so3

Array = NDArray[np.float64]


def andreff(pairs: PosePairs) -> tuple[Array, None]:
    """Least squares of

        [ I_9 - R_A (x) R_B           0     ] [vec R_X]   [ 0 ]
        [ I_3 (x) t_B^T         I_3 - R_A   ] [  t_X  ] = [t_A]

    vec by rows. Of the solution's nine numbers the nearest rotation is taken, and t_X is solved again for it. Lengths
    are divided by the typical motion, so that the weight between the rows does not depend on the unit.
    """
    m, p = pairs.motions, len(pairs.motions.i)
    R_A, R_B = m.A[:, :3, :3], m.B[:, :3, :3]
    t_A, t_B = m.A[:, :3, 3] / pairs.length, m.B[:, :3, 3] / pairs.length
    rows = np.zeros((p, 12, 12))
    rows[:, :9, :9] = np.eye(9) - np.einsum("pij,pkl->pikjl", R_A, R_B).reshape(p, 9, 9)
    rows[:, 9:, :9] = np.einsum("ij,pk->pijk", np.eye(3), t_B).reshape(p, 3, 9)
    rows[:, 9:, 9:] = np.eye(3) - R_A
    known = np.concatenate([np.zeros((p, 9)), t_A], axis=1)
    solution = np.linalg.lstsq(rows.reshape(-1, 12), known.reshape(-1), rcond=None)[0]
    return separable(pairs, so3.nearest(solution[:9].reshape(3, 3)))


ANDREFF = HandEyeSolver("andreff", "Andreff, Horaud and Espiau 1999", andreff)
