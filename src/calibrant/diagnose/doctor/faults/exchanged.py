"""Robot poses and target poses in each other's place: the loop closes either way, only plain sense can tell.

A_i X B_i = Z gives B_i^-1 X^-1 A_i^-1 = Z^-1, the same equation with the roles exchanged. But a camera sees what is in
front of it (z > 0) and inside its field of view; the poses of a gripper in its base obey no such rule. The poses of one
arm stand together, in one place of its room: they are one draw, however many, and so this is a question to a person.
"""

from __future__ import annotations

from calibrant.diagnose.doctor.evidence.case import Case
from calibrant.diagnose.doctor.evidence.finding import Finding
from calibrant.diagnose.doctor.evidence.significance import confidence
from calibrant.diagnose.doctor.evidence.target_frame import CONE, NOT_SEEN, SEEN, is_track, other_axis, visible

DOUBTED = 0.8
"""Share of target poses near the axis below which a doubt is raised: a wide lens sees some origins farther off."""


def examine(case: Case) -> list[Finding]:
    """Would the robot poses pass for what a camera sees, and the target poses not?"""
    if case.data.views is not None or is_track(case.B):
        return []
    as_given, other = visible(case.B), visible(case.data.T_base_gripper[case.index])
    if as_given.mean() >= DOUBTED or other.mean() < SEEN:
        return []
    if as_given.mean() >= NOT_SEEN:
        reason = "unless the lens is a wide one"
    else:
        axis = other_axis(case.B)
        reason = f"unless the camera's frame has {axis} ahead in place of z" if axis else "unless z is not ahead"
    message = (
        f"are robot poses and target poses exchanged ({reason})? {int(as_given.sum())} of the {len(as_given)} target "
        f"poses lie in front of a camera, {int(other.sum())} of the robot poses do, and the loop closes either way "
        f"({case.loop.text}); they are taken as given: where they are exchanged, give each file to the other option"
    )
    # An arm's poses lie in the cone by chance with its share of the sphere, (1 - cos 45 deg) / 2 = 0.15, all together.
    return [Finding("poses-exchanged", "warn", message, confidence(CONE))]
