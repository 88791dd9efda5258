"""A robot and a camera without physics: the robot goes where it is told, the camera draws what is before it."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.data.devices import DeviceCalibration, GripperState, Picture, RobotLimits
from calibrant.errors import DeviceError
from calibrant.geometry import se3, so3
from calibrant.simulate.render import Look, render
from calibrant.targets.registry import parse_target

CAMERA = Camera.create("pinhole", {"fx": 600.0, "fy": 600.0, "cx": 319.5, "cy": 239.5}, image_size=(640, 480))
MARKER = parse_target("marker:100mm:DICT_APRILTAG_36h11:10")
TIP = se3.make(np.eye(3), [0.0, 0.0, 0.12])
X_HAND = se3.make(so3.exp([0, 0, np.pi / 2]), [0.05, -0.03, 0.06])


@dataclass
class PlainRobot:
    """It stands where it was sent. dies_after: motions until it no longer answers."""

    T: Array = field(default_factory=lambda: se3.make(np.diag([1.0, -1.0, -1.0]), [0.45, 0.0, 0.45]))
    dies_after: int = 1000
    moved: list[Array] = field(default_factory=list)
    stopped: int = 0
    name: str = "plain"
    moves_matter: bool = False
    time_s: float = 0.0
    limits: RobotLimits = field(default_factory=lambda: RobotLimits(np.zeros((0, 2)), np.zeros(0)))

    def joints(self) -> Array:
        return np.zeros(0)

    def pose(self) -> Array:
        return self.T.copy()

    def forward(self, joints: Array) -> Array:
        return self.T.copy()

    def move_joints(self, joints: Array, *, speed: float = 0.3) -> None:
        raise NotImplementedError

    def move_to(self, T_base_gripper: Array, *, speed: float = 0.3) -> None:
        if len(self.moved) >= self.dies_after:
            raise DeviceError("the robot does not answer any more: no word from it for 2 s; look at its panel")
        self.moved.append(np.array(T_base_gripper))
        self.T = np.array(T_base_gripper)

    def move_line(self, T_base_gripper: Array, *, speed: float = 0.3) -> None:
        self.move_to(T_base_gripper, speed=speed)

    def drive(self, twist: Array, *, seconds: float) -> None:
        raise NotImplementedError

    def grip(self, width_m: float) -> GripperState:
        return GripperState(width_m, holds=False)

    def wait(self, seconds: float) -> None:
        self.time_s += seconds

    def stop(self) -> None:
        self.stopped += 1


@dataclass
class DrawnCamera:
    """On the robot's hand: it draws the marker; hidden: it draws nothing of it."""

    robot: PlainRobot
    T_base_marker: Array
    hidden: bool = False
    name: str = "wrist"
    stated: DeviceCalibration = field(default_factory=DeviceCalibration)
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))
    count: int = 0

    def take(self) -> Picture:
        self.count += 1
        T = se3.inverse(self.robot.T @ X_HAND) @ self.T_base_marker
        grey = np.full((480, 640), 128, np.uint8)
        if not self.hidden:
            grey = render(MARKER.artwork(), CAMERA, T, rng=self.rng, look=Look(clutter=0, noise_grey=2.0))
        return Picture(f"{self.count}", cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR), 0.0)

    def close(self) -> None:
        pass


def lying_marker(x: float = 0.45, y: float = 0.05, yaw: float = 0.3, z: float = 0.0) -> Array:
    """T_base_target of a marker on the table, its own z up or down as its artwork has it."""
    facing = np.diag([1.0, -1.0, -1.0])
    return se3.make(so3.exp([0, 0, yaw]) @ facing, [x, y, z])
