"""Dornaika and Horaud: both rotations of AX = ZB as unit quaternions, closed form.

F. Dornaika, R. Horaud, "Simultaneous robot-world and hand-eye calibration", IEEE Transactions on Robotics and
Automation 14(4), 1998.
"""

from __future__ import annotations

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.solvers.quaternions import left, right
from calibrant.calibrate.solvers.relative import PosePairs
from calibrant.calibrate.solvers.solver import HandEyeSolver
from calibrant.calibrate.solvers.translation import with_translations
from calibrant.geometry import so3


def dornaika(pairs: PosePairs) -> tuple[Array, Array]:
    """min sum |q_A q_X - q_Z q_D|^2, D = B^-1: q_Z, q_X are the first singular vectors of C = sum R(q_D)^T L(q_A).

    The minimum is 2 n - 2 max q_Z^T C q_X over unit quaternions. A quaternion and its negative are the same rotation,
    so each term needs its sign: the one with which q_Z = q_A q_X q_D* agrees over the views, for a rough R_X.
    """
    q_A = so3.quaternion_wxyz(pairs.A[:, :3, :3])
    q_D = so3.quaternion_wxyz(np.swapaxes(pairs.B[:, :3, :3], 1, 2))
    terms = np.einsum("nji,njk->nik", right(q_D), left(q_A))
    q_Z = terms @ so3.quaternion_wxyz(pairs.rough_rotation)
    _, vectors = np.linalg.eigh(q_Z.T @ q_Z)
    sign = np.where(q_Z @ vectors[:, -1] < 0, -1.0, 1.0)
    U, _, Vt = np.linalg.svd(np.einsum("n,nij->ij", sign, terms))
    return with_translations(pairs, so3.from_quaternion_wxyz(Vt[0]), so3.from_quaternion_wxyz(U[:, 0]))


DORNAIKA = HandEyeSolver("dornaika", "Dornaika and Horaud 1998", dornaika)
