"""What is true in a cell, beside what its devices say."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.errors import InputError
from calibrant.geometry import se3
from calibrant.robots.links import LinkChain

if TYPE_CHECKING:
    from collections.abc import Mapping

    from calibrant.simulate.robot_cell.arm.robot import SimulatedRobot
    from calibrant.simulate.robot_cell.pictures.camera import SimulatedCamera
    from calibrant.simulate.robot_cell.world.physics import World


class CellTruth:
    """Everything as it is now: a camera that was pushed is where it was pushed to.

    "gripper" is the flange, as for `Robot.pose`. Lengths in metres.
    """

    def __init__(
        self,
        world: World,
        cameras: Mapping[str, SimulatedCamera],
        robot: SimulatedRobot,
        chain: LinkChain,
        T_gripper_stick_board: Array,
    ) -> None:
        self._world, self._cameras, self._robot = world, cameras, robot
        self.chain = chain
        """The arm as it was built: T_base_gripper = chain.forward(encoders + play)."""
        self.T_gripper_stick_board = T_gripper_stick_board
        """Of the stick's board, whose frame is the target's."""

    def camera(self, name: str) -> Camera:
        """True intrinsics of a camera's colour picture."""
        return self._camera(name).true.colour

    def depth_camera(self, name: str) -> Camera:
        """True intrinsics of its depth picture."""
        return self._camera(name).true.depth

    def T_colour_depth(self, name: str) -> Array:
        """From the depth camera's frame to the colour camera's."""
        return self._camera(name).true.T_colour_depth

    def depth_offset_px(self, name: str) -> float:
        """Constant error of a depth camera's disparity."""
        return self._camera(name).true.offset_px

    def T_gripper_camera(self, name: str) -> Array:
        """Of a camera on the flange. Raises: InputError for one that stands."""
        camera = self._camera(name)
        if camera.parent != "gripper":
            raise InputError(f"camera {name} is not on the gripper; ask T_base_camera")
        return camera.T_parent_camera

    def T_base_camera(self, name: str) -> Array:
        """Of any camera, now."""
        return self._camera(name).T_base_camera()

    def T_base_object(self, name: str) -> Array:
        """Of a thing, now: a box's frame is in its middle, a sheet's is its target's. Raises: InputError when it is
        away."""
        if not self._world.is_present(name):
            raise InputError(f"{name!r} is not in the cell now; place it first")
        return self._world.pose(name)

    def T_base_gripper(self) -> Array:
        """The true flange, now; the controller's is `robot.pose()`."""
        return self._world.pose("flange")

    @property
    def T_gripper_tip(self) -> Array:
        """Of the tip: the middle between the fingers' ends, or the pen's point; axes as the flange's."""
        T = np.eye(4)
        T[2, 3] = self._robot.workspace.tip_m
        return T

    def T_base_tip(self) -> Array:
        """The true tip, now."""
        return self.T_base_gripper() @ self.T_gripper_tip

    def T_camera_object(self, camera: str, name: str) -> Array:
        """A thing as a camera has it before it, now."""
        return se3.inverse(self.T_base_camera(camera)) @ self.T_base_object(name)

    def _camera(self, name: str) -> SimulatedCamera:
        if name not in self._cameras:
            raise InputError(f"the cell has no camera {name!r}; it has {', '.join(self._cameras)}")
        return self._cameras[name]
