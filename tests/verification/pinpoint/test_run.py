"""A pinpoint with a robot and a camera without physics: shown, asked, driven, measured; and all that may go wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.verification.pinpoint.cells import CAMERA, MARKER, TIP, X_HAND, DrawnCamera, PlainRobot, lying_marker

from calibrant.arrays import Array
from calibrant.errors import DeviceError, RefusedError
from calibrant.geometry import se3, so3
from calibrant.verification.pinpoint.run import Pinpoint, pinpoint
from calibrant.verification.touch.errors import Touch
from calibrant.verification.touch.table import Table
from calibrant.verification.unchanged.robot_noise import RobotSide

SIGMA = np.concatenate([np.full(3, 1e-3), np.full(3, 5e-4), np.zeros(6), np.full(4, 0.1)])


def side(X: Array = X_HAND) -> RobotSide:
    return RobotSide(True, X, np.eye(4), np.diag(SIGMA) ** 2, 1e-4, 1e-4, 0.0)


def task(T_base_marker: Array, *, X: Array = X_HAND, robot: PlainRobot | None = None) -> tuple[Pinpoint, DrawnCamera]:
    arm = robot or PlainRobot()
    source = DrawnCamera(arm, T_base_marker)
    return Pinpoint(arm, source, CAMERA, side(X), MARKER, TIP, lambda words: True, Table()), source


def done(job: Pinpoint, T_base_marker: Array) -> Touch:
    return pinpoint(job, "0", lambda: se3.inverse(T_base_marker) @ job.robot.pose() @ TIP)[0]


def test_the_tip_is_over_the_middle_with_a_right_calibration() -> None:
    T = lying_marker()
    touch = done(task(T)[0], T)
    assert np.linalg.norm(touch.error) < 3e-4  # 0.05 px at 0.4 m are 0.03 mm, along the line of sight ten times that
    assert touch.turn is not None
    assert np.linalg.norm(touch.turn) < np.deg2rad(0.3)
    assert touch.inside


def test_a_camera_that_is_off_is_off_at_the_tip_and_corrected_by_touches() -> None:
    from calibrant.verification.touch.errors import corrected, correction_of

    wrong = se3.retract(X_HAND, [0, 0, 0, 1.5e-3, -1e-3, 0])
    touches = []
    for i, (x, y) in enumerate([(0.4, 0.0), (0.5, 0.05), (0.45, -0.05), (0.47, 0.08)]):
        T = lying_marker(x, y, 0.2 * i)
        robot = PlainRobot(se3.make(np.diag([1.0, -1.0, -1.0]) @ so3.exp([0, 0, 0.5 * i]), [x, y, 0.42]))
        touches.append(done(task(T, X=wrong, robot=robot)[0], T))
    assert np.linalg.norm(touches[-1].error) == pytest.approx(1.8e-3, rel=0.3)
    after = corrected(touches[-1], correction_of(touches[:-1]))
    assert np.linalg.norm(after.error) < 0.5e-3


def test_the_coordinate_is_shown_and_without_a_yes_nothing_moves() -> None:
    T, said = lying_marker(), []
    job, _ = task(T)

    def no(words: str) -> bool:
        said.append(words)
        return False

    with pytest.raises(RefusedError, match="Not confirmed: the arm has not moved"):
        done(replace(job, confirm=no), T)
    assert "x 450." in said[0] or "x 449." in said[0]
    assert isinstance(job.robot, PlainRobot)
    assert job.robot.moved == []


def test_a_target_out_of_view_is_said_and_nothing_moves() -> None:
    T = lying_marker()
    job, source = task(T)
    source.hidden = True
    with pytest.raises(RefusedError, match=r"camera wrist does not see the target .* the robot has not moved"):
        done(job, T)


def test_a_height_that_the_table_contradicts_stops_the_arm_before_it_moves() -> None:
    T = lying_marker(z=-0.03)
    job, _ = task(T)
    with pytest.raises(RefusedError, match="mm below the table"):
        done(job, T)
    assert isinstance(job.robot, PlainRobot)
    assert job.robot.moved == []


def test_a_robot_that_stops_answering_is_stopped_and_named() -> None:
    T = lying_marker()
    job, _ = task(T, robot=PlainRobot(dies_after=1))
    with pytest.raises(DeviceError, match="does not answer"):
        done(job, T)
    assert isinstance(job.robot, PlainRobot)
    assert job.robot.stopped == 1
