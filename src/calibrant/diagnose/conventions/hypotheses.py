"""Notations of robot poses and setups, ranked by how the loop A_i X B_i = Z closes.

1. Notations are sieved by what no X can change: robot and camera must see the same angle between any two poses
   (screw congruence; Chen, "A screw motion approach to uniqueness analysis of head-eye geometry", CVPR 1991).
2. What is left is solved in closed form on the three quarters of the views that agree best, so that some wrong views do
   not hide the right notation, and ranked by the rms of the loop over these views.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calibrant.arrays import Array
from calibrant.calibrate.cell.starts.scale import scale_of_target
from calibrant.calibrate.solvers.loop_errors import LoopErrors, errors_of, loop_consistency, loop_errors
from calibrant.calibrate.solvers.motion import motion_report
from calibrant.calibrate.solvers.park import park
from calibrant.calibrate.solvers.relative import PosePairs, pair_indices, sample
from calibrant.cancel import checkpoint
from calibrant.errors import InputError
from calibrant.formats.poses.notations import PoseNotation
from calibrant.geometry import se3, so3

Setup = Literal["eye-in-hand", "eye-to-hand"]
SETUPS: tuple[Setup, Setup] = ("eye-in-hand", "eye-to-hand")

KEPT = 0.75
"""Share of the views that judges a notation; the worst quarter may be flipped, mispaired or badly seen."""
LONG, MOST_TO_CHOOSE = 200, 60
"""Poses of a longer session that the views which agree are chosen by; the loop is then solved and judged with all."""
FLOOR_MM, FLOOR_DEG = 1e-3, 1e-3
"""Loops below a micrometre and a thousandth of a degree are closed: no robot repeats better, so less is rounding."""
CONSISTENT = 0.25
"""Largest median loop over the size of the motion that counts as consistent: noise gives some per cent, chance 1."""
SIEVE_RATIO, SIEVE_DEG = 4.0, 0.5
"""Notations pass the sieve when their angle mismatch is within 4 times the best one's, or within half a degree of it:
the median of pairs varies by less than a factor of two between halves of one data set."""
CARRIED_M, CARRIED_RATIO = 0.5, 2.0
"""Nobody carries a camera or a target more than half a metre from the gripper and twice as far as the other one stands
from the base: where a notation says so, the poses are the other way round."""


@dataclass(frozen=True, eq=False)
class Alternative:
    """One hypothesis and how its loop closes.

    loop_rms_mm, loop_rms_deg: spread of A_i X B_i over the views kept (indices); X: the camera's transform of the
    normal form; T_camera_target (n, 4, 4), metres; scale: what its lengths were multiplied by, where that was free.
    """

    notation: PoseNotation
    setup: Setup
    loop_rms_mm: float
    loop_rms_deg: float
    X: Array
    kept: NDArray[np.intp]
    T_camera_target: Array
    scale: float = 1.0

    @cached_property
    def score(self) -> float:
        """Median loop over the size of the motion: 0 perfect, 1 no agreement at all."""
        return loop_consistency(self.A, self.T_camera_target, self.X).score

    @property
    def A(self) -> Array:
        """(n, 4, 4) of the normal form A_i X B_i = Z."""
        return robot_side(self.notation.T_base_gripper, self.setup)

    @cached_property
    def mounting(self) -> tuple[float, float]:
        """Metres from the gripper to what it carries, and from the base to what stands still."""
        Z = loop_errors(self.A[self.kept], self.T_camera_target[self.kept], self.X).Z
        camera, target = float(np.linalg.norm(self.X[:3, 3])), float(np.linalg.norm(Z[:3, 3]))
        return (camera, target) if self.setup == "eye-in-hand" else (target, camera)

    @property
    def plausible(self) -> bool:
        """False when the gripper would carry something as nobody mounts it."""
        carried, fixed = self.mounting
        return carried <= CARRIED_M or carried <= CARRIED_RATIO * fixed

    @property
    def description(self) -> str:
        """The hypothesis in words."""
        return f"{self.notation.description}, {self.setup}"

    @property
    def loop_text(self) -> str:
        """The loop error in words."""
        return f"{self.loop_rms_mm:.3g} mm / {self.loop_rms_deg:.2g} deg"


def robot_side(T_base_gripper: ArrayLike, setup: Setup) -> Array:
    """A of A_i X B_i = Z: T_base_gripper (eye-in-hand) or its inverse (eye-to-hand)."""
    T = np.asarray(T_base_gripper, dtype=np.float64)
    return T if setup == "eye-in-hand" else se3.inverse(T)


def rank(
    notations: Sequence[PoseNotation], T_camera_target: ArrayLike, *, free_scale: bool = False
) -> tuple[Alternative, ...]:
    """Every notation in both setups, the best loop first; those whose angles disagree with the camera's are left out.

    free_scale: the target's lengths are in an unknown unit; the robot's are then in the unit that is believed first.
    Raises: InputError when there is no notation, or the numbers of poses differ; RefusedError below three poses.
    """
    if not notations:
        raise InputError("no reading of the robot poses to choose from")
    B = se3.check(T_camera_target, name="T_camera_target")
    n = len(notations[0].ids)
    if len(B) != n:
        raise InputError(f"{n} robot poses but {len(B)} target poses; give one target pose for each robot pose")
    if n < 3:
        motion_report(notations[0].T_base_gripper, B).require_determined()
    if free_scale:
        notations = [r for r in notations if r.units == notations[0].units]
    solved: dict[tuple[object, ...], Alternative] = {}
    out = []
    for notation in _sieved(notations, B):
        checkpoint()
        for setup in SETUPS:
            # Inverted eye-in-hand and eye-to-hand are one set of equations: solve it once.
            inverted = (notation.direction == "gripper-base") != (setup == "eye-to-hand")
            key = (notation.units, *notation.rotation_notation, inverted)
            if key not in solved:
                solved[key] = _solved(notation, setup, B, free_scale=free_scale)
            out.append(replace(solved[key], notation=notation, setup=setup))
    return tuple(sorted(out, key=order_of))


def order_of(a: Alternative) -> tuple[float, int, int]:
    """Best loop first; what is equal, by what is documented: nothing contradicted, poses as T_base_gripper."""
    return (round(misfit_of(a), 9), len(a.notation.contradicts), int(a.notation.direction != "base-gripper"))


def misfit_of(a: Alternative) -> float:
    """ln(rms mm) + ln(rms deg): the log-likelihood of residuals of unknown noise, per number, up to sign."""
    return float(np.log(a.loop_rms_mm + FLOOR_MM) + np.log(a.loop_rms_deg + FLOOR_DEG))


def notation_angles(notations: Sequence[PoseNotation]) -> dict[tuple[str, str, bool, bool], Array]:
    """By notation, the angles between any two poses, rad: what neither X nor the direction or unit of poses changes."""
    angles: dict[tuple[str, str, bool, bool], Array] = {}
    for notation in notations:
        if notation.rotation_notation not in angles:
            # |R_j^T R_i| has the same angle as |R_j R_i^T|: the direction of the poses does not matter here.
            T = notation.T_base_gripper
            angles[notation.rotation_notation] = _relative_angles(T, pair_indices(len(T)))
    return angles


def sieve_limit(best_mismatch: float) -> float:
    """The largest mismatch of angles that passes the sieve, rad."""
    return max(SIEVE_RATIO * best_mismatch, best_mismatch + np.deg2rad(SIEVE_DEG))


def _sieved(notations: Sequence[PoseNotation], B: Array) -> list[PoseNotation]:
    """The notations whose relative angles agree with the target's about as well as the best ones' do."""
    camera = _relative_angles(B, pair_indices(len(B)))
    mismatch = {key: float(np.median(np.abs(a - camera))) for key, a in notation_angles(notations).items()}
    limit = sieve_limit(min(mismatch.values()))
    # The most believable notation stays, however bad: what the file states is judged by its loop.
    first = notations[0].rotation_notation
    return [n for n in notations if mismatch[n.rotation_notation] <= limit or n.rotation_notation == first]


def _relative_angles(T: Array, pairs: tuple[NDArray[np.intp], ...]) -> Array:
    """Angles of R_j^T R_i, rad, from the chord |R_i - R_j| = 2 sqrt(2) sin(angle / 2), which is exact near zero."""
    R = T[:, :3, :3].reshape(-1, 9)
    chord = np.linalg.norm(R[pairs[0]] - R[pairs[1]], axis=1)
    return 2 * np.arcsin(np.clip(chord / np.sqrt(8), 0, 1))


def _solved(notation: PoseNotation, setup: Setup, B: Array, *, free_scale: bool) -> Alternative:
    """Closed form on the views that agree: start from congruent screws, then re-choose by the loop (concentration
    steps; Rousseeuw and Van Driessen, "Computing LTS regression for large data sets", 2006)."""
    A = robot_side(notation.T_base_gripper, setup)
    n = len(A)
    rows = sample(n, MOST_TO_CHOOSE if n > LONG else n)
    scale = scale_of_target(PosePairs(A[rows], B[rows])) if free_scale else 1.0
    if free_scale:
        scale = scale if np.isfinite(scale) else 1.0
        B = B.copy()
        B[:, :3, 3] *= scale
    kept = np.sort(np.argsort(_incongruence(A[rows], B[rows]), kind="stable")[: _kept_of(len(rows))])
    X, errors, kept = _concentrated(A[rows], B[rows], kept)
    if len(rows) < n:
        kept = _agreeing(A, B, X, errors)
        X, errors = _closed_form(A[kept], B[kept])
    return Alternative(notation, setup, errors.rms_mm, errors.rms_deg, X, kept, B, scale)


def _kept_of(n: int) -> int:
    return max(3, int(np.ceil(KEPT * n))) if n >= 6 else n


def _concentrated(A: Array, B: Array, kept: NDArray[np.intp]) -> tuple[Array, LoopErrors, NDArray[np.intp]]:
    """X, its loop over the views kept, and these, chosen again by the loop until they stay."""
    for _ in range(3):  # the steps settle in two or three
        X, errors = _closed_form(A[kept], B[kept])
        chosen = _agreeing(A, B, X, errors)
        if np.array_equal(chosen, kept):
            break
        kept = chosen
    return X, errors, kept


def _closed_form(A: Array, B: Array) -> tuple[Array, LoopErrors]:
    pairs = PosePairs(A, B)
    X, _ = park(pairs)
    X = se3.make(so3.nearest(X[:3, :3]), X[:3, 3])
    return X, errors_of(pairs, X)


def _agreeing(A: Array, B: Array, X: Array, errors: LoopErrors) -> NDArray[np.intp]:
    """Rows of the share KEPT of the views whose loop is the closest."""
    mm, deg = se3.deviation(errors.Z, A @ X @ B)
    distance = (mm / (errors.rms_mm + FLOOR_MM)) ** 2 + (deg / (errors.rms_deg + FLOOR_DEG)) ** 2
    return np.sort(np.argsort(distance, kind="stable")[: _kept_of(len(A))])


def _incongruence(A: Array, B: Array) -> Array:
    """Per view, the median over its partners of how much the angles of A and B differ, rad: (n,)."""
    pairs = pair_indices(len(A))
    mismatch = np.abs(_relative_angles(A, pairs) - _relative_angles(B, pairs))
    # Every view occurs in equally many pairs.
    by_view = np.argsort(np.concatenate(pairs), kind="stable").reshape(len(A), -1)
    return np.asarray(np.median(np.tile(mismatch, 2)[by_view], axis=1))
