"""Robot poses and target poses in each other's place: the loop closes either way, only plain sense can tell.

A_i X B_i = Z gives B_i^-1 X^-1 A_i^-1 = Z^-1, the same equation with the roles exchanged. But a camera sees what is in
front of it (z > 0) and inside its field of view; the poses of a gripper in its base obey no such rule.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.diagnose.doctor.evidence.case import Case
from calibrant.diagnose.doctor.evidence.finding import Finding
from calibrant.diagnose.doctor.evidence.loop import Evidence
from calibrant.diagnose.doctor.evidence.significance import confidence
from calibrant.geometry import se3

HALF_FIELD = np.deg2rad(45)
"""A target stands within 45 degrees of the axis, its origin included, with any but a fisheye lens."""
CONE = 0.5 * (1 - np.cos(HALF_FIELD))
"""Share of the sphere within that."""
SEEN = 0.9
DOUBTED = 0.8
NOT_SEEN = 0.5
"""Shares of poses that lie within that: nearly all of them should. A wide lens sees some origins, the boards' corners,
farther off its axis, so that a fifth elsewhere raise a doubt, and only most of them elsewhere a verdict."""


def visible(B: Array) -> NDArray[np.bool_]:
    """Target poses (n, 4, 4) that a camera could see: in front of it and near its axis."""
    t = B[:, :3, 3]
    return np.asarray(t[:, 2] > np.cos(HALF_FIELD) * np.linalg.norm(t, axis=1))


def look_inverted(robot: Array, B: Array) -> bool:
    """True for target poses B that no camera sees, while it would see their inverses, and not the robot poses instead.

    T_target_camera in the other setup closes the loop just as well (B^-1 for B exchanges X and Z): only sense can tell.
    """
    return bool(
        visible(B).mean() < NOT_SEEN and visible(se3.inverse(B)).mean() >= SEEN and visible(robot).mean() < SEEN
    )


def examine(case: Case) -> list[Finding]:
    """Would the robot poses pass for what a camera sees, and the target poses not?"""
    if case.data.views is not None:
        return []
    as_given, other = visible(case.B), visible(case.data.T_base_gripper[case.index])
    if as_given.mean() >= DOUBTED or other.mean() < SEEN:
        return []
    n = len(as_given)
    counts = (
        f"{int(as_given.sum())} of the {n} target poses lie in front of a camera, {int(other.sum())} of the robot "
        f"poses do; the loop closes either way ({case.loop.text})"
    )
    # Each pose lies in the cone by chance with its share of the sphere, (1 - cos 45 deg) / 2 = 0.15.
    sure = confidence(CONE ** int(other.sum() - as_given.sum()))
    if as_given.mean() >= NOT_SEEN:
        message = f"robot poses and target poses may be exchanged, unless the lens is a wide one: {counts}"
        return [Finding("poses-exchanged", "warn", message, sure)]
    return [
        Finding(
            "poses-exchanged",
            "fail",
            f"robot poses and target poses are exchanged: {counts}",
            sure,
            Evidence(case.loop, case.loop),
            proposal="give each file to the other option",
            repair=Case.exchanged,
            gain=float(other.sum() - as_given.sum()) * float(-np.log(CONE)),
        )
    ]
