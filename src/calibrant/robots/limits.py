"""Joint values against the limits of a robot: named, never clipped in silence."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from calibrant.errors import InputError
from calibrant.robots.chain import KinematicChain

LIMIT_SLACK = 1e-3
"""Radians or metres by which a reading may pass a limit: controllers stop a little beyond."""


def check_limits(chain: KinematicChain, q: ArrayLike, places: Sequence[str]) -> None:
    """Refuse joint values q (n, k) beyond the limits.

    Raises: InputError for a wrong number of joints, or naming the first place, the joint, its value and its limits.
    """
    values = chain.check(q)
    beyond = (values < chain.lower - LIMIT_SLACK) | (values > chain.upper + LIMIT_SLACK)
    if not beyond.any():
        return
    i, k = (int(v) for v in np.argwhere(beyond)[0])
    joint = chain.joints[k]
    unit, factor = ("deg", 180 / np.pi) if joint.kind == "revolute" else ("mm", 1e3)
    count = int(beyond.any(axis=1).sum())
    raise InputError(
        f"{places[i]}: joint {joint.name} is at {values[i, k] * factor:.6g} {unit}, beyond its limits "
        f"{joint.lower * factor:.6g} to {joint.upper * factor:.6g} {unit} ({count} of {len(values)} rows); check the "
        "unit (--joint-angle deg) and the order of the joints, or the limits in the robot's file"
    )
