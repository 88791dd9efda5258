"""How measured poses of the target are written, where their file leaves it open: the loop decides, as for the robot.

The angle between two poses is the same for robot and target, whatever X is (screw congruence; Chen, "A screw motion
approach to uniqueness analysis of head-eye geometry", CVPR 1991): notations that break it against every notation of the
robot poses are left out, the others are solved with the robot's and ranked by how the loop A_i X B_i = Z closes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibrant.diagnose.conventions.decide import CLEAR_RATIO, EQUAL_P, EQUAL_RATIO, loop_f_test, same_result
from calibrant.diagnose.conventions.hypotheses import (
    CONSISTENT,
    Alternative,
    misfit_of,
    notation_angles,
    rank,
    sieve_limit,
)
from calibrant.diagnose.doctor.evidence.finding import Finding
from calibrant.diagnose.doctor.evidence.loop import Evidence, Loop
from calibrant.diagnose.doctor.evidence.significance import confidence
from calibrant.errors import RefusedError
from calibrant.formats.poses.notations import PoseNotation

MOST_POSES = 20
"""Poses that judge a notation: wrong ones leave tens of degrees, which twenty tell from noise as well as all do."""


@dataclass(frozen=True, eq=False)
class TargetNotation:
    """The notation of the target poses (its T_base_gripper is T_camera_target), and what is to be said of it."""

    notation: PoseNotation
    finding: Finding | None


@dataclass(frozen=True, eq=False)
class _Candidate:
    """A notation of the target poses, and the best loop that any notation of the robot poses closes with it."""

    notation: PoseNotation
    best: Alternative


def decide_target_notation(
    robot: Sequence[PoseNotation], target: Sequence[PoseNotation], *, free_scale: bool = False
) -> TargetNotation:
    """The notation of the target poses that closes the loop; the first one where none does, or the data cannot tell.

    Args: robot and target, the notations of n paired poses, the most believable first (formats.poses.notations);
    free_scale, the target's lengths are in an unknown unit.
    Raises: RefusedError when two notations close the loop equally well and lead to different results.
    """
    if free_scale:
        target = [t for t in target if t.units == target[0].units]
    n = len(target[0].ids)
    if len(target) == 1 or n < 4:  # three poses close the loop of many notations
        return TargetNotation(target[0], None)
    some = np.linspace(0, n - 1, min(n, MOST_POSES)).round().astype(int).tolist()
    few = [r.take(some) for r in robot]
    candidates = [
        _Candidate(t, rank(few, t.take(some).T_base_gripper, free_scale=free_scale)[0]) for t in _sieved(robot, target)
    ]
    first = candidates[0]
    chosen = min(candidates, key=lambda c: misfit_of(c.best))
    if chosen.best.score > CONSISTENT or not _better(chosen, first):
        chosen = first
    if chosen.best.score <= CONSISTENT:
        _refuse_rivals(chosen, candidates)
    return TargetNotation(chosen.notation, None if chosen is first else _target_notation_finding(chosen, first))


def _sieved(robot: Sequence[PoseNotation], target: Sequence[PoseNotation]) -> list[PoseNotation]:
    """The target's notations whose angles agree with some robot notation's about as well as the best, and the first."""
    of_robot = list(notation_angles(robot).values())
    mismatch = {
        key: min(float(np.median(np.abs(a - angles))) for a in of_robot)
        for key, angles in notation_angles(target).items()
    }
    limit = sieve_limit(min(mismatch.values()))
    return [t for i, t in enumerate(target) if i == 0 or mismatch[t.rotation_notation] <= limit]


def _better(chosen: _Candidate, first: _Candidate) -> bool:
    """True when the loop says that the first notation is wrong; more must speak against what a file states."""
    ratio, p = loop_f_test(chosen.best, first.best)
    return p <= EQUAL_P and ratio >= (CLEAR_RATIO if chosen.notation.contradicts else EQUAL_RATIO)


def _refuse_rivals(chosen: _Candidate, candidates: Sequence[_Candidate]) -> None:
    """Raises: RefusedError naming two notations that nothing tells apart."""
    for rival in candidates:
        if rival is chosen or len(rival.notation.contradicts) > len(chosen.notation.contradicts):
            continue
        if same_result(chosen.best, rival.best):
            continue
        ratio, p = loop_f_test(chosen.best, rival.best)
        if p > EQUAL_P or ratio < EQUAL_RATIO:
            raise RefusedError(
                "the target poses can be read in two ways that fit equally well and lead to different results: "
                f"{chosen.notation.written} (loop {chosen.best.loop_text}) and {rival.notation.written} (loop "
                f"{rival.best.loop_text}); say which: --target-pose-rotation {chosen.notation.rotation} or "
                f"{rival.notation.rotation}"
            )


def _target_notation_finding(chosen: _Candidate, first: _Candidate) -> Finding:
    evidence = Evidence(Loop.of(first.best), Loop.of(chosen.best))
    against = "; ".join(chosen.notation.contradicts)
    message = f"the target poses are {chosen.notation.written}, read so: {evidence.text}"
    _, p = loop_f_test(chosen.best, first.best)
    if against:
        return Finding("target-pose-rotation", "warn", f"{message} ({against})", confidence(p), evidence)
    return Finding("target-pose-rotation", "ok", message, confidence(p), evidence)
