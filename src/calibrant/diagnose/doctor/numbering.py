"""Boards that look the same turned: the images number them anew each time, and the robot's motion says which end it is.

That is no fault of the data, and is settled before anything else: the notation of the poses is decided by rotations
that agree, and those of views numbered from different ends do not.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.cell.boards.numbering import congruence
from calibrant.calibrate.cell.boards.turned import ViewsNumbered, board_turns, numbered_by_robot
from calibrant.diagnose.conventions.hypotheses import SIEVE_DEG, SIEVE_RATIO
from calibrant.diagnose.doctor.evidence.case import Case
from calibrant.diagnose.doctor.evidence.finding import Finding
from calibrant.diagnose.doctor.evidence.significance import CONVINCING, confidence
from calibrant.formats.poses.notations import PoseNotation
from calibrant.geometry import se3


def numbering_of(case: Case, complete: Sequence[PoseNotation]) -> ViewsNumbered | None:
    """How the views of a case are to be numbered, however the poses are to be read; None where all stay as they are."""
    if case.observations is None:
        return None
    turns = board_turns(case.observations.target)
    if turns is None or len(case.index) < 3:
        return None
    sides = sides_of(complete, case, len(turns.F))
    return numbered_by_robot(turns, sides, case.data.B, case.data.use)


def sides_of(complete: Sequence[PoseNotation], case: Case, order: int = 1) -> list[Array]:
    """The robot's poses in every notation whose angles may be the camera's, and their inverses; order: equal turns of
    the board."""
    distinct: list[Array] = []
    for notation in complete:
        T = se3.make(notation.T_base_gripper[:, :3, :3], np.zeros((len(case), 3)))
        if not any(np.allclose(T, other) or np.allclose(T, se3.inverse(other)) for other in distinct):
            distinct.append(T)
    if len(distinct) > 1:
        off = [congruence(T[case.index, :3, :3], case.B[:, :3, :3], order) for T in distinct]
        limit = max(SIEVE_RATIO * min(off), min(off) + np.deg2rad(SIEVE_DEG))
        distinct = [T for T, value in zip(distinct, off) if value <= limit]
    return [side for T in distinct for side in (T, se3.inverse(T))]


def finding(found: ViewsNumbered, ids: Sequence[str]) -> Finding:
    """What was done, or cannot be done."""
    check = found.check
    names = tuple(ids[i] for i in found.rows)
    return Finding(check.name, check.status, check.message, confidence(CONVINCING), views=names)
