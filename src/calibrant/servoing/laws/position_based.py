"""Position-based control: the camera's pose to the target, and a straight way to where it is wanted.

    e = (log R, t) of T_wanted_camera,   J = [[J_l^-T(log R), 0], [0, R]]

(Wilson, Hulls and Bell 1996; Chaumette and Hutchinson 2006, eq. 15.) Its figures are metres and radians; turns are
weighted by the distance of the target, over which they move it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.servoing.laws.law import ALL, Pull
from calibrant.servoing.sight.features import Features
from calibrant.servoing.sight.interaction import shift_rows, turn_rows


@dataclass(frozen=True)
class PositionBased:
    """A target whose points are known."""

    name: str = "position"
    least: int = 4
    model: bool = True

    def subspace(self, R_camera_gripper: Array) -> Array:
        """All twists."""
        return ALL

    def pull(self, seen: Features, wanted: Features, R_camera_gripper: Array) -> Pull:
        """See the module. Raises: InputError for features without a pose."""
        T = wanted_from_camera(seen, wanted)
        turn, shift = wanted.middle_depth * so3.log(T[:3, :3]), T[:3, 3]
        J = np.concatenate([wanted.middle_depth * turn_rows(T[:3, :3]), shift_rows(T[:3, :3])])
        return Pull(np.concatenate([turn, shift]), J, ALL)


def wanted_from_camera(seen: Features, wanted: Features) -> Array:
    """T_wanted_camera (4, 4). Raises: InputError for features without a pose."""
    if seen.T_camera_target is None or wanted.T_camera_target is None:
        raise InputError(
            "this control law needs the target's pose, and its points are not known in metres: teach by a target of "
            "known size, or use --control image or planar"
        )
    return wanted.T_camera_target @ se3.inverse(seen.T_camera_target)
