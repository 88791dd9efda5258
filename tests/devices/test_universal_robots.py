"""A UR arm against a fake of ur-rtde's documented interface. Nothing here was run on hardware."""

from __future__ import annotations

import numpy as np
import pytest
from tests.devices.fake_clock import FakeClock, patched_clock
from tests.devices.fake_ur import TOOL, Controller, installed

from calibrant.data.devices import Robot
from calibrant.devices import open_devices
from calibrant.errors import DeviceError, InputError, RefusedError
from calibrant.geometry import se3, so3
from calibrant.robots.arms import arm


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> FakeClock:
    return patched_clock(monkeypatch)


@pytest.fixture
def controller(monkeypatch: pytest.MonkeyPatch, clock: FakeClock) -> Controller:
    return installed(monkeypatch, clock)


@pytest.fixture
def robot(controller: Controller) -> Robot:
    return open_devices(robot="ur:192.168.0.10").robot


def test_poses_are_of_the_flange_whatever_tool_is_set(controller: Controller, robot: Robot) -> None:
    assert not np.allclose(controller.tool(controller.q), controller.chain.forward(controller.q))
    assert np.allclose(robot.pose(), controller.chain.forward(controller.q), atol=1e-12)
    assert np.allclose(robot.forward(controller.q + 0.1), controller.chain.forward(controller.q + 0.1), atol=1e-12)
    assert robot.moves_matter


def test_named_arm_computes_forward_here(controller: Controller) -> None:
    robot = open_devices(robot="ur:192.168.0.10,arm=ur10e").robot
    assert np.allclose(robot.forward(controller.q), arm("ur10e").forward(controller.q), atol=1e-15)


def test_motions_end_where_they_are_asked_to(controller: Controller, robot: Robot) -> None:
    goal = controller.q + np.array([0.3, 0.1, -0.2, 0.1, 0.2, -0.4])
    robot.move_joints(goal)
    assert np.abs(robot.joints() - goal).max() < 1e-3
    T = se3.make(robot.pose()[:3, :3] @ so3.exp([0.1, 0.0, 0.2]), robot.pose()[:3, 3] + [0.05, -0.03, 0.02])
    robot.move_to(T)
    assert np.abs(se3.local(robot.pose(), T)).max() < 1e-3
    T[:3, 3] += [0.0, 0.04, -0.03]
    robot.move_line(T, speed=0.1)
    assert np.abs(se3.local(robot.pose(), T)).max() < 1e-3
    assert controller.sent[-1] == "moveL"


def test_drive_moves_the_flange_with_the_twist_until_the_next_call(clock: FakeClock, robot: Robot) -> None:
    before = robot.pose()
    twist = np.array([0.05, -0.1, 0.2, 0.02, -0.01, 0.03])
    robot.drive(twist, seconds=0.2)
    moved = robot.pose()
    assert np.allclose(moved[:3, 3] - before[:3, 3], 0.2 * twist[3:], atol=2e-5)
    assert np.allclose(so3.log(moved[:3, :3] @ before[:3, :3].T), 0.2 * twist[:3], atol=1e-5)
    clock.pass_time(0.1)
    assert np.allclose(robot.pose()[:3, 3] - before[:3, 3], 0.3 * twist[3:], atol=5e-5)
    robot.wait(0.1)
    still = robot.pose()
    clock.pass_time(0.5)
    assert np.array_equal(robot.pose(), still)


def test_tool_point_is_sent_the_velocity_of_the_flange(controller: Controller, robot: Robot) -> None:
    """Turning about the flange moves the tool point: v_tcp = v + omega x R t."""
    robot.drive(np.array([0.0, 0.0, 0.3, 0.0, 0.0, 0.0]), seconds=0.0)
    lever = robot.pose()[:3, :3] @ TOOL[:3, 3]
    assert controller.twist is not None
    assert np.allclose(controller.twist, [*np.cross([0, 0, 0.3], lever), 0, 0, 0.3], atol=1e-12)


def test_what_cannot_be_reached_is_refused_and_nothing_moves(controller: Controller, robot: Robot) -> None:
    before = controller.q.copy()
    far = robot.pose()
    far[:3, 3] *= 3
    for move in (robot.move_to, robot.move_line):
        with pytest.raises(RefusedError, match="nothing has moved"):
            move(far)
    with pytest.raises(RefusedError, match="nothing has moved"):
        robot.move_joints(np.full(6, 7.0))
    with pytest.raises(RefusedError, match="gripper"):
        robot.grip(0.05)
    with pytest.raises(InputError, match="speed"):
        robot.move_joints(before + 0.1, speed=2.0)
    assert np.array_equal(controller.q, before)
    assert not {"moveJ", "moveL"} & set(controller.sent)


@pytest.mark.parametrize(
    ("fault", "words"),
    [("protective", "protective stop"), ("emergency", "emergency stop"), ("connected", "connection is lost")],
)
def test_robot_that_stops_by_itself_is_said(
    clock: FakeClock, controller: Controller, robot: Robot, fault: str, words: str
) -> None:
    def break_it(seconds: float) -> None:
        if clock.now > 1_700_000_000.1:
            setattr(controller, fault, fault != "connected")

    clock.movers.append(break_it)
    with pytest.raises(DeviceError, match=words):
        robot.move_joints(controller.q + 0.8, speed=0.1)
    assert controller.way or not controller.connected or controller.sent[-1] == "stopJ"
    with pytest.raises(DeviceError):
        robot.drive(np.full(6, 0.1), seconds=0.1)
    robot.stop()


def test_arm_that_is_held_does_not_wait_for_ever(clock: FakeClock, controller: Controller, robot: Robot) -> None:
    controller.held = True
    began = clock.now
    with pytest.raises(DeviceError, match="stands still before its goal"):
        robot.move_joints(controller.q + 0.5)
    assert clock.now - began < 2.0
    assert controller.sent[-1] == "stopJ"


def test_local_control_is_said(controller: Controller, robot: Robot) -> None:
    controller.remote = False
    with pytest.raises(DeviceError, match="remote control"):
        robot.move_joints(controller.q + 0.1)


def test_interrupted_motion_stops_the_arm(clock: FakeClock, controller: Controller, robot: Robot) -> None:
    def interrupt(seconds: float) -> None:
        if clock.now > 1_700_000_000.2:
            clock.movers.remove(interrupt)
            raise KeyboardInterrupt

    clock.movers.append(interrupt)
    with pytest.raises(KeyboardInterrupt):
        robot.move_joints(controller.q + 1.0, speed=0.1)
    assert controller.sent[-1] == "stopJ"
    assert controller.way == []


def test_closing_ends_the_script_and_a_lost_arm_is_closed_in_silence(controller: Controller) -> None:
    with open_devices(robot="ur:192.168.0.10"):
        pass
    assert "stopScript" in controller.sent
    with open_devices(robot="ur:192.168.0.10") as devices:
        controller.connected = False
        devices.robot.stop()


def test_nobody_at_the_address(controller: Controller) -> None:
    with pytest.raises(DeviceError, match="answers at nobody"):
        open_devices(robot="ur:nobody")
    with pytest.raises(InputError, match=r"ur:192\.168\.0\.10"):
        open_devices(robot="ur")
