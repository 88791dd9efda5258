"""Errors at touched points beside what was predicted, and the correction of the camera's pose that they propose.

An error is where the camera said a point is, less where it is: e (3,) in the base, predicted as N(0, C). It is inside
the predicted 95 % region where e^T C^-1 e is below chi-square's 95 % of 3. predicted_95 is the radius that |e| stays
below with 95 %, by the chi-square of the same mean and variance (Satterthwaite 1946):

    |e|^2 ~ g chi2_h,    g = tr C^2 / tr C,    h = (tr C)^2 / tr C^2

The correction u of the camera's pose is the weighted least squares of all touches,

    min_u  sum_i (e_i - H_i u)^T N_i^-1 (e_i - H_i u) + u^T P^-1 u,    X <- retract(X, -u)

N_i what is drawn anew at each touch, and P what the calibration says of X, with what its lens does to it there; so that
a single touch corrects the direction it measured and no other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.optimize.chances import chi2_tail

CHI2_3_95 = 7.8147
"""Chi-square's 95 % of three degrees of freedom."""


@dataclass(frozen=True, eq=False)
class Touch:
    """A touched point: error (3,) metres; turn (3,) radians, base axes, None where the rotation was not measured.

    calibration, drawn (6, 6): covariances, rotation then position, of what the calibration makes of both and of what is
    drawn anew at each touch; of_move (6, 6): what an error of the camera's pose does there.
    """

    name: str
    error: Array
    turn: Array | None
    calibration: Array
    drawn: Array
    of_move: Array

    @property
    def covariance(self) -> Array:
        """Of turn and error, (6, 6)."""
        return np.asarray(self.calibration + self.drawn)

    @property
    def inside(self) -> bool:
        """Whether the error is in the predicted 95 % region."""
        return float(self.error @ np.linalg.solve(self.covariance[3:, 3:], self.error)) <= CHI2_3_95

    @property
    def predicted_95(self) -> float:
        """What the length of the error stays below with 95 %, metres."""
        return radius_95(self.covariance[3:, 3:])

    @property
    def turn_95(self) -> float:
        """What the angle of the turn stays below with 95 %, radians."""
        return radius_95(self.covariance[:3, :3])


@dataclass(frozen=True, eq=False)
class Correction:
    """u (6,), what the camera's pose errs by (rotation, translation along its parent's axes), and covariance (6, 6)."""

    error: Array
    covariance: Array
    touches: int


def radius_95(C: Array) -> float:
    """What the length of a Gaussian vector of this covariance stays below with 95 %."""
    first, second = float(np.trace(C)), float(np.sum(C * C.T))
    if first <= 0:
        return 0.0
    return float(np.sqrt(second / first * chi2_at(0.95, first**2 / second)))


def chi2_at(share: float, freedom: float) -> float:
    """What chi-square stays below with this chance, by halving.

    >>> round(chi2_at(0.95, 3.0), 4)
    7.8147
    """
    low, high = 0.0, freedom + 20 * np.sqrt(2 * freedom) + 20
    for _ in range(80):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if chi2_tail(freedom, middle) > 1 - share else (low, middle)
    return float(high)


def correction_of(touches: Sequence[Touch]) -> Correction:
    """The camera's error by all touches. Raises: InputError for none."""
    if not touches:
        raise InputError("a correction needs a touch at the least; three apart from each other tell rotations too")
    P = np.mean([_prior(t) for t in touches], axis=0)
    scale = np.sqrt(np.diag(P))
    H = np.linalg.inv(P / scale[:, None] / scale)
    g = np.zeros(6)
    for t in touches:
        rows = slice(3, 6) if t.turn is None else slice(0, 6)
        error = t.error if t.turn is None else np.concatenate([t.turn, t.error])
        A = t.of_move[rows] * scale
        weighed = np.linalg.solve(t.drawn[rows, rows], np.column_stack([A, error]))
        H = H + A.T @ weighed[:, :6]
        g = g + A.T @ weighed[:, 6]
    C = np.linalg.inv(H)
    return Correction(scale * (C @ g), scale[:, None] * C * scale, len(touches))


def corrected(touch: Touch, found: Correction) -> Touch:
    """The touch as it would have been with the corrected camera, with what is then predicted."""
    step = touch.of_move @ found.error
    turn = None if touch.turn is None else touch.turn - step[:3]
    C = touch.of_move @ found.covariance @ touch.of_move.T
    return replace(touch, error=touch.error - step[3:], turn=turn, calibration=C)


def left_out(touches: Sequence[Touch]) -> list[Touch]:
    """Every touch corrected by the others: what the correction is worth where it was not made."""
    return [corrected(t, correction_of([o for o in touches if o is not t])) for t in touches]


def _prior(t: Touch) -> Array:
    """P (6, 6): the pose error of X that does what the calibration's errors, those of the lens too, do there."""
    back = np.linalg.inv(t.of_move)
    return np.asarray(back @ t.calibration @ back.T)
