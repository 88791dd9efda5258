"""A Franka arm against a fake of panda-py's documented interface. Nothing here was run on hardware."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from tests.devices.fake_clock import FakeClock, patched_clock
from tests.devices.fake_panda import Controller, installed

from calibrant.data.devices import Robot
from calibrant.devices import open_devices
from calibrant.devices.franka import MOST_WAYPOINTS
from calibrant.errors import DeviceError, InputError, RefusedError
from calibrant.geometry import se3, so3


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> FakeClock:
    return patched_clock(monkeypatch)


@pytest.fixture
def controller(monkeypatch: pytest.MonkeyPatch, clock: FakeClock) -> Controller:
    return installed(monkeypatch, clock)


@pytest.fixture
def robot(controller: Controller) -> Robot:
    return open_devices(robot="panda:172.16.0.2").robot


def test_poses_are_of_the_flange_whatever_end_effector_is_set(controller: Controller, robot: Robot) -> None:
    assert np.allclose(robot.pose(), controller.chain.forward(controller.q), atol=1e-12)
    assert np.allclose(robot.forward(robot.joints()), robot.pose(), atol=1e-12)
    assert robot.moves_matter


def test_motions_end_where_they_are_asked_to(controller: Controller, robot: Robot) -> None:
    goal = controller.q + np.array([0.2, 0.1, -0.1, 0.2, 0.1, -0.3, 0.4])
    robot.move_joints(goal, speed=0.5)
    assert np.array_equal(robot.joints(), goal)
    assert controller.speeds == [0.5]
    T = se3.make(robot.pose()[:3, :3] @ so3.exp([0.1, 0.0, 0.2]), robot.pose()[:3, 3] + [0.05, -0.03, 0.02])
    robot.move_to(T)
    assert np.abs(se3.local(robot.pose(), T)).max() < 1e-8


def test_line_is_straight_between_its_waypoints_too(controller: Controller, robot: Robot) -> None:
    """panda-py goes from waypoint to waypoint evenly in the joints."""
    start = robot.pose()
    T = se3.make(start[:3, :3], start[:3, 3] + [0.1, -0.2, -0.2])
    length = float(np.linalg.norm(T[:3, 3] - start[:3, 3]))
    q = [robot.joints()]
    robot.move_line(T)
    assert np.abs(se3.local(robot.pose(), T)).max() < 1e-8
    q += controller.waypoints
    assert len(q) == MOST_WAYPOINTS + 1
    way = np.concatenate([np.linspace(a, b, 10) for a, b in pairwise(q)])
    p = controller.chain.forward(way)[:, :3, 3] - start[:3, 3]
    along = (T[:3, 3] - start[:3, 3]) / length
    aside = np.linalg.norm(p - np.outer(p @ along, along), axis=1)
    assert length == pytest.approx(0.3)
    assert aside.max() < 1e-3


def test_drive_moves_the_flange_with_the_twist(clock: FakeClock, controller: Controller, robot: Robot) -> None:
    before = robot.pose()
    twist = np.array([0.05, -0.1, 0.2, 0.02, -0.01, 0.03])
    robot.drive(twist, seconds=0.2)
    moved = robot.pose()
    assert np.allclose(moved[:3, 3] - before[:3, 3], 0.2 * twist[3:], atol=2e-4)
    assert np.allclose(so3.log(moved[:3, :3] @ before[:3, :3].T), 0.2 * twist[:3], atol=1e-3)
    first = controller.velocity
    robot.drive(0.5 * twist, seconds=0.1)
    assert controller.velocity is first, "the controller runs on between calls"
    robot.wait(0.1)
    assert controller.velocity is None
    still = robot.pose()
    clock.pass_time(0.5)
    assert np.array_equal(robot.pose(), still)


def test_twist_beyond_the_joints_speeds_is_slowed_down_as_a_whole(controller: Controller, robot: Robot) -> None:
    J = controller.chain.jacobian(controller.q)
    twist = np.array([0.0, 0.0, 0.0, 0.0, 5.0, 0.0])
    robot.drive(twist, seconds=0.0)
    assert controller.velocity is not None
    got = J @ controller.velocity.qd
    assert np.abs(controller.velocity.qd / robot.limits.speeds).max() == pytest.approx(1.0)
    assert got[4] > 0.5
    assert np.abs(np.delete(got, 4)).max() < 1e-4 * got[4]


def test_drive_ends_before_a_joints_range_does(controller: Controller, robot: Robot) -> None:
    with pytest.raises(RefusedError, match="end of its range"):
        robot.drive(np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]), seconds=20)
    assert controller.velocity is None
    assert controller.chain.within_limits(controller.q)


def test_what_cannot_be_reached_is_refused_and_nothing_moves(controller: Controller, robot: Robot) -> None:
    before = controller.q.copy()
    far = robot.pose()
    far[:3, 3] *= 3
    for move in (robot.move_to, robot.move_line):
        with pytest.raises(RefusedError, match="nothing has moved"):
            move(far)
    with pytest.raises(RefusedError, match="joint 4 would go to"):
        robot.move_joints(np.zeros(7))
    assert np.array_equal(controller.q, before)


def test_gripper_says_whether_it_holds(controller: Controller, robot: Robot) -> None:
    assert robot.grip(0.02) == robot.grip(0.02)
    assert not robot.grip(0.0).holds
    robot.grip(0.08)
    controller.object_m = 0.04
    held = robot.grip(0.02)
    assert held.holds
    assert held.width_m == pytest.approx(0.04)
    assert not robot.grip(0.08).holds
    with pytest.raises(InputError, match="80 mm"):
        robot.grip(0.2)
    with pytest.raises(RefusedError, match="gripper=no"):
        open_devices(robot="panda:172.16.0.2,gripper=no").robot.grip(0.02)


def test_errors_of_the_arm_are_device_errors(controller: Controller, robot: Robot) -> None:
    controller.held = True
    with pytest.raises(DeviceError, match="before its goal"):
        robot.move_joints(controller.q + 0.01)
    controller.error = "Move command aborted: motion aborted by reflex! [cartesian_reflex]"
    for act in (robot.joints, robot.pose, lambda: robot.drive(np.full(6, 0.01), seconds=0.1)):
        with pytest.raises(DeviceError, match="reflex"):
            act()
    robot.stop()


def test_nobody_at_the_address(controller: Controller) -> None:
    with pytest.raises(DeviceError, match="answers at nobody"):
        open_devices(robot="panda:nobody")
