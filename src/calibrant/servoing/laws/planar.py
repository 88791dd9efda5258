"""The lecture's planar case: x, y and the turn about the approach axis, the other three held as they are.

The target position is taught off-line, from stereo or from one picture of the hand camera; what differs on-line is
corrected in the plane across the approach axis (the gripper's z). It is image-based control whose twists are those of
that plane, so a camera that looks along another direction than the approach axis does not mislead it:

    xi = S zeta,   zeta = (turn about a, shift along a1, shift along a2),   zeta = -gain (L S)+ (s - s*)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array
from calibrant.servoing.laws.image_based import image_pull
from calibrant.servoing.laws.law import Pull
from calibrant.servoing.sight.features import Features


@dataclass(frozen=True)
class Planar:
    """Two features are enough: a place and a direction."""

    name: str = "planar"
    least: int = 2
    model: bool = False

    def subspace(self, R_camera_gripper: Array) -> Array:
        """The turn about the gripper's z, the shifts along its x and y."""
        S = np.zeros((6, 3))
        S[:3, 0] = R_camera_gripper[:, 2]
        S[3:, 1:] = R_camera_gripper[:, :2]
        return S

    def pull(self, seen: Features, wanted: Features, R_camera_gripper: Array) -> Pull:
        """See the module."""
        return image_pull(seen, wanted, self.subspace(R_camera_gripper))
