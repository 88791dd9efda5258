"""One pinpoint: look, say where, ask, drive the tip there, and measure how far off it is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.data.devices import CameraSource, Robot
from calibrant.errors import CalibrantError, RefusedError
from calibrant.geometry import so3
from calibrant.targets.target import Target
from calibrant.verification.pinpoint.goal import coordinate_words, goal_above
from calibrant.verification.pinpoint.look import PICTURES, look, marker_pose
from calibrant.verification.touch.errors import Touch
from calibrant.verification.touch.placing import Placing, placed_in_base, touch_of
from calibrant.verification.touch.table import Table, check_height, lying_on
from calibrant.verification.unchanged.robot_noise import RobotSide

APPROACH_M = 0.08
"""Above the point, from where the tip goes down along a line: clear of a cube, and short."""
SPEEDS = (0.3, 0.1)
"""Shares of the robot's speed: to the place above, and down."""
HOVER_M = 0.005
"""What the tip stays above the marker, so that an error of some millimetres does not drive it into the table."""


@dataclass(frozen=True, eq=False)
class Pinpoint:
    """What a pinpoint needs. side: the calibration's (its X is the camera that is believed); T_gripper_tip: its z
    points out of the tool; confirm: asked with the coordinate in words before the arm moves; table: None where
    nothing is known of it; sigma, sigma_turn: of the measurement, metres and radians."""

    robot: Robot
    source: CameraSource
    camera: Camera
    side: RobotSide
    target: Target
    T_gripper_tip: Array
    confirm: Callable[[str], bool]
    table: Table | None = None
    hover: float = HOVER_M
    pictures: int = PICTURES
    speeds: tuple[float, float] = SPEEDS
    sigma: float = 0.0
    sigma_turn: float = 0.0

    @property
    def middle(self) -> Array:
        """The target's middle (3,), its own frame."""
        points = self.target.points
        return np.asarray(0.5 * (points.min(axis=0) + points.max(axis=0)))


def see(task: Pinpoint, name: str) -> Placing:
    """Where the camera says that the target is. Raises: RefusedError as `look`, and for a height that cannot be."""
    seen = look(task.source, task.target, pictures=task.pictures)
    T_base_gripper = task.robot.pose() if task.side.in_hand else None
    R = task.side.X[:3, :3] if T_base_gripper is None else T_base_gripper[:3, :3] @ task.side.X[:3, :3]
    placed = marker_pose(task.camera, seen.view, R)
    placing = replace(placed_in_base(task.camera, task.side, placed, T_base_gripper), name=name)
    if task.table is None:
        return placing
    check_height(placing, task.middle, task.table, camera=task.source.name)
    return lying_on(placing, task.table)


def drive(
    robot: Robot, T_base_gripper: Array, *, approach: float = APPROACH_M, speeds: tuple[float, float] = SPEEDS
) -> None:
    """Above the goal, then down along a line. Raises: as the robot; it stands still then."""
    above = T_base_gripper.copy()
    above[2, 3] += approach
    try:
        robot.move_to(above, speed=speeds[0])
        robot.move_line(T_base_gripper, speed=speeds[1])
    except CalibrantError:
        robot.stop()
        raise


def pinpoint(task: Pinpoint, name: str, measure: Callable[[], Array]) -> tuple[Touch, Placing]:
    """The whole of it. Args: measure, T_target_tip (4, 4) as it was measured when the arm stands.

    Raises: RefusedError where it is not confirmed, or as `see`; DeviceError when the robot stops answering.
    """
    placing = see(task, name)
    said = f"{coordinate_words(placing, task.middle)}; the tip goes {1e3 * task.hover:.0f} mm above it"
    if not task.confirm(said):
        raise RefusedError(f"{said}. Not confirmed: the arm has not moved")
    now = task.robot.pose()[:3, :3]
    goal, wanted = goal_above(placing.T_base_target, task.middle, task.T_gripper_tip, now, hover=task.hover)
    drive(task.robot, goal, speeds=task.speeds)
    return measured_touch(task, placing, goal, wanted, measure()), placing


def measured_touch(task: Pinpoint, placing: Placing, goal: Array, wanted: Array, found: Array) -> Touch:
    """The touch from T_target_tip as it was wanted and as it was found."""
    R = placing.T_base_target[:3, :3]
    off = R @ (found[:3, 3] - wanted[:3, 3])
    turn = R @ so3.log(found[:3, :3] @ wanted[:3, :3].T)
    said, _ = placing.at(task.middle)
    return touch_of(
        placing,
        task.side,
        task.middle,
        touched=said - off,
        tip=task.T_gripper_tip[:3, 3],
        T_base_gripper=goal,
        sigma=task.sigma,
        turn=turn,
        sigma_turn=task.sigma_turn,
    )
