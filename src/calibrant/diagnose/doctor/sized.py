"""Examination of a case whose target is of another size than given: freed by the user, or found as poses are read.

A wrong size hides every other fault: the case is examined at the size that the robot's motion says.
"""

from __future__ import annotations

from dataclasses import replace

from calibrant.data import Measured
from calibrant.diagnose.doctor.evidence.case import Case
from calibrant.diagnose.doctor.evidence.finding import Finding
from calibrant.diagnose.doctor.evidence.significance import student_test
from calibrant.diagnose.doctor.faults.size import freed, ratio_text, sized
from calibrant.diagnose.doctor.search import Examination, examine

FREED = "target-scale"
"""The finding of a scale that was asked for."""


def examined_at_size(case: Case, scale: float, *, free: bool) -> Examination:
    """The examination of a case, `scale` the rough factor of its target; free: the user asked for it.

    Raises: RefusedError where a free scale cannot be told.
    """
    if not free and scale == 1:
        return examine(case)
    near, rest = freed(case.scaled(scale))
    found = Measured(scale * rest.value, scale * rest.sigma)
    if free:
        examined = examine(near)
        message = (
            f"the target's lengths are {ratio_text(found.value, found.sigma)} times those given, by the robot's motion"
        )
        finding = Finding(FREED, "ok", message, measured=found)
        return replace(examined, findings=(finding, *examined.findings))
    p = student_test(abs(found.value - 1), found.sigma, max(3 * len(case.index) - 7, 1))
    finding = sized(case, near, found, p)
    examined = examine(near if finding.repair is None or finding.measured is not None else finding.repair(case))
    return Examination((finding, *examined.findings), case, examined.repaired, case.loop, examined.after)
