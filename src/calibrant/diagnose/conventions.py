"""Which reading of the poses, and which setup, the data bear out: the one whose loop A_i X B_i = Z closes.

1. Notations are sieved by what no X can change: robot and camera must see the same angle between any two poses
   (screw congruence; Chen, "A screw motion approach to uniqueness analysis of head-eye geometry", CVPR 1991).
2. What is left is solved in closed form on the three quarters of the views that agree best, so that some wrong views do
   not hide the right reading, and ranked by the rms of the loop over these views.
3. The best one is taken when an F test on the loops says that the next one, if it leads elsewhere, is worse.

Inverted robot poses with the camera on the hand give the same equations as poses as they stand with the camera fixed,
A_i = T_base_gripper_i^-1 either way. Data cannot tell these two apart; the documented direction, base-gripper, does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import fdtrc

from calibrant.calibrate.hand_eye.loops import loop_consistency, loop_errors
from calibrant.calibrate.hand_eye.motion import motion_report
from calibrant.calibrate.hand_eye.relative import PosePairs
from calibrant.calibrate.hand_eye.solvers.park import park
from calibrant.data import Check
from calibrant.errors import InputError, RefusedError
from calibrant.formats.pose_readings import PoseReading
from calibrant.geometry import se3, so3

Array = NDArray[np.float64]
Setup = Literal["eye-in-hand", "eye-to-hand"]
SETUPS: tuple[Setup, Setup] = ("eye-in-hand", "eye-to-hand")

KEPT = 0.75
"""Share of the views that judges a reading; the worst quarter may be flipped, mispaired or badly seen."""
FLOOR_MM, FLOOR_DEG = 1e-3, 1e-3
"""Loops below a micrometre and a thousandth of a degree are closed: no robot repeats better, so less is rounding."""
EQUAL_P = 0.01
"""Readings whose loops differ by what happens once in a hundred times by chance fit equally well."""
EQUAL_RATIO = 1.5
"""And so do loops within a factor of 1.5, however many the poses: systematic errors, such as a bent board or lens,
favour one wrong reading over another by that much."""
CLEAR_RATIO = 3.0
"""What a file or a user states is doubted only when another reading closes the loop three times better."""
CONSISTENT = 0.25
"""Largest median loop over the size of the motion that counts as consistent: noise gives some per cent, chance 1."""
SIEVE_RATIO, SIEVE_DEG = 4.0, 0.5
"""Notations pass the sieve when their angle mismatch is within 4 times the best one's, or within half a degree of it:
the median of pairs varies by less than a factor of two between halves of one data set."""
SAME_TRANSFORM_MM, SAME_TRANSFORM_DEG = 1.0, 0.1
"""Results closer than this, or than the loop, are one result: less than a closed form on ordinary data resolves."""


@dataclass(frozen=True, eq=False)
class Alternative:
    """One hypothesis and how its loop closes.

    loop_rms_mm, loop_rms_deg: spread of A_i X B_i over the views kept (indices); X: the camera's transform of the
    normal form; T_camera_target (n, 4, 4), metres.
    """

    reading: PoseReading
    setup: Setup
    loop_rms_mm: float
    loop_rms_deg: float
    X: Array
    kept: NDArray[np.intp]
    T_camera_target: Array

    @cached_property
    def score(self) -> float:
        """Median loop over the size of the motion: 0 perfect, 1 no agreement at all."""
        return loop_consistency(self.A, self.T_camera_target, self.X).score

    @property
    def A(self) -> Array:
        """(n, 4, 4) of the normal form A_i X B_i = Z."""
        return robot_side(self.reading.T_base_gripper, self.setup)

    @property
    def description(self) -> str:
        """The hypothesis in words."""
        return f"{self.reading.description}, {self.setup}"

    @property
    def loop_text(self) -> str:
        """The loop error in words."""
        return f"{self.loop_rms_mm:.3g} mm / {self.loop_rms_deg:.2g} deg"


@dataclass(frozen=True, eq=False)
class ConventionDecision:
    """What was decided. confidence: 1 - p of the F test against the next different hypothesis.

    alternatives: every hypothesis tried, the best first, also those that the user's words exclude. findings: what
    does not fit, by name: setup-mismatch, header-overruled, no-reading-fits.
    """

    reading: PoseReading
    setup: Setup
    confidence: float
    message: str
    alternatives: tuple[Alternative, ...]
    findings: tuple[Check, ...] = ()

    @property
    def ok(self) -> bool:
        """False when a finding failed."""
        return all(f.status != "fail" for f in self.findings)


def robot_side(T_base_gripper: ArrayLike, setup: Setup) -> Array:
    """A of A_i X B_i = Z: T_base_gripper (eye-in-hand) or its inverse (eye-to-hand)."""
    T = np.asarray(T_base_gripper, dtype=np.float64)
    return T if setup == "eye-in-hand" else se3.inverse(T)


def decide(
    readings: Sequence[PoseReading], T_camera_target: ArrayLike, *, setup: Setup | Literal["auto"] = "auto"
) -> ConventionDecision:
    """Decide among readings and setups by the data.

    Args: readings, the most believable first (formats.poses.readings); T_camera_target (n, 4, 4), metres, a target
    pose for each robot pose; setup, eye-in-hand or eye-to-hand when the user knows it.
    Raises: InputError when the numbers of poses differ; RefusedError when the motions leave the result undetermined (by
    name, with the cure), or when two readings fit equally well and lead to different results, naming both and the
    option that would settle it.
    """
    ranked = rank(readings, T_camera_target)
    wanted = [a for a in ranked if setup in ("auto", a.setup)]
    stated = _preferred([a for a in wanted if not a.reading.contradicts] or wanted)
    best = _preferred(wanted)
    findings: list[Check] = []
    chosen = stated
    if best.reading.contradicts and _clearly_better(best, stated):
        chosen = best
        findings.append(_overruled(stated, best))
    # Motions that determine nothing let every reading fit, or none: then that is what must be said.
    motion_report(chosen.A, chosen.T_camera_target).require_determined()
    rivals = [a for a in wanted if len(a.reading.contradicts) <= len(chosen.reading.contradicts)]
    confidence = _confidence(chosen, rivals)
    findings += _mismatch(chosen, ranked, setup)
    if chosen.score > CONSISTENT:
        message = (
            f"no reading closes the loop: the best one leaves {chosen.loop_text}, {chosen.score:.0%} of the motion "
            "itself; are images and poses paired rightly, is it the right target?"
        )
        findings.append(Check("no-reading-fits", "fail", message, chosen.score))
    message = _message(chosen, ranked, wanted, setup, confidence)
    return ConventionDecision(chosen.reading, chosen.setup, confidence, message, ranked, tuple(findings))


def rank(readings: Sequence[PoseReading], T_camera_target: ArrayLike) -> tuple[Alternative, ...]:
    """Every reading in both setups, the best loop first; readings whose angles disagree with the camera's are left out.

    Raises: InputError when there is no reading, or the numbers of poses differ; RefusedError below three poses.
    """
    if not readings:
        raise InputError("no reading of the robot poses to choose from")
    B = se3.check(T_camera_target, name="T_camera_target")
    n = len(readings[0].ids)
    if len(B) != n:
        raise InputError(f"{n} robot poses but {len(B)} target poses; give one target pose for each robot pose")
    if n < 3:
        motion_report(readings[0].T_base_gripper, B).require_determined()
    solved: dict[tuple[object, ...], Alternative] = {}
    out = []
    for reading in _sieved(readings, B):
        for setup in SETUPS:
            # Inverted eye-in-hand and eye-to-hand are one set of equations: solve it once.
            inverted = (reading.direction == "gripper-base") != (setup == "eye-to-hand")
            key = (reading.units, reading.rotation, reading.angle, reading.by_axis_names, inverted)
            if key not in solved:
                solved[key] = _solved(reading, setup, B)
            out.append(replace(solved[key], reading=reading, setup=setup))
    return tuple(sorted(out, key=_order))


def _order(a: Alternative) -> tuple[float, int, int]:
    """Best loop first; what is equal, by what is documented: nothing contradicted, poses as T_base_gripper."""
    return (round(_misfit(a), 9), len(a.reading.contradicts), int(a.reading.direction != "base-gripper"))


def _misfit(a: Alternative) -> float:
    """ln(rms mm) + ln(rms deg): the log-likelihood of residuals of unknown noise, per number, up to sign."""
    return float(np.log(a.loop_rms_mm + FLOOR_MM) + np.log(a.loop_rms_deg + FLOOR_DEG))


def _sieved(readings: Sequence[PoseReading], B: Array) -> list[PoseReading]:
    """The readings whose relative angles agree with the target's about as well as the best ones' do."""
    upper = np.triu_indices(len(B), 1)
    camera = _relative_angles(B, upper)
    mismatch: dict[tuple[object, ...], float] = {}
    keys = [(r.rotation, r.angle, r.by_axis_names) for r in readings]
    for key, reading in zip(keys, readings):
        if key not in mismatch:
            # |R_j^T R_i| has the same angle as |R_j R_i^T|: the direction of the poses does not matter here.
            T = reading.T_base_gripper
            T = T if reading.direction == "base-gripper" else se3.inverse(T)
            mismatch[key] = float(np.median(np.abs(_relative_angles(T, upper) - camera)))
    limit = max(SIEVE_RATIO * min(mismatch.values()), min(mismatch.values()) + np.deg2rad(SIEVE_DEG))
    # The most believable reading stays, however bad: what the file states is judged by its loop.
    return [
        r for i, (key, r) in enumerate(zip(keys, readings)) if mismatch[key] <= limit or _as_first(r, readings[0], i)
    ]


def _as_first(reading: PoseReading, first: PoseReading, index: int) -> bool:
    same = (reading.rotation, reading.angle, reading.by_axis_names) == (
        first.rotation,
        first.angle,
        first.by_axis_names,
    )
    return index == 0 or same


def _relative_angles(T: Array, pairs: tuple[NDArray[np.intp], ...]) -> Array:
    """Angles of R_j^T R_i, rad, from the chord |R_i - R_j| = 2 sqrt(2) sin(angle / 2), which is exact near zero."""
    R = T[:, :3, :3].reshape(-1, 9)
    chord = np.linalg.norm(R[pairs[0]] - R[pairs[1]], axis=1)
    return 2 * np.arcsin(np.clip(chord / np.sqrt(8), 0, 1))


def _solved(reading: PoseReading, setup: Setup, B: Array) -> Alternative:
    """Closed form on the views that agree: start from congruent screws, then re-choose by the loop (concentration
    steps; Rousseeuw and Van Driessen, "Computing LTS regression for large data sets", 2006)."""
    A = robot_side(reading.T_base_gripper, setup)
    n = len(A)
    keep_count = max(3, int(np.ceil(KEPT * n))) if n >= 6 else n
    kept = np.sort(np.argsort(_incongruence(A, B), kind="stable")[:keep_count])
    for _ in range(3):  # the steps settle in two or three
        X, _ = park(PosePairs(A[kept], B[kept]))
        X = se3.make(so3.nearest(X[:3, :3]), X[:3, 3])
        errors = loop_errors(A[kept], B[kept], X)
        delta = se3.local(errors.Z, A @ X @ B)
        mm, deg = 1e3 * np.linalg.norm(delta[:, 3:], axis=1), np.rad2deg(np.linalg.norm(delta[:, :3], axis=1))
        distance = (mm / (errors.rms_mm + FLOOR_MM)) ** 2 + (deg / (errors.rms_deg + FLOOR_DEG)) ** 2
        chosen = np.sort(np.argsort(distance, kind="stable")[:keep_count])
        if np.array_equal(chosen, kept):
            break
        kept = chosen
    return Alternative(reading, setup, errors.rms_mm, errors.rms_deg, X, kept, B)


def _incongruence(A: Array, B: Array) -> Array:
    """Per view, the median over its partners of how much the angles of A and B differ, rad: (n,)."""
    n = len(A)
    upper = np.triu_indices(n, 1)
    table = np.zeros((n, n))
    table[upper] = np.abs(_relative_angles(A, upper) - _relative_angles(B, upper))
    return np.median(table + table.T, axis=1)


def _preferred(candidates: Sequence[Alternative]) -> Alternative:
    """The best of ranked candidates; among those of the same equations, the documented direction."""
    best = candidates[0]
    same = [a for a in candidates if _misfit(a) == _misfit(best) and np.array_equal(a.X, best.X)]
    return min(same, key=_order)


def _f_test(better: Alternative, worse: Alternative) -> tuple[float, float]:
    """Ratio of the loops (worse over better, the larger of mm and deg) and the p of it under equal noise.

    F = ratio^2 with 3 n - 6 numbers that are free on either side; two tests are made, so p is doubled (Bonferroni).
    """
    free = max(1, 3 * len(better.kept) - 6)
    ratio_mm = (worse.loop_rms_mm + FLOOR_MM) / (better.loop_rms_mm + FLOOR_MM)
    ratio_deg = (worse.loop_rms_deg + FLOOR_DEG) / (better.loop_rms_deg + FLOOR_DEG)
    ratio = max(ratio_mm, ratio_deg)
    return ratio, min(1.0, 2 * float(fdtrc(free, free, ratio**2)))


def _clearly_better(best: Alternative, stated: Alternative) -> bool:
    ratio, p = _f_test(best, stated)
    return best.score <= CONSISTENT and ratio >= CLEAR_RATIO and p <= EQUAL_P and _misfit(best) < _misfit(stated)


def _same_result(a: Alternative, b: Alternative) -> bool:
    """True when both lead to one camera transform: closer than the loop leaves it, or than SAME_TRANSFORM."""
    if a.setup != b.setup:
        return False
    delta = se3.local(a.X, b.X)
    mm, deg = 1e3 * float(np.linalg.norm(delta[3:])), float(np.rad2deg(np.linalg.norm(delta[:3])))
    return mm <= max(a.loop_rms_mm, SAME_TRANSFORM_MM) and deg <= max(a.loop_rms_deg, SAME_TRANSFORM_DEG)


def _equivalent(a: Alternative, b: Alternative) -> bool:
    """True for the pair that no data can tell apart: the other direction in the other setup."""
    return a.setup != b.setup and a.reading.direction != b.reading.direction and np.array_equal(a.X, b.X)


def _confidence(chosen: Alternative, rivals: Sequence[Alternative]) -> float:
    """1 - p against the next rival that leads elsewhere, 0 when nothing fits.

    Raises: RefusedError when the rival fits equally well. With three poses it always does: the motions
    a = T1^-1 T2, b = T2^-1 T3 of one setup are those of the other up to conjugation, (a, b) and (a, a b a^-1).
    """
    for rival in rivals:
        if rival is chosen or _equivalent(chosen, rival) or _same_result(chosen, rival):
            continue
        ratio, p = _f_test(chosen, rival)
        if p > EQUAL_P or ratio < EQUAL_RATIO:
            if chosen.score > CONSISTENT:
                return 0.0  # nothing fits at all: that is a finding of its own, not a choice between two
            few = (
                "three poses never tell the setups apart; "
                if len(chosen.A) == 3 and chosen.setup != rival.setup
                else ""
            )
            raise RefusedError(
                f"the robot poses can be read in two ways that fit equally well and lead to different results: "
                f"{chosen.description} (loop {chosen.loop_text}) and {rival.description} (loop {rival.loop_text}); "
                f"{few}say which: {_settling_options(chosen, rival)}"
            )
        return 1 - p
    return 1.0


def _settling_options(a: Alternative, b: Alternative) -> str:
    pairs = (
        ("--setup", a.setup, b.setup),
        ("--pose-units", a.reading.units, b.reading.units),
        ("--pose-rotation", a.reading.rotation, b.reading.rotation),
        ("--pose-angle", a.reading.angle, b.reading.angle),
        ("--pose-direction", a.reading.direction, b.reading.direction),
    )
    return ", ".join(f"{option} {first} or {second}" for option, first, second in pairs if first != second)


def _overruled(stated: Alternative, best: Alternative) -> Check:
    message = (
        f"{'; '.join(best.reading.contradicts)}, but read so the loop leaves {stated.loop_text}; read as "
        f"{best.reading.description} it closes to {best.loop_text}, and that is used"
    )
    return Check("header-overruled", "warn", message, stated.loop_rms_mm / max(best.loop_rms_mm, FLOOR_MM))


def _mismatch(chosen: Alternative, ranked: Sequence[Alternative], setup: str) -> list[Check]:
    """The finding that the setup the user gave does not fit poses taken as T_base_gripper, while the other one does."""
    if setup == "auto":
        return []
    same_reading = [
        a
        for a in ranked
        if (a.reading.units, a.reading.rotation, a.reading.angle, a.reading.by_axis_names)
        == (chosen.reading.units, chosen.reading.rotation, chosen.reading.angle, chosen.reading.by_axis_names)
    ]
    documented = [a for a in same_reading if a.reading.direction == "base-gripper"] or [
        a for a in same_reading if a.reading.direction == chosen.reading.direction
    ]
    given = next((a for a in documented if a.setup == setup), None)
    other = next((a for a in documented if a.setup != setup), None)
    if given is None or other is None or not _clearly_better(other, given):
        return []
    message = (
        f"the data do not fit {setup}: its loop leaves {given.loop_text}, that of {other.setup} {other.loop_text}; use "
        f"--setup {other.setup}"
    )
    if given.reading.direction == "base-gripper":
        message += ", or --pose-direction gripper-base if the file holds T_gripper_base"
    return [Check("setup-mismatch", "fail", message, given.loop_rms_mm / max(other.loop_rms_mm, FLOOR_MM))]


def _message(
    chosen: Alternative, ranked: Sequence[Alternative], wanted: Sequence[Alternative], setup: str, confidence: float
) -> str:
    """What was decided and why, for people."""
    parts = [f"poses read as {chosen.description}: the loop closes to {chosen.loop_text}"]
    rival = next((a for a in ranked if not np.array_equal(a.X, chosen.X)), None)
    if rival is not None:
        ratio, p = _f_test(chosen, rival)
        chance = f"p = {p:.1g}" if p >= 1e-12 else "p < 1e-12"
        parts.append(
            f"the next reading, {rival.description}, leaves {rival.loop_text}, {ratio:.3g} times as much "
            f"(F test {chance})"
        )
    twin = next((a for a in wanted if _equivalent(chosen, a)), None)
    if twin is not None and setup == "auto":
        given = "T_gripper_base" if twin.reading.direction == "gripper-base" else "T_base_gripper"
        parts.append(
            f"{twin.setup} with poses given as {given} would fit as well, no data can tell: the documented direction "
            f"was taken; if the file is the other way, say so with --pose-direction {twin.reading.direction}"
        )
    return "; ".join(parts) + "."
