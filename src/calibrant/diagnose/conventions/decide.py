"""Which notation of the poses, and which setup, the data bear out: the one whose loop A_i X B_i = Z closes.

1. Notations are sieved by what no X can change: robot and camera must see the same angle between any two poses
   (screw congruence; Chen, "A screw motion approach to uniqueness analysis of head-eye geometry", CVPR 1991).
2. What is left is solved in closed form on the three quarters of the views that agree best, so that some wrong views do
   not hide the right notation, and ranked by the rms of the loop over these views.
3. The best one is taken when an F test on the loops says that the next one, if it leads elsewhere, is worse.

Inverted robot poses with the camera on the hand give the same equations as poses as they stand with the camera fixed,
A_i = T_base_gripper_i^-1 either way. No loop can tell these two apart. The documented direction, base-gripper, is taken
unless it puts what the gripper carries farther away than anybody mounts it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from calibrant.calibrate.solvers.motion import motion_report
from calibrant.data import Check
from calibrant.diagnose.conventions.hypotheses import CONSISTENT, FLOOR_DEG, FLOOR_MM, Alternative, misfit_of, order_of
from calibrant.diagnose.conventions.hypotheses import Setup as Setup
from calibrant.diagnose.conventions.hypotheses import rank as rank
from calibrant.diagnose.conventions.hypotheses import robot_side as robot_side
from calibrant.errors import RefusedError
from calibrant.formats.poses.notations import PoseNotation
from calibrant.geometry import se3
from calibrant.optimize.chances import f_tail

EQUAL_P = 0.01
"""Notations whose loops differ by what happens once in a hundred times by chance fit equally well."""
EQUAL_RATIO = 1.5
"""And so do loops within a factor of 1.5, however many the poses: systematic errors, such as a bent board or lens,
favour one wrong notation over another by that much."""
CLEAR_RATIO = 3.0
"""What a file or a user states is doubted only when another notation closes the loop three times better."""
SAME_TRANSFORM_MM, SAME_TRANSFORM_DEG = 1.0, 0.1
"""Results closer than this, or than the loop, are one result: less than a closed form on ordinary data resolves."""


@dataclass(frozen=True, eq=False)
class ConventionDecision:
    """What was decided. confidence: 1 - p of the F test against the next different hypothesis.

    alternatives: every hypothesis tried, the best first, also those that the user's words exclude. findings: what
    does not fit, by name: setup-mismatch, header-overruled, no-reading-fits.
    """

    notation: PoseNotation
    setup: Setup
    confidence: float
    message: str
    alternatives: tuple[Alternative, ...]
    findings: tuple[Check, ...] = ()

    @property
    def ok(self) -> bool:
        """False when a finding failed."""
        return all(f.status != "fail" for f in self.findings)


def decide(
    notations: Sequence[PoseNotation],
    T_camera_target: ArrayLike,
    *,
    setup: Setup | Literal["auto"] = "auto",
    free_scale: bool = False,
) -> ConventionDecision:
    """Decide among notations and setups by the data.

    Args: notations, the most believable first (formats.poses.notations); T_camera_target (n, 4, 4), metres, a target
    pose for each robot pose; setup, eye-in-hand or eye-to-hand when the user knows it; free_scale, the target's
    lengths are in an unknown unit.
    Raises: InputError when the numbers of poses differ; RefusedError when the motions leave the result undetermined (by
    name, with the cure), or when two notations fit equally well and lead to different results, naming both and the
    option that would settle it.
    """
    ranked = rank(notations, T_camera_target, free_scale=free_scale)
    wanted = [a for a in ranked if setup in ("auto", a.setup)]
    stated = _preferred([a for a in wanted if not a.notation.contradicts] or wanted)
    best = _preferred(wanted)
    findings: list[Check] = []
    chosen = stated
    if best.notation.contradicts and _clearly_better(best, stated):
        chosen = best
        findings.append(_overruled(stated, best))
    # Motions that determine nothing let every notation fit, or none: then that is what must be said.
    motion_report(chosen.A, chosen.T_camera_target).require_determined()
    rivals = [a for a in wanted if len(a.notation.contradicts) <= len(chosen.notation.contradicts)]
    confidence = _confidence(chosen, rivals)
    findings += _mismatch(chosen, ranked, setup)
    findings += _direction_checks(chosen, ranked)
    if chosen.score > CONSISTENT:
        message = (
            "robot and camera do not fit together, however the file of poses is read (units, rotation, direction): at "
            f"best the views differ by {chosen.loop_text} on where the target is, {chosen.score:.0%} of the motion "
            "itself; are images and poses paired rightly, is it the right target?"
        )
        findings.append(Check("no-reading-fits", "fail", message, chosen.score))
    message = _message(chosen, ranked, wanted, setup, confidence)
    return ConventionDecision(chosen.notation, chosen.setup, confidence, message, ranked, tuple(findings))


def _preferred(candidates: Sequence[Alternative]) -> Alternative:
    """The best of ranked candidates; among those of the same equations, the documented direction if it is plausible."""
    best = candidates[0]
    same = [a for a in candidates if misfit_of(a) == misfit_of(best) and np.array_equal(a.X, best.X)]
    return min(same, key=lambda a: (not a.plausible, order_of(a)))


def loop_f_test(better: Alternative, worse: Alternative) -> tuple[float, float]:
    """Ratio of the loops (worse over better, the larger of mm and deg) and the p of it under equal noise.

    F = ratio^2 with 3 n - 6 numbers that are free on either side; two tests are made, so p is doubled (Bonferroni).
    """
    free = max(1, 3 * len(better.kept) - 6)
    ratio_mm = (worse.loop_rms_mm + FLOOR_MM) / (better.loop_rms_mm + FLOOR_MM)
    ratio_deg = (worse.loop_rms_deg + FLOOR_DEG) / (better.loop_rms_deg + FLOOR_DEG)
    ratio = max(ratio_mm, ratio_deg)
    return ratio, min(1.0, 2 * float(f_tail(free, free, ratio**2)))


def _clearly_better(best: Alternative, stated: Alternative) -> bool:
    ratio, p = loop_f_test(best, stated)
    return best.score <= CONSISTENT and ratio >= CLEAR_RATIO and p <= EQUAL_P and misfit_of(best) < misfit_of(stated)


def same_result(a: Alternative, b: Alternative) -> bool:
    """True when both lead to one camera transform: closer than the loop leaves it, or than SAME_TRANSFORM."""
    if a.setup != b.setup:
        return False
    mm, deg = se3.deviation(a.X, b.X)
    return bool(mm <= max(a.loop_rms_mm, SAME_TRANSFORM_MM) and deg <= max(a.loop_rms_deg, SAME_TRANSFORM_DEG))


def _equivalent(a: Alternative, b: Alternative) -> bool:
    """True for the pair that no data can tell apart: the other direction in the other setup."""
    return a.setup != b.setup and a.notation.direction != b.notation.direction and np.array_equal(a.X, b.X)


def _confidence(chosen: Alternative, rivals: Sequence[Alternative]) -> float:
    """1 - p against the next rival that leads elsewhere, 0 when nothing fits.

    Raises: RefusedError when the rival fits equally well. With three poses it always does: the motions
    a = T1^-1 T2, b = T2^-1 T3 of one setup are those of the other up to conjugation, (a, b) and (a, a b a^-1).
    """
    for rival in rivals:
        if rival is chosen or _equivalent(chosen, rival) or same_result(chosen, rival):
            continue
        ratio, p = loop_f_test(chosen, rival)
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
        ("--pose-units", a.notation.units, b.notation.units),
        ("--pose-rotation", a.notation.rotation, b.notation.rotation),
        ("--pose-angle", a.notation.angle, b.notation.angle),
        ("--pose-direction", a.notation.direction, b.notation.direction),
    )
    return ", ".join(f"{option} {first} or {second}" for option, first, second in pairs if first != second)


def _overruled(stated: Alternative, best: Alternative) -> Check:
    message = (
        f"{'; '.join(best.notation.contradicts)}, but read so the loop leaves {stated.loop_text}; read as "
        f"{best.notation.description} it closes to {best.loop_text}, and that is used"
    )
    # Where only the habit of rows of bare numbers speaks against it, the loop has decided and nothing is contradicted.
    order_alone = best.notation.rotation_first and len(best.notation.contradicts) == 1
    ratio = stated.loop_rms_mm / max(best.loop_rms_mm, FLOOR_MM)
    if order_alone:
        return Check("rotation-first", "ok", message, ratio)
    return Check("header-overruled", "warn", message, ratio)


def _mismatch(chosen: Alternative, ranked: Sequence[Alternative], setup: str) -> list[Check]:
    """The finding that the setup the user gave does not fit poses taken as T_base_gripper, while the other one does."""
    if setup == "auto":
        return []
    alike = [a for a in ranked if _same_notation(a, chosen)]
    documented = [a for a in alike if a.notation.direction == "base-gripper"] or [
        a for a in alike if a.notation.direction == chosen.notation.direction
    ]
    given = next((a for a in documented if a.setup == setup), None)
    other = next((a for a in documented if a.setup != setup), None)
    if given is None or other is None or not _clearly_better(other, given):
        return []
    if chosen.notation.direction == "gripper-base" and chosen.plausible and not other.plausible:
        return []  # the setup is right and the poses are inverted: said by _direction_checks
    message = (
        f"the data do not fit {setup}: its loop leaves {given.loop_text}, that of {other.setup} {other.loop_text}; use "
        f"--setup {other.setup}"
    )
    if given.notation.direction == "base-gripper":
        message += ", or --pose-direction gripper-base if the file holds T_gripper_base"
    else:
        message += ", or --pose-direction base-gripper if the file holds T_base_gripper"
    return [Check("setup-mismatch", "fail", message, given.loop_rms_mm / max(other.loop_rms_mm, FLOOR_MM))]


def _direction_checks(chosen: Alternative, ranked: Sequence[Alternative]) -> list[Check]:
    """The finding that the poses are the other way than documented, where neither file nor user said so."""
    if chosen.notation.direction == "base-gripper" or chosen.score > CONSISTENT:
        return []
    documented = [a for a in ranked if a.notation.direction == "base-gripper" and _same_notation(a, chosen)]
    if not documented:
        return []  # the direction was given
    same_setup = next((a for a in documented if a.setup == chosen.setup), None)
    twin = next((a for a in documented if _equivalent(a, chosen)), None)
    message = "the poses are inverted, T_gripper_base where T_base_gripper is documented: "
    if same_setup is not None:
        message += f"so the loop closes to {chosen.loop_text}, as documented it leaves {same_setup.loop_text}"
    if twin is not None:
        closes = f"; as documented {twin.setup} would close it as well"
        message += closes + (
            f", if that is so, use --setup {twin.setup}" if twin.plausible else f", but {_mounting_text(twin)}"
        )
    return [Check("pose-direction", "warn", message, same_setup.loop_rms_mm if same_setup else None)]


def _mounting_text(a: Alternative) -> str:
    """Why nobody builds a cell as a hypothesis says."""
    carried, fixed = a.mounting
    thing, other = ("camera", "target") if a.setup == "eye-in-hand" else ("target", "camera")
    return (
        f"that puts the {thing} {carried:.2f} m from the gripper and the {other} {fixed:.2f} m from the base, which "
        "nobody builds"
    )


def _same_notation(a: Alternative, b: Alternative) -> bool:
    """True when both read the numbers alike, direction aside."""
    one, two = a.notation, b.notation
    return (one.units, one.rotation_notation) == (two.units, two.rotation_notation)


def _message(
    chosen: Alternative, ranked: Sequence[Alternative], wanted: Sequence[Alternative], setup: str, confidence: float
) -> str:
    """What was decided and why, for people."""
    parts = [f"poses read as {chosen.description}: the loop closes to {chosen.loop_text}"]
    rival = next((a for a in ranked if not np.array_equal(a.X, chosen.X)), None)
    if rival is not None:
        _, p = loop_f_test(chosen, rival)
        chance = f"p = {p:.1g}" if p >= 1e-12 else "p < 1e-12"
        parts.append(f"the next reading, {rival.description}, leaves {rival.loop_text} ({chance})")
    twin = next((a for a in wanted if _equivalent(chosen, a)), None)
    if twin is not None and setup == "auto":
        given = "T_gripper_base" if twin.notation.direction == "gripper-base" else "T_base_gripper"
        text = f"{twin.setup} with poses given as {given} would fit as well, "
        text += (
            "no data can tell: the documented direction was taken; if the file is the other way, say so with "
            f"--pose-direction {twin.notation.direction}"
            if twin.plausible
            else f"but {_mounting_text(twin)}"
        )
        parts.append(text)
    return "; ".join(parts) + "."
