"""The scale of target poses whose lengths are in an unknown unit: the robot's motion is a ruler.

With s beside X, A_ij X = X B_ij(s) is linear once the rotation is known,

    (R_A - I) t_X - s R_X t_B = -t_A,

four unknowns, three equations a motion (Andreff, Horaud, Espiau, "Robot hand-eye calibration using
structure-from-motion", IJRR 20, 2001). Rotation and translation are each fitted by least distances, so that a minority
of wrong poses hardly moves them.
"""

from __future__ import annotations

import numpy as np

from calibrant.calibrate.solvers.relative import PosePairs
from calibrant.geometry import so3

STEPS = 12
"""Weighted steps towards the least sum of distances."""
LEAST_METRES, LEAST_RADIANS = 1e-9, 1e-9


def scale_of_target(pairs: PosePairs) -> float:
    """What the lengths of B must be multiplied by; NaN where the motions do not tell, or tell no positive number."""
    m = pairs.motions
    weight = np.ones(len(m.alpha))
    for _ in range(STEPS):
        R_x = so3.nearest((weight[:, None] * m.alpha).T @ m.beta)
        weight = 1 / np.maximum(np.linalg.norm(m.alpha - m.beta @ R_x.T, axis=1), LEAST_RADIANS)
    M = np.concatenate([m.A[:, :3, :3] - np.eye(3), -(m.B[:, :3, 3] @ R_x.T)[:, :, None]], axis=2)
    y = -m.A[:, :3, 3]
    # Lengths of the target in an unknown unit: the columns are brought to one size before the rank is judged.
    size = np.sqrt(np.mean(np.sum(M * M, axis=1), axis=0))
    if not np.all(size > 0):
        return float("nan")
    M = M / size
    weight = np.ones(len(M))
    for _ in range(STEPS):
        normal, right = np.einsum("p,pij,pik->jk", weight, M, M), np.einsum("p,pij,pi->j", weight, M, y)
        if np.linalg.cond(normal) > 1 / np.finfo(float).eps:
            return float("nan")
        x = np.linalg.solve(normal, right)
        weight = 1 / np.maximum(np.linalg.norm(M @ x - y, axis=1), LEAST_METRES)
    scale = float(x[3] / size[3])
    return scale if scale > 0 else float("nan")
