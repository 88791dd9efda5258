"""The interface of every closed-form hand-eye solver: poses in, X and Z out, or a refusal by name.

A solver is a function from pose pairs to an estimate, wrapped with its name and paper. The wrapper asks first whether
the motions determine the answer, and afterwards whether the method gave a proper one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array
from calibrant.calibrate.solvers.loop_errors import LoopErrors, errors_of
from calibrant.calibrate.solvers.motion import report_of
from calibrant.calibrate.solvers.relative import PosePairs, pose_pairs
from calibrant.calibrate.solvers.translation import separable
from calibrant.errors import RefusedError
from calibrant.geometry import so3

MISLED_FACTOR = 10.0
"""A method whose loop is this many times worse than a plain least-squares rotation on the same data has broken down:
the methods differ by factors up to 3 on data with noise alone."""

MISLED_FLOOR = (1e-2, 1e-2)
"""Loops below 10 mrad, and below 1 % of the translations, are never called broken: noise of that size occurs, and
between small loops a factor means little."""


@dataclass(frozen=True, eq=False)
class HandEyeSolution:
    """X and Z (4, 4), metres, of A_i X B_i = Z, and the loop A_i X B_i.

    Eye-in-hand: X = T_gripper_camera, Z = T_base_target. Eye-to-hand: X = T_base_camera, Z = T_gripper_target.
    """

    X: Array
    Z: Array
    loop: LoopErrors


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
        return self.solve_pairs(pose_pairs(A, B))

    def solve_pairs(self, pairs: PosePairs) -> HandEyeSolution:
        """`solve` of pairs that are checked already; what all methods ask of the same pairs is computed once."""
        report_of(pairs).require_determined()
        try:
            X, Z = self.estimate(pairs)
        except np.linalg.LinAlgError as error:
            raise RefusedError(f"{self.name}: the linear algebra failed on these poses ({error})") from error
        if not (np.isfinite(X).all() and so3.is_rotation(X[:3, :3])):
            raise RefusedError(f"{self.name}: the method gave no valid transform on these poses; use another method")
        loop = errors_of(pairs, X)
        self._require_sound(pairs, loop)
        return HandEyeSolution(X, loop.Z if Z is None else Z, loop)

    def _require_sound(self, pairs: PosePairs, found: LoopErrors) -> None:
        """Raises: RefusedError when the loop is far worse than that of a plain least-squares rotation."""
        plain = _plain_loop(pairs)
        least_deg, least_mm = np.rad2deg(MISLED_FLOOR[0]), 1e3 * MISLED_FLOOR[1] * pairs.length
        if found.rms_mm > MISLED_FACTOR * max(plain.rms_mm, least_mm) or found.rms_deg > MISLED_FACTOR * max(
            plain.rms_deg, least_deg
        ):
            raise RefusedError(
                f"{self.name}: the method broke down on these data: its loop spreads by {found.rms_mm:.3g} mm and "
                f"{found.rms_deg:.3g} deg rms, a plain least-squares rotation by {plain.rms_mm:.3g} mm and "
                f"{plain.rms_deg:.3g} deg; look for wrong views, or use another method"
            )


@lru_cache(maxsize=4)
def _plain_loop(pairs: PosePairs) -> LoopErrors:
    """The loop of a plain least-squares rotation, which every method is compared with."""
    return errors_of(pairs, separable(pairs, pairs.rough_rotation)[0])
