"""Horaud and Dornaika: the rotation from axis directions, as the eigenvector of a quadratic form in its quaternion.

R. Horaud, F. Dornaika, "Hand-eye calibration", International Journal of Robotics Research 14(3), 1995 (closed form).
"""

from __future__ import annotations

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.solvers.quaternions import left, pure, right
from calibrant.calibrate.solvers.relative import PosePairs
from calibrant.calibrate.solvers.solver import HandEyeSolver
from calibrant.calibrate.solvers.translation import separable
from calibrant.geometry import so3


def horaud(pairs: PosePairs) -> tuple[Array, None]:
    """q = argmin sum w |n_A - q n_B q*|^2 = smallest eigenvector of sum w (L(n_A) - R(n_B))^T (L(n_A) - R(n_B)); then
    t_X.

    n are unit axes, as in the paper. The axis of a rotation by theta is known to sigma / theta only, so motions that
    rotate less than the median one weigh less, w = (theta / theta_median)^2: the paper assumes motions chosen to be
    large."""
    m = pairs.motions
    n_A, theta_A = _unit(m.alpha)
    n_B, theta_B = _unit(m.beta)
    theta = np.minimum(theta_A, theta_B)
    weight = np.minimum(1.0, theta / np.median(theta[theta > 0]))
    rows = weight[:, None, None] * (left(pure(n_A)) - right(pure(n_B)))
    _, vectors = np.linalg.eigh(np.einsum("pij,pik->jk", rows, rows))
    return separable(pairs, so3.from_quaternion_wxyz(vectors[:, 0]))


def _unit(omega: Array) -> tuple[Array, Array]:
    """Axes (p, 3), zero where nothing rotates, and angles (p,) of rotation vectors."""
    angle = np.linalg.norm(omega, axis=1)
    return omega / np.where(angle > 0, angle, 1.0)[:, None], angle


HORAUD = HandEyeSolver("horaud", "Horaud and Dornaika 1995", horaud)
