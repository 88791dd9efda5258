"""The interface of every closed-form hand-eye solver: poses in, X and Z out, or a refusal by name.

A solver is a function from pose pairs to an estimate, wrapped with its name and paper. The wrapper asks first whether
the motions determine the answer, and afterwards whether the method gave a proper one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calibrant.calibrate.hand_eye.motion import MotionReport, report_of
from calibrant.calibrate.hand_eye.relative import PosePairs
from calibrant.calibrate.hand_eye.solvers.translation import separable
from calibrant.errors import RefusedError
from calibrant.geometry import se3, so3

Array = NDArray[np.float64]

MISLED_FACTOR = 10.0
"""A method whose loop is this many times worse than a plain least-squares rotation on the same data has broken down:
the methods differ by factors up to 3 on data with noise alone."""

MISLED_FLOOR = (1e-2, 1e-2)
"""Loops below 10 mrad, and below 1 % of the translations, are never called broken: noise of that size occurs, and
between small loops a factor means little."""


@dataclass(frozen=True, eq=False)
class HandEyeSolution:
    """X and Z (4, 4), metres, of A_i X B_i = Z.

    Eye-in-hand: X = T_gripper_camera, Z = T_base_target. Eye-to-hand: X = T_base_camera, Z = T_gripper_target.
    """

    X: Array
    Z: Array


@dataclass(frozen=True)
class HandEyeSolver:
    """One closed-form method. `estimate` maps pose pairs to (X, Z); Z is None where the method does not estimate it."""

    name: str
    paper: str
    estimate: Callable[[PosePairs], tuple[Array, Array | None]]

    def solve(self, A: ArrayLike, B: ArrayLike) -> HandEyeSolution:
        """X and Z with A_i X B_i = Z; Z is the mean of A_i X B_i where the method has none of its own.

        Args: A (n, 4, 4), metres: T_base_gripper (eye-in-hand) or its inverse (eye-to-hand); B (n, 4, 4) =
        T_camera_target. Raises: InputError for poses that are not rigid or do not match in number; RefusedError when
        the motions leave X undetermined, naming why and the cure, or when this method breaks down on the data.
        """
        return self.solve_pairs(PosePairs(np.asarray(A), np.asarray(B)))

    def solve_pairs(self, pairs: PosePairs) -> HandEyeSolution:
        """`solve` of pairs that are checked already; what all methods ask of the same pairs is computed once."""
        _motions(pairs).require_determined()
        try:
            X, Z = self.estimate(pairs)
        except np.linalg.LinAlgError as error:
            raise RefusedError(f"{self.name}: the linear algebra failed on these poses ({error})") from error
        if not (np.isfinite(X).all() and so3.is_rotation(X[:3, :3])):
            raise RefusedError(f"{self.name}: the method gave no valid transform on these poses; use another method")
        self._require_sound(pairs, X)
        return HandEyeSolution(X, se3.mean(pairs.A @ X @ pairs.B) if Z is None else Z)

    def _require_sound(self, pairs: PosePairs, X: Array) -> None:
        """Raises: RefusedError when X closes the loop far worse than a plain least-squares rotation does."""
        plain = _plain_loop_rms(pairs)
        found = _loop_rms(pairs, X)
        floor = np.array([MISLED_FLOOR[0], MISLED_FLOOR[1] * pairs.length])
        if np.any(found > MISLED_FACTOR * np.maximum(plain, floor)):
            raise RefusedError(
                f"{self.name}: the method broke down on these data: its loop spreads by {1e3 * found[1]:.3g} mm and "
                f"{np.rad2deg(found[0]):.3g} deg rms, a plain least-squares rotation by {1e3 * plain[1]:.3g} mm and "
                f"{np.rad2deg(plain[0]):.3g} deg; look for wrong views, or use another method"
            )


@lru_cache(maxsize=4)
def _motions(pairs: PosePairs) -> MotionReport:
    return report_of(pairs)


@lru_cache(maxsize=4)
def _plain_loop_rms(pairs: PosePairs) -> Array:
    """The loop of a plain least-squares rotation, which every method is compared with."""
    return _loop_rms(pairs, separable(pairs, pairs.rough_rotation)[0])


def _loop_rms(pairs: PosePairs, X: Array) -> Array:
    """(radians, metres) rms of A_i X B_i about its mean."""
    Z_i = pairs.A @ X @ pairs.B
    delta = se3.local(se3.mean(Z_i), Z_i)
    return np.sqrt([np.mean(np.sum(delta[:, :3] ** 2, axis=1)), np.mean(np.sum(delta[:, 3:] ** 2, axis=1))])
