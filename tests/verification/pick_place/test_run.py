"""Picking and placing with a robot without physics: where it goes, and what it says where it fails."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from tests.verification.pinpoint.cells import CAMERA, DrawnCamera, PlainRobot

from calibrant.arrays import Array
from calibrant.data.devices import GripperState
from calibrant.errors import DeviceError, RefusedError
from calibrant.geometry import se3, so3
from calibrant.perceive.colour.ranges import ColourRange
from calibrant.perceive.registered_depth.noise import D435
from calibrant.perceive.registered_depth.register import DepthRig
from calibrant.verification.pick_place.cubes import Cube, Eye, half_added, yaw_of
from calibrant.verification.pick_place.run import Seen, Task, judged, pick_and_place
from calibrant.verification.touch.table import Table
from calibrant.verification.unchanged.robot_noise import RobotSide

SIDE = 0.04
GRASP = se3.make(np.eye(3), [0.0, 0.0, 0.101])
KNOWN = 1e-6 * np.eye(3)


@dataclass
class Hand(PlainRobot):
    """It holds a cube whose middle is between its pads, within a finger's width."""

    cube: tuple[float, float, float] = (0.5, 0.0, 0.02)
    lost: bool = False

    def grip(self, width_m: float) -> GripperState:
        near = float(np.linalg.norm((self.T @ GRASP)[:3, 3] - self.cube)) < 0.015
        lifted = float((self.T @ GRASP)[2, 3]) > 0.08
        return GripperState(width_m, width_m < SIDE and (near or (lifted and not self.lost)))


def task(robot: PlainRobot) -> Task:
    side = RobotSide(False, se3.make(so3.exp([np.pi, 0, 0]), [0.5, 0, 1.0]), np.eye(4), np.zeros((16, 16)), 0, 0, 0)
    source = DrawnCamera(robot, np.eye(4))
    red, blue = ColourRange.parse("h:340-20"), ColourRange.parse("h:200-250")
    rig = DepthRig.aligned(CAMERA)
    return Task(robot, source, CAMERA, rig, D435, side, SIDE, red, blue, GRASP, lambda words: True, Table())


def cubes(z: float = 0.02) -> Seen:
    return Seen(Cube(np.array([0.5, 0.0, z]), 0.3, KNOWN), Cube(np.array([0.5, 0.15, 0.02]), -0.2, KNOWN))


def test_the_cube_is_set_a_side_above_the_other_one() -> None:
    robot = Hand()
    assert pick_and_place(task(robot), cubes()) == ""
    down, release = robot.moved[1] @ GRASP, robot.moved[4] @ GRASP
    assert down[:3, 3] == pytest.approx([0.5, 0.0, 0.02])
    assert release[:3, 3] == pytest.approx([0.5, 0.15, 0.061])
    assert yaw_of(down[:3, :3]) == pytest.approx(0.3)
    assert yaw_of(release[:3, :3]) == pytest.approx(-0.2)


@pytest.mark.parametrize(
    ("robot", "seen", "reason"),
    [
        (Hand(cube=(0.53, 0.0, 0.02)), cubes(), "nothing between the fingers"),
        (Hand(lost=True), cubes(), "slipped out"),
        (Hand(), cubes(z=-0.03), "no depth on it: its point is 30 mm inside the table"),
        (Hand(), cubes(z=0.04), "off where a cube on the table has it"),
        (Hand(), Seen(None, None, "no depth on the cube"), "no depth on the cube"),
    ],
)
def test_failures_are_told_by_their_reason(robot: Hand, seen: Seen, reason: str) -> None:
    assert reason in pick_and_place(task(robot), seen)


def test_without_a_yes_nothing_moves() -> None:
    robot = Hand()
    with pytest.raises(RefusedError, match="Not confirmed"):
        pick_and_place(replace(task(robot), confirm=lambda words: False), cubes())
    assert robot.moved == []


def test_a_robot_that_stops_answering_is_stopped() -> None:
    robot = Hand(dies_after=2)
    with pytest.raises(DeviceError, match="does not answer"):
        pick_and_place(task(robot), cubes())
    assert robot.stopped == 1


def test_where_the_cube_lies_is_judged() -> None:
    assert judged("", np.array([0.003, 0.0, 0.001]), SIDE) == ""
    assert "not on the other cube" in judged("", np.array([0.1, 0.0, -0.04]), SIDE)
    assert "hangs over" in judged("", np.array([0.025, 0.0, 0.0]), SIDE)
    assert judged("slipped", np.zeros(3), SIDE) == "slipped"


def test_half_a_side_is_added_along_the_line_of_sight() -> None:
    T: Array = se3.make(np.eye(3), [0.0, 0.0, 1.0])
    eye = Eye(CAMERA, DepthRig.aligned(CAMERA), D435, task(Hand()).side, T, SIDE)
    moved = half_added(eye, Cube(np.array([0.0, 0.0, 0.04]), None))
    assert moved.centre == pytest.approx([0.0, 0.0, 0.02])


def test_a_cubes_yaw_is_the_same_for_all_its_faces() -> None:
    for R in (np.eye(3), so3.exp([np.pi / 2, 0, 0]), so3.exp([0, np.pi / 2, 0]), so3.exp([0, 0, np.pi / 2])):
        assert yaw_of(so3.exp([0, 0, 0.2]) @ R) == pytest.approx(0.2)
