"""Chou and Kamel: the rotation as the null vector of a linear system in its quaternion.

J. C. K. Chou, M. Kamel, "Finding the position and orientation of a sensor on a robot manipulator using quaternions",
International Journal of Robotics Research 10(3), 1991.
"""

from __future__ import annotations

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.solvers.quaternions import left, right
from calibrant.calibrate.solvers.relative import PosePairs
from calibrant.calibrate.solvers.solver import HandEyeSolver
from calibrant.calibrate.solvers.translation import separable
from calibrant.geometry import so3


def chou(pairs: PosePairs) -> tuple[Array, None]:
    """q_A q = q q_B for every motion: (L(q_A) - R(q_B)) q = 0, stacked; q is the last right singular vector; then
    t_X."""
    m = pairs.motions
    rows = (left(m.quaternion_a) - right(m.quaternion_b)).reshape(-1, 4)
    q = np.linalg.svd(np.linalg.qr(rows, mode="r"))[2][-1]
    return separable(pairs, so3.from_quaternion_wxyz(q))


CHOU = HandEyeSolver("chou", "Chou and Kamel 1991", chou)
