"""The loop of hand-eye calibration: A_i X B_i must be one and the same transform Z in every view.

Its spread is the error a person can check without knowing the truth: how far the views disagree on where the target
is, seen through the robot and the camera.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array
from calibrant.calibrate.centres import of_transforms as centres
from calibrant.calibrate.reprojection.outliers import median
from calibrant.calibrate.solvers.relative import PosePairs, pose_pairs, sample
from calibrant.errors import InputError
from calibrant.geometry import se3

MOST_FOR_SIZE = 200
"""Poses of a longer session whose motion stands for all: its size is known to five per cent, and compared with 25 %."""


@dataclass(frozen=True, eq=False)
class LoopErrors:
    """Spread of Z_i = A_i X B_i about their mean Z (4, 4).

    view_mm, view_deg (n,): distance and angle of every Z_i from Z; rms_mm, rms_deg: root mean square over the views.
    """

    rms_mm: float
    rms_deg: float
    view_mm: Array
    view_deg: Array
    Z: Array


@dataclass(frozen=True, eq=False)
class LoopConsistency:
    """How well A_i X B_i agree, by medians, so that a minority of wrong views does not hide a right hypothesis.

    median_mm, median_deg: median distance and angle of Z_i from their robust centre Z. `score` is free of units and
    compares hypotheses: the larger of the distance over the size of the robot's motion and the angle over the size of
    its rotations; 0 is perfect, 1 is no agreement at all. `score_rotation` is the latter alone.
    """

    median_mm: float
    median_deg: float
    view_mm: Array
    view_deg: Array
    Z: Array
    score: float
    score_rotation: float


def loop_errors(A: ArrayLike, B: ArrayLike, X: ArrayLike) -> LoopErrors:
    """Spread of A_i X B_i about its mean: |t_i - t_mean| and the angle of R_i R_mean^T.

    Args: A (n, 4, 4) and B (n, 4, 4) = T_camera_target in the normal form A_i X B_i = Z, metres; X (4, 4).
    Raises: InputError for shapes that do not match, matrices that are not rigid, or no views.
    """
    return errors_of(pose_pairs(A, B), X)


def errors_of(pairs: PosePairs, X: ArrayLike) -> LoopErrors:
    """`loop_errors` of pairs that are checked already."""
    mean = centres.mean(_loops(pairs, X))
    return LoopErrors(_rms(mean.mm), _rms(mean.deg), mean.mm, mean.deg, mean.T)


def loop_consistency(A: ArrayLike, B: ArrayLike, X: ArrayLike) -> LoopConsistency:
    """Agreement of A_i X B_i by medians about a robust centre; see LoopConsistency. Args as for `loop_errors`.

    The centre minimises the sum of distances, not of their squares (geometric median, L1 mean of rotations).
    """
    return consistency_of(pose_pairs(A, B), X)


def consistency_of(pairs: PosePairs, X: ArrayLike) -> LoopConsistency:
    """`loop_consistency` of pairs that are checked already."""
    centre = centres.median(_loops(pairs, X))
    median_mm, median_deg = median(centre.mm), median(centre.deg)
    size_mm, size_deg = _motion_size(pairs)
    turned = _ratio(median_deg, size_deg)
    score = max(_ratio(median_mm, size_mm), turned)
    return LoopConsistency(median_mm, median_deg, centre.mm, centre.deg, centre.T, score, turned)


@lru_cache(maxsize=4)
def _motion_size(pairs: PosePairs) -> tuple[float, float]:
    """Millimetres and degrees: how far the poses lie from their centre, by the same measure as the loop.

    Where the robot turns on the spot the target still sweeps past the camera, so the larger of both motions counts.
    Asked for every method on the same pairs.
    """
    rows = sample(len(pairs), MOST_FOR_SIZE)
    of_A, of_B = centres.median(pairs.A[rows]), centres.median(pairs.B[rows])
    return max(median(of_A.mm), median(of_B.mm)), max(median(of_A.deg), median(of_B.deg))


def _loops(pairs: PosePairs, X: ArrayLike) -> Array:
    """A_i X B_i (n, 4, 4)."""
    if len(pairs) == 0:
        raise InputError("the loop A_i X B_i needs at least one view, got none")
    return pairs.A @ se3.check(X, name="X") @ pairs.B


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _ratio(spread: float, size: float) -> float:
    """spread / size; 0 / 0 (nothing moves, nothing disagrees) is 0."""
    return spread / size if size > 0 else (0.0 if spread == 0 else float("inf"))
