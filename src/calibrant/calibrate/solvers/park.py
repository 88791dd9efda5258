"""Park and Martin: the rotation as a least-squares fit of rotation vectors.

F. C. Park, B. J. Martin, "Robot sensor calibration: solving AX = XB on the Euclidean group", IEEE Transactions on
Robotics and Automation 10(5), 1994.
"""

from __future__ import annotations

from calibrant.arrays import Array
from calibrant.calibrate.solvers.relative import PosePairs
from calibrant.calibrate.solvers.solver import HandEyeSolver
from calibrant.calibrate.solvers.translation import separable
from calibrant.geometry import so3


def park(pairs: PosePairs) -> tuple[Array, None]:
    """R_X = argmin sum |alpha - R beta|^2 = (M^T M)^(-1/2) M^T with M = sum beta alpha^T; then t_X.

    The inverse square root is taken as the polar factor from an SVD with det = +1: it also exists for two motions,
    where M has rank two.
    """
    m = pairs.motions
    return separable(pairs, so3.nearest(m.alpha.T @ m.beta))


PARK = HandEyeSolver("park", "Park and Martin 1994", park)
