"""The two setups and the normal form A_i X B_i = Z that turns both into one problem.

    eye-in-hand  A_i = T_base_gripper_i,       X = T_gripper_camera,  Z = T_base_target
    eye-to-hand  A_i = T_base_gripper_i^-1,    X = T_base_camera,     Z = T_gripper_target

with B_i = T_camera_target_i. (Documents 002, P1, and 003, E8 and E9.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.calibrate.reprojection.links import Link
from calibrant.errors import InputError
from calibrant.geometry import se3


@dataclass(frozen=True)
class Setup:
    """Where the camera is: X = T_camera_parent_camera, Z = T_target_parent_target; A is inverted for eye-to-hand."""

    name: str
    camera_parent: str
    target_parent: str
    robot_inverted: bool

    @property
    def camera_transform(self) -> str:
        return f"T_{self.camera_parent}_camera"

    @property
    def target_transform(self) -> str:
        return f"T_{self.target_parent}_target"

    @property
    def description(self) -> str:
        """The setup in words."""
        carried, fixed = ("camera", "target") if self.camera_parent == "gripper" else ("target", "camera")
        return f"{self.name} (the robot carries the {carried}, the {fixed} stands still)"

    def normal_form(self, T_base_gripper: Array) -> Array:
        """A_i (n, 4, 4)."""
        return se3.inverse(T_base_gripper) if self.robot_inverted else np.asarray(T_base_gripper)

    def links(self, robot: NDArray[np.int64]) -> list[Link]:
        """T_camera_target = X^-1 A_i^-1 Z as links; robot (m,) is the pose that each view uses."""
        once = np.zeros(len(robot), dtype=np.int64)
        return [
            Link(self.camera_transform, once, inverted=True),
            Link("T_base_gripper", robot, inverted=not self.robot_inverted),
            Link(self.target_transform, once),
        ]


SETUPS: dict[str, Setup] = {
    s.name: s
    for s in (
        Setup("eye-in-hand", "gripper", "base", robot_inverted=False),
        Setup("eye-to-hand", "base", "gripper", robot_inverted=True),
    )
}


def get_setup(name: str) -> Setup:
    """The setup of that name. Raises: InputError listing both."""
    if name not in SETUPS:
        raise InputError(f"unknown setup {name!r}; choose {' or '.join(SETUPS)}")
    return SETUPS[name]
