"""AX = XB of all relative motions as one linear system in the nine numbers of R_X and in t_X."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calibrant.calibrate.hand_eye.relative import PosePairs

Array = NDArray[np.float64]


def linear_system(pairs: PosePairs) -> tuple[Array, Array]:
    """Rows (12 p, 12) and right-hand side (12 p,) of

        [ I_9 - R_A (x) R_B           0     ] [vec R_X]   [ 0 ]
        [ I_3 (x) t_B^T         I_3 - R_A   ] [  t_X  ] = [t_A]

    vec by rows. Lengths, and so t_X, are in units of the typical motion `pairs.length`: the weight between the rows
    then does not depend on the unit of length. Source: Andreff, Horaud, Espiau 1999.
    """
    m, p = pairs.motions, len(pairs.motions.i)
    R_A, R_B = m.A[:, :3, :3], m.B[:, :3, :3]
    t_A, t_B = m.A[:, :3, 3] / pairs.length, m.B[:, :3, 3] / pairs.length
    rows = np.zeros((p, 12, 12))
    rows[:, :9, :9] = np.eye(9) - np.einsum("pij,pkl->pikjl", R_A, R_B).reshape(p, 9, 9)
    rows[:, 9:, :9] = np.einsum("ij,pk->pijk", np.eye(3), t_B).reshape(p, 3, 9)
    rows[:, 9:, 9:] = np.eye(3) - R_A
    known = np.concatenate([np.zeros((p, 9)), t_A], axis=1)
    return rows.reshape(-1, 12), known.reshape(-1)
