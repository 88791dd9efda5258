"""Andreff, Horaud and Espiau: rotation and translation in one linear system of Kronecker products.

N. Andreff, R. Horaud, B. Espiau, "On-line hand-eye calibration", 3DIM 1999; "Robot hand-eye calibration using
structure-from-motion", International Journal of Robotics Research 20(3), 2001.
"""

from __future__ import annotations

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.solvers.kronecker import linear_system
from calibrant.calibrate.solvers.relative import PosePairs
from calibrant.calibrate.solvers.solver import HandEyeSolver
from calibrant.calibrate.solvers.translation import separable
from calibrant.geometry import so3


def andreff(pairs: PosePairs) -> tuple[Array, None]:
    """Least squares of `linear_system`; of its solution's nine numbers the nearest rotation; t_X again for it.

    One row more than in the paper, trace(R_0^T R_X) = 3 with a rough R_0 (true to second order), holds the scale of
    R_X, which the other rows leave to t_A: it vanishes when the robot turns on the spot.
    """
    rows, known = linear_system(pairs)
    weight = np.sqrt(len(pairs.motions.i))  # as heavy as one row a motion
    scale = weight * np.concatenate([pairs.rough_rotation.reshape(-1), np.zeros(3)])
    solution = np.linalg.lstsq(np.concatenate([rows, scale[None]]), np.append(known, 3 * weight), rcond=None)[0]
    return separable(pairs, so3.nearest(solution[:9].reshape(3, 3)))


ANDREFF = HandEyeSolver("andreff", "Andreff, Horaud and Espiau 1999", andreff)
