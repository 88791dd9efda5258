"""The cell without pictures: the arm follows its twist, keeps its ranges, and fails when it is told to."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.cameras import Camera
from calibrant.errors import DeviceError, RefusedError
from calibrant.geometry import se3
from calibrant.robots.arms import arm
from calibrant.simulate.point_cell import KinematicArm, PointCamera, tilted

READY = np.array([0.2, -1.4, 1.6, -1.7, -1.55, 0.3])


def test_a_twist_moves_the_flange_along_the_bases_axes() -> None:
    robot = KinematicArm(arm("ur5e"), READY)
    before = robot.pose()
    robot.drive(np.array([0, 0, 0.2, 0.05, 0, 0.02]), seconds=0.5)
    moved = se3.local(before, robot.pose())
    np.testing.assert_allclose(moved, [0, 0, 0.1, 0.025, 0, 0.01], atol=2e-4)
    assert robot.time_s == pytest.approx(0.5)
    robot.pass_time(0.1)  # the twist goes on until the next call
    assert se3.local(before, robot.pose())[3] == pytest.approx(0.03, abs=2e-4)
    robot.stop()
    there = robot.pose()
    robot.wait(0.2)
    np.testing.assert_array_equal(there, robot.pose())


def test_it_refuses_what_it_cannot_reach_and_stops_answering_when_told() -> None:
    robot = KinematicArm(arm("ur5e"), READY, fails_at=5.0)
    with pytest.raises(RefusedError, match="does not reach"):
        robot.move_to(se3.make(np.eye(3), [3.0, 0, 0]))
    robot.pass_time(6.0)
    with pytest.raises(DeviceError):
        robot.joints()


def test_a_picture_shows_all_points_or_none_and_says_when() -> None:
    robot = KinematicArm(arm("ur5e"), READY)
    camera = Camera.create("pinhole", {"fx": 600, "fy": 600, "cx": 320, "cy": 240}, image_size=(640, 480))
    points = np.array([[0.0, 0, 0], [0.05, 0, 0]])
    rng = np.random.default_rng(0)
    source = PointCamera(robot, camera, points, lambda: np.eye(4), lambda t: se3.make(np.eye(3), [t, 0, 0.5]), rng,
                         sigma_px=0.0, take_s=0.1, latency_s=0.03)  # fmt: skip
    first = source.take()
    np.testing.assert_allclose(source.pixels(first), [[320, 240], [380, 240]])
    assert first.time_s == pytest.approx(0.03)
    robot.pass_time(0.3)
    assert source.pixels(source.take()) is None  # 0.4 m to the right: out of the picture


def test_tilted_is_exactly_so_far() -> None:
    mm, deg = se3.deviation(np.eye(4), tilted(np.eye(4), np.random.default_rng(1), metres=0.2, degrees=30.0))
    assert (float(mm), float(deg)) == pytest.approx((200.0, 30.0))
