"""The servo loop in a cell without pictures: it arrives, it tells how well, and it says why it does not."""

from __future__ import annotations

import numpy as np
import pytest
from tests.servoing.cells import CAMERA, Cell, make_cell

from calibrant.cameras import Camera
from calibrant.errors import DeviceError, InputError, RefusedError
from calibrant.geometry import se3, so3
from calibrant.servoing.laws.registry import LAWS
from calibrant.servoing.loop import ServoOptions, servo
from calibrant.servoing.sight.mounting import Setup
from calibrant.servoing.stability import turned

QUIET = 0.02


def in_plane(cell: Cell) -> None:
    assert cell.place(cell.T_wanted @ se3.make(so3.exp([0, 0, 0.15]), [0.02, -0.015, 0.0]))


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
@pytest.mark.parametrize("name", LAWS)
def test_it_arrives_where_it_was_taught(name: str, setup: Setup) -> None:
    cell = make_cell(3, setup=setup, sigma_px=QUIET)
    eye = cell.eye()
    wanted = cell.taught(eye)
    if name == "planar":
        in_plane(cell)
    else:
        cell.start(np.random.default_rng(5), metres=0.15, degrees=25)
    run = servo(cell.robot, eye, wanted, LAWS[name])
    mm, deg = cell.off()
    assert mm < 0.3
    assert deg < 0.1
    assert not cell.robot.twist.any()
    assert run.last.within_99_mm <= 0.3
    assert run.samples[-1].resting
    assert run.pictures >= len(run.samples)


def test_a_wrong_calibration_changes_the_way_and_not_where_it_ends() -> None:
    cell = make_cell(4, sigma_px=QUIET)
    wrong = Camera.create("pinhole", CAMERA.parameters | {"fx": 671.0, "fy": 673.2}, image_size=CAMERA.image_size)
    eye = cell.eye(camera=wrong, mounting=turned(cell.mounting, 5.0, np.array([1.0, -1.0, 0.5])))
    wanted = cell.taught(eye)
    cell.start(np.random.default_rng(6), metres=0.2, degrees=30)
    servo(cell.robot, eye, wanted, LAWS["image"])
    mm, deg = cell.off()
    assert mm < 0.3
    assert deg < 0.1


@pytest.mark.statistics
def test_what_remains_is_as_certain_as_it_says() -> None:
    squares = []
    for seed in range(40):
        cell = make_cell(seed, sigma_px=0.1)
        eye = cell.eye()
        wanted = cell.taught(eye)
        assert cell.place(cell.T_wanted @ se3.exp([0.02, -0.01, 0.03, 0.01, 0.005, -0.01]))
        last = servo(cell.robot, eye, wanted, LAWS["image"], options=ServoOptions(tolerance_mm=0.5)).last
        T = cell.T_wanted @ cell.mounting.transform
        off = se3.log(se3.inverse(T) @ cell.source.place()) - last.delta
        squares.append(off @ np.linalg.solve(last.covariance, off))
    # chi-square of 6 degrees of freedom, mean 6, sigma of the mean of 40: sqrt(12 / 40)
    assert abs(np.mean(squares) - 6) < 4 * np.sqrt(12 / 40)


def test_a_target_out_of_view_is_named_and_the_robot_stands() -> None:
    cell = make_cell(0)
    eye = cell.eye()
    wanted = cell.taught(eye, pictures=3)
    assert cell.place(cell.T_wanted @ se3.make(np.eye(3), [0.3, 0.0, 0.0]))
    with pytest.raises(RefusedError, match=r"out of view.*not all of the board"):
        servo(cell.robot, eye, wanted, LAWS["image"])
    assert not cell.robot.twist.any()


def test_a_robot_that_stops_answering_is_told_and_stopped() -> None:
    cell = make_cell(0, sigma_px=QUIET)
    eye = cell.eye()
    wanted = cell.taught(eye, pictures=3)
    cell.start(np.random.default_rng(0))
    cell.robot.fails_at = cell.robot.clock + 1.0
    with pytest.raises(DeviceError, match="does not answer"):
        servo(cell.robot, eye, wanted, LAWS["image"])
    assert not cell.robot.twist.any()


def test_a_pose_beyond_a_joints_range_names_the_joint() -> None:
    cell = make_cell(2, sigma_px=QUIET)
    eye = cell.eye()
    wanted = cell.taught(eye, pictures=5)
    taught = cell.robot.q.copy()
    cell.robot.q = taught + np.array([0, 0, 0, 0, 0, 0.3])
    limited = list(cell.robot.chain.joints)
    joint = type(limited[5])(limited[5].name, taught[5] + 0.15, taught[5] + 1.0)
    object.__setattr__(cell.robot.chain, "joints", (*limited[:5], joint))
    try:
        with pytest.raises(RefusedError, match=r"the range of joint 6 holds the arm"):
            servo(cell.robot, eye, wanted, LAWS["image"], options=ServoOptions(stall_s=1.5))
        assert cell.robot.q[5] >= taught[5] + 0.15
    finally:
        object.__setattr__(cell.robot.chain, "joints", tuple(limited))


def test_a_tolerance_that_the_features_cannot_tell_is_refused() -> None:
    cell = make_cell(1, sigma_px=0.5)
    eye = cell.eye()
    wanted = cell.taught(eye, pictures=3)
    with pytest.raises(RefusedError, match="tolerance cannot be met"):
        servo(
            cell.robot,
            eye,
            wanted,
            LAWS["image"],
            options=ServoOptions(tolerance_mm=0.02, rest_pictures=4, stall_s=2.0),
        )


def test_gains_that_overshoot_are_refused() -> None:
    with pytest.raises(InputError, match="overshoots"):
        ServoOptions(gain=12.0)
    with pytest.raises(InputError, match="above 0"):
        ServoOptions(period_s=0.0)


def test_features_stay_in_the_picture_on_the_way() -> None:
    cell = make_cell(5, sigma_px=QUIET)
    eye = cell.eye()
    wanted = cell.taught(eye, pictures=5)
    cell.start(np.random.default_rng(9), metres=0.2, degrees=30)
    servo(cell.robot, eye, wanted, LAWS["position"])
    size = np.array(CAMERA.image_size)
    for uv in cell.source.seen.values():
        assert uv is not None
        assert (uv > 0).all()
        assert (uv < size).all()
