"""AX = XB of all relative motions as one linear system in the nine numbers of R_X and in t_X."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.solvers.relative import PosePairs


@lru_cache(maxsize=4)
def linear_system(pairs: PosePairs) -> tuple[Array, Array]:
    """Rows (13, 12) and right-hand side (13,) with the same least squares, for any rows beside them, as the 12 p of

        [ I_9 - R_A (x) R_B           0     ] [vec R_X]   [ 0 ]
        [ I_3 (x) t_B^T         I_3 - R_A   ] [  t_X  ] = [t_A]

    vec by rows: the triangle of their QR, of the turns first, whose other columns are empty. Lengths, and so t_X, are
    in units of the typical motion `pairs.length`: the weight between the rows then does not depend on the unit of
    length. Source: Andreff, Horaud, Espiau 1999.
    """
    m, p = pairs.motions, len(pairs.motions.i)
    R_A, R_B = m.A[:, :3, :3], m.B[:, :3, :3]
    t_A, t_B = m.A[:, :3, 3] / pairs.length, m.B[:, :3, 3] / pairs.length
    turns = R_A[:, :, None, :, None] * -R_B[:, None, :, None, :]
    diagonal = np.arange(3)
    turns[:, diagonal[:, None], diagonal, diagonal[:, None], diagonal] += 1.0
    of_turns = np.linalg.qr(turns.reshape(-1, 9), mode="r")
    rows = np.zeros((3 * p + len(of_turns), 13))
    moves = rows[: 3 * p].reshape(p, 3, 13)
    for k in range(3):
        moves[:, k, 3 * k : 3 * k + 3] = t_B
    moves[:, :, 9:12] = np.eye(3) - R_A
    moves[:, :, 12] = t_A
    rows[3 * p :, :9] = of_turns
    triangle = np.asarray(np.linalg.qr(rows, mode="r"), dtype=np.float64)
    return triangle[:, :12], triangle[:, 12]
