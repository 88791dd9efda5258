"""Daniilidis: rotation and translation together, as a unit dual quaternion.

K. Daniilidis, "Hand-eye calibration using dual quaternions", International Journal of Robotics Research 18(3), 1999.
"""

from __future__ import annotations

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.solvers.quaternions import conjugate, product, pure
from calibrant.calibrate.solvers.relative import PosePairs, RelativeMotions
from calibrant.calibrate.solvers.solver import HandEyeSolver
from calibrant.errors import RefusedError
from calibrant.geometry import se3, so3

OUTLIER_SIGMAS = 3.0
"""Screws that disagree by more than 3 robust sigma are left out: of clean motions, 1 in 370."""


def daniilidis(pairs: PosePairs) -> tuple[Array, None]:
    """X from all motions; see `_null_vectors` and `_unit_dual_quaternion`."""
    return _dual_quaternion(pairs.motions, pairs.length), None


def daniilidis_screw(pairs: PosePairs) -> tuple[Array, None]:
    """X from the motions whose screws are congruent: equal angle and equal advance along the axis in A and B.

    Chen's screw congruence theorem says the scalar parts of both dual quaternions are equal whatever X is. Motions off
    by more than OUTLIER_SIGMAS times the robust spread (1.4826 median |difference|) of all are left out.
    """
    m = pairs.motions
    dual_a, dual_b = _dual_parts(m, pairs.length)
    differences = np.stack([m.quaternion_a[:, 0] - m.quaternion_b[:, 0], dual_a[:, 0] - dual_b[:, 0]])
    spread = 1.4826 * np.median(np.abs(differences), axis=1, keepdims=True)
    # Rounding alone spreads exact data by 1e-16; below 1e-9 of a turn or of the typical length nothing is an outlier.
    congruent = np.all(np.abs(differences) <= np.maximum(OUTLIER_SIGMAS * spread, 1e-9), axis=0)
    return _dual_quaternion(m.only(congruent), pairs.length), None


def _dual_quaternion(m: RelativeMotions, length: float) -> Array:
    """X (4, 4), metres, from motions whose lengths are divided by `length` for the solution."""
    q, dual = _unit_dual_quaternion(*_null_vectors(m, length))
    t = 2 * product(dual, conjugate(q))[1:]
    return se3.make(so3.from_quaternion_wxyz(q), length * t)


def _dual_parts(m: RelativeMotions, length: float) -> tuple[Array, Array]:
    """Dual parts q' = (0, t) q / 2 (p, 4) of A and B."""
    return (
        product(pure(m.A[:, :3, 3] / length), m.quaternion_a) / 2,
        product(pure(m.B[:, :3, 3] / length), m.quaternion_b) / 2,
    )


def _null_vectors(m: RelativeMotions, length: float) -> tuple[Array, Array]:
    """The two right singular vectors (8,) of the smallest singular values of the stacked rows, vector parts a, b only:

    [ a - b     [a + b]_x       0         0     ] [q ]
    [ a' - b'   [a' + b']_x   a - b   [a + b]_x ] [q'] = 0
    """
    dual_a, dual_b = _dual_parts(m, length)

    def block(a: Array, b: Array) -> Array:
        return np.concatenate([(a - b)[:, 1:, None], so3.hat((a + b)[:, 1:])], axis=2)

    real, dual = block(m.quaternion_a, m.quaternion_b), block(dual_a, dual_b)
    rows = np.concatenate([np.concatenate([real, np.zeros_like(real)], 2), np.concatenate([dual, real], 2)], axis=1)
    if len(rows) < 2:
        raise RefusedError("daniilidis: fewer than two relative motions are congruent screws; look for wrong poses")
    # The triangle of their QR has the rows' right singular vectors, and no left ones to be found for every motion.
    vectors = np.linalg.svd(np.linalg.qr(rows.reshape(-1, 8), mode="r"))[2]
    return vectors[-2], vectors[-1]


def _unit_dual_quaternion(v7: Array, v8: Array) -> tuple[Array, Array]:
    """(q, q') = c7 v7 + c8 v8 with q.q = 1 and q.q' = 0.

    q.q' = c^T S c vanishes along two directions c; the one with the larger q.q is the solution, as the other is near
    the trivial (0, q). Raises: RefusedError when no combination has q.q' = 0.
    """
    V = np.stack([v7, v8], axis=1)
    real, dual = V[:4], V[4:]
    values, axes = np.linalg.eigh((real.T @ dual + dual.T @ real) / 2)
    if values[0] > 0 or values[1] < 0:
        raise RefusedError(
            "daniilidis: the motions admit no unit dual quaternion; look for wrong poses or use another method"
        )
    parts = np.sqrt(values[1]) * axes[:, 0], np.sqrt(-values[0]) * axes[:, 1]
    c = max(
        (parts[0] + parts[1], parts[0] - parts[1]), key=lambda d: float(np.linalg.norm(real @ d) / np.linalg.norm(d))
    )
    norm = np.linalg.norm(real @ c)
    return real @ c / norm, dual @ c / norm


DANIILIDIS = HandEyeSolver("daniilidis", "Daniilidis 1999", daniilidis)
DANIILIDIS_SCREW = HandEyeSolver(
    "daniilidis-screw", "Daniilidis 1999 with the screw congruence of Chen 1991", daniilidis_screw
)
