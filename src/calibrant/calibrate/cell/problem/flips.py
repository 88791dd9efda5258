"""Which of the two poses that a small flat target has in a picture is the right one, told by the motion of the robot.

A tag seen with weak perspective has two poses that fit nearly alike (`pose.target_poses`), and pixels hardly choose.
Rotations do: with the candidates B_i and D_i of view i,

    R_A_i R_X R_i R_Z^-1 = 1   for all i,    R_i one of R_B_i, R_D_i.

Triples of views, each with every choice for its three, give R_X and R_Z; every view then takes the nearer candidate,
and the hypothesis is kept by which the half of the views agrees best.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.calibrate.solvers.relative import odd_part, pair_indices
from calibrant.geometry import so3

Choice = NDArray[np.bool_]

TRIPLES = 150
"""Triples of views tried, each with eight choices; where all views are right but for their flips, every one will do,
and with a third of them wrong every fourth."""
STEPS = 5
"""Rounds of choosing and fitting; they settle in two or three."""
FLOOR = 1e-5
"""Radians below which a deviation is rounding."""


def right_branches(sides: Sequence[Array], R_B: Array, R_D: Array) -> Choice:
    """True for each view (n,) whose second pose D agrees better with the robot.

    Args: sides, the ways to read the robot's rotations, each R_A (n, 3, 3) of the normal form; R_B, R_D (n, 3, 3) of
    the two poses, alike where a view has but one.
    """
    n = len(R_B)
    R = np.stack([R_B, R_D], axis=1)
    if n < 3:
        return np.zeros(n, dtype=bool)
    triples = np.random.default_rng(0).random((TRIPLES, n)).argpartition(2, axis=1)[:, :3]
    found = [_of_side(R_A, R, triples) for R_A in sides]
    score, choice = min(found, key=lambda item: item[0])
    return choice if np.isfinite(score) else np.zeros(n, dtype=bool)


def _of_side(R_A: Array, R: Array, triples: NDArray[np.intp]) -> tuple[float, Choice]:
    """The best hypothesis of one way to read the robot: its score and choice."""
    choices = np.array(np.meshgrid([0, 1], [0, 1], [0, 1], indexing="ij")).reshape(3, 8).T
    rows, picks = np.repeat(triples, 8, axis=0), np.tile(choices, (len(triples), 1))
    # A view with one pose has nothing to choose.
    open_ = (R[:, 0] != R[:, 1]).any(axis=(1, 2))
    distinct = ~((picks == 1) & ~open_[rows]).any(axis=1)
    rows, picks = rows[distinct], picks[distinct]
    A, B = R_A[rows], R[rows, picks]
    one, other = [0, 1, 0], [1, 2, 2]
    a = odd_part(np.swapaxes(A[:, other], -1, -2) @ A[:, one])
    b = odd_part(B[:, other] @ np.swapaxes(B[:, one], -1, -2))
    R_X = so3.nearest(np.swapaxes(a, 1, 2) @ b)
    R_Z = so3.nearest((A @ R_X[:, None] @ B).sum(axis=1))
    score, choice = _nearest(R_A, R, R_X, R_Z)
    best = int(np.argmin(score))
    value, chosen = float(score[best]), choice[best]
    i, j = pair_indices(len(R_A))
    for _ in range(STEPS):
        picked = np.where(chosen[:, None, None], R[:, 1], R[:, 0])
        a, b = odd_part(np.swapaxes(R_A[j], 1, 2) @ R_A[i]), odd_part(picked[j] @ np.swapaxes(picked[i], 1, 2))
        X = so3.nearest(a.T @ b)
        Z = so3.nearest((R_A @ X @ picked).sum(axis=0))
        again, choice = _nearest(R_A, R, X[None], Z[None])
        if again[0] >= value or np.array_equal(choice[0], chosen):
            break
        value, chosen = float(again[0]), choice[0]
    return value, chosen


def _nearest(R_A: Array, R: Array, R_X: Array, R_Z: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Scores (h,) of hypotheses R_X, R_Z (h, 3, 3), and the choice (h, n) that is nearest by each."""
    n = len(R_A)
    wanted = np.swapaxes(R_A @ R_X[:, None], -1, -2) @ R_Z[:, None]  # (h, n, 3, 3): what R should be
    trace = np.einsum("hnij,ncij->hnc", wanted, R)
    angle = np.arccos(np.clip((trace.max(axis=2) - 1) / 2, -1, 1))
    half = n // 2 + 1
    score = np.log(np.partition(angle, half - 1, axis=1)[:, :half] + FLOOR).sum(axis=1)
    return score, trace[..., 1] > trace[..., 0]
