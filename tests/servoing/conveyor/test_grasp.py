"""A grasp on the move in a cell without pictures."""

from __future__ import annotations

import numpy as np
import pytest
from tests.servoing.conveyor.belts import T_OBJECT_GRIPPER, Belt, make_belt

from calibrant.errors import DeviceError, InputError, RefusedError
from calibrant.servoing.conveyor.grasp import Grasp, GraspOptions, grasp_moving
from calibrant.servoing.conveyor.latency import Latency

UP = np.array([0.0, 0.0, 1.0])


def grasp(belt: Belt, **how) -> Grasp:
    return grasp_moving(
        belt.robot, belt.source, belt.mounting, belt.find, T_OBJECT_GRIPPER, normal=UP, symmetry=4, **how
    )


@pytest.mark.parametrize(("speed", "turn"), [(0.0, 0.0), (0.08, 0.6), (0.2, -0.4)])
def test_what_moves_and_turns_is_held(speed: float, turn: float) -> None:
    belt = make_belt(3, speed=speed, turn=turn)
    done = grasp(belt)
    assert done.held, done.reason
    assert done.off_m < 0.002
    np.testing.assert_allclose(done.object.rate[3:], belt.velocity, atol=4 * done.object.speed_sigma)
    assert not belt.robot.twist.any()


def test_a_latency_that_is_told_is_made_up_for() -> None:
    off = {}
    for known in (0.0, 0.12):
        belt = make_belt(5, speed=0.2, turn=0.0, sigma_px=0.02, latency_s=0.12)
        done = grasp(belt, latency=Latency(known))
        there = belt.object_at(done.object.time_s)
        off[known] = float(np.linalg.norm(done.object.T_base_object[:3, 3] - there[:3, 3]))
    assert off[0.12] < 0.002
    assert off[0.0] > 5 * off[0.12]


def test_an_object_that_never_comes_is_named_and_the_arm_stands() -> None:
    belt = make_belt(0, speed=0.1, turn=0.0)
    belt.source.target = lambda t: np.diag([1.0, 1, 1, 1]) + np.array([[0, 0, 0, 5.0], *[[0.0] * 4] * 3])
    with pytest.raises(RefusedError, match="not seen"):
        grasp(belt, options=GraspOptions(arrive_s=1.0))
    assert not belt.robot.twist.any()


def test_an_object_that_leaves_the_allowed_space_is_named() -> None:
    belt = make_belt(1, speed=0.15, turn=0.0)
    with pytest.raises(RefusedError, match="leaves the space"):
        grasp(belt, within=lambda T: bool(T[1, 3] < -0.1))
    assert not belt.robot.twist.any()


def test_a_silent_robot_is_stopped() -> None:
    belt = make_belt(1, speed=0.1, turn=0.0)
    belt.robot.fails_at = 1.0
    with pytest.raises(DeviceError):
        grasp(belt)
    assert not belt.robot.twist.any()


def test_figures_that_no_grasp_has_are_refused() -> None:
    with pytest.raises(InputError, match="gain"):
        GraspOptions(gain=float("nan"))


@pytest.mark.statistics
def test_ninety_five_of_a_hundred_are_held() -> None:
    held = 0
    for seed in range(100):
        rng = np.random.default_rng(seed)
        belt = make_belt(seed, speed=rng.uniform(0, 0.2), turn=rng.uniform(-0.8, 0.8))
        try:
            held += grasp(belt).held
        except RefusedError:
            continue
    assert held >= 95
