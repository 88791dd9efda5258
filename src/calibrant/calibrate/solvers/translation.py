"""Translations of X and Z by linear least squares once the rotations are known: the second step of most methods."""

from __future__ import annotations

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.centres import of_transforms as centres
from calibrant.calibrate.solvers.relative import PosePairs
from calibrant.geometry import se3


def with_translations(pairs: PosePairs, R_X: Array, R_Z: Array) -> tuple[Array, Array]:
    """X and Z (4, 4) given both rotations (3, 3): six unknowns, three equations a pose,

        R_Ai t_X - t_Z = -t_Ai - S_i t_Bi,    S_i = (R_Ai R_X + R_Z R_Bi^T) / 2.

    The papers of AX = XB have R_X R_B where this has S, those of AX = ZB have R_Z R_B^T: the rotation noise of the
    camera times the distance of the target. R_A R_X is the same rotation with the noise of the robot. Which is the
    better one is not known here; their mean has sqrt(s_A^2 + s_B^2) / 2, close to the better and never above the worse.
    Subtracting one pose's equation from another's gives (R_A - I) t_X = R_X t_B - t_A: all n (n - 1) / 2 motions at the
    cost of n."""
    R_A, t_A = pairs.A[:, :3, :3], pairs.A[:, :3, 3]
    R_B, t_B = pairs.B[:, :3, :3], pairs.B[:, :3, 3]
    S = (R_A @ R_X + R_Z @ np.swapaxes(R_B, 1, 2)) / 2
    rows = np.concatenate([R_A, np.broadcast_to(-np.eye(3), R_A.shape)], axis=2).reshape(-1, 6)
    known = -(t_A + np.einsum("nij,nj->ni", S, t_B)).reshape(-1)
    t = np.linalg.lstsq(rows, known, rcond=None)[0]
    return se3.make(R_X, t[:3]), se3.make(R_Z, t[3:])


def separable(pairs: PosePairs, R_X: Array) -> tuple[Array, None]:
    """X (4, 4) from its rotation, and no Z: what the AX = XB methods that solve the rotation first return."""
    R_Z = centres.mean(pairs.A @ se3.make(R_X, np.zeros(3)) @ pairs.B).T[:3, :3]
    return with_translations(pairs, R_X, R_Z)[0], None
