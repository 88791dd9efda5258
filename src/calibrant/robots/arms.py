"""Arms by name, with the figures that their makers publish. Adding one is an entry here."""

from __future__ import annotations

import numpy as np

from calibrant.errors import InputError
from calibrant.robots.chain import Joint, KinematicChain
from calibrant.robots.dh import DHRow, ModifiedDH, StandardDH

_UR_JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")


def _universal_robots(a: tuple[float, float], d: tuple[float, float, float, float]) -> StandardDH:
    """The family's common table: upper arm and forearm a2, a3; base height d1 and wrist offsets d4, d5, d6, metres.

    Source: Universal Robots, "DH parameters for calculations of kinematics and dynamics" (support article); joint range
    of 360 degrees to either side from the arms' data sheets.
    """
    right = np.pi / 2
    rows = (
        DHRow(0.0, right, d[0]),
        DHRow(a[0], 0.0, 0.0),
        DHRow(a[1], 0.0, 0.0),
        DHRow(0.0, right, d[1]),
        DHRow(0.0, -right, d[2]),
        DHRow(0.0, 0.0, d[3]),
    )
    return StandardDH(rows, tuple(Joint(name, -2 * np.pi, 2 * np.pi) for name in _UR_JOINTS))


def _franka() -> ModifiedDH:
    """The arm of Franka Emika (Panda); the flange lies 107 mm beyond the last joint.

    Source: Franka Control Interface, "Robot and interface specifications": Denavit-Hartenberg parameters after Craig
    and joint limits.
    """
    right = np.pi / 2
    rows = (
        DHRow(0.0, 0.0, 0.333),
        DHRow(0.0, -right, 0.0),
        DHRow(0.0, right, 0.316),
        DHRow(0.0825, right, 0.0),
        DHRow(-0.0825, -right, 0.384),
        DHRow(0.0, right, 0.0),
        DHRow(0.088, right, 0.107),
    )
    ranges = (
        (-2.8973, 2.8973),
        (-1.7628, 1.7628),
        (-2.8973, 2.8973),
        (-3.0718, -0.0698),
        (-2.8973, 2.8973),
        (-0.0175, 3.7525),
        (-2.8973, 2.8973),
    )
    return ModifiedDH(rows, tuple(Joint(f"joint{i + 1}", *between) for i, between in enumerate(ranges)))


ARMS: dict[str, KinematicChain] = {
    "ur3e": _universal_robots((-0.24355, -0.2132), (0.15185, 0.13105, 0.08535, 0.0921)),
    "ur5e": _universal_robots((-0.425, -0.3922), (0.1625, 0.1333, 0.0997, 0.0996)),
    "ur10e": _universal_robots((-0.6127, -0.57155), (0.1807, 0.17415, 0.11985, 0.11655)),
    "panda": _franka(),
}


def arm(name: str) -> KinematicChain:
    """The arm of that name. Raises: InputError listing the known ones."""
    if name not in ARMS:
        raise InputError(f"unknown arm {name!r}; known arms: {', '.join(ARMS)}")
    return ARMS[name]
