"""Pictures of a target at robot poses: a pushed camera is named in time, by how much, and told from a target."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import calibrant as cb
from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, Observations, RobotPoses
from calibrant.geometry import se3, so3
from calibrant.simulate.noise import noisy_poses
from calibrant.simulate.scenes import gripper_poses, look_at_board, observe, standard_mounting
from calibrant.targets.registry import parse_target
from calibrant.verification.unchanged.robot_noise import RobotSide, robot_side
from calibrant.verification.watch.placed import (
    at_robot_poses,
    placed_views,
    shared_while_still,
    standing_still,
    with_target_at,
)
from calibrant.verification.watch.result import Watched, moved_in_hand, watched
from calibrant.verification.watch.sequential import Rule, Sight, watch

CAMERA = Camera.create("pinhole", {"fx": 600.0, "fy": 600.0, "cx": 319.5, "cy": 239.5}, image_size=(640, 480))
BOARD, TAG = parse_target("chessboard:7x6:30mm"), parse_target("marker:80mm:DICT_APRILTAG_36h11:10")
X, Z = standard_mounting("eye-in-hand")
NOISE = {"sigma_mm": 0.1, "sigma_deg": 0.01}
PUSH = se3.make(np.eye(3), [0.0006, -0.0006, 0.0005])


@pytest.fixture(scope="module")
def known() -> CalibrationResult:
    rng = np.random.default_rng(4)
    T = look_at_board(CAMERA, BOARD.points, 20, rng=rng, distance=(0.35, 0.6), tilt_deg=40, roll_deg=60)
    said = noisy_poses(gripper_poses("eye-in-hand", X, Z, T), rng=rng, **NOISE)
    seen = observe(CAMERA, BOARD.points, T, sigma_px=0.05, rng=rng)
    return cb.calibrate_hand_eye(RobotPoses.from_matrices(said), seen, setup="eye-in-hand")


@pytest.fixture(scope="module")
def side(known: CalibrationResult) -> RobotSide:
    return robot_side(known, "camera")


def working(
    n: int, rng: np.random.Generator, D: Array, *, at: int, target: Array | None = None
) -> tuple[Observations, Array]:
    """Pictures of the board at work; from `at` on the camera, or the target, is another place."""
    T = look_at_board(CAMERA, BOARD.points, n, rng=rng, distance=(0.35, 0.6), tilt_deg=30, roll_deg=60)
    said = noisy_poses(gripper_poses("eye-in-hand", X, Z, T), rng=rng, **NOISE)
    F = np.eye(4) if target is None else target
    seen = np.stack([T_i if i < at else se3.inverse(D) @ T_i @ F for i, T_i in enumerate(T)])
    return observe(CAMERA, BOARD.points, seen, sigma_px=0.05, rng=rng), said


def sights(known: CalibrationResult, side: RobotSide, seen: Observations, said: Array) -> tuple[Sight, ...]:
    placed = placed_views(known.camera, seen.views, side.predicted(said), stated_px=known.sigma_px)
    return at_robot_poses(known.camera, side, placed, said)


def test_a_push_of_a_millimetre_is_named_within_ten_pictures(known: CalibrationResult, side: RobotSide) -> None:
    rng = np.random.default_rng(10)
    seen, said = working(24, rng, PUSH, at=12)
    found = sights(known, side, seen, said)
    states = watched(found, Rule(freedom=side.freedom))
    alarm = states[-1].alarm
    assert alarm is not None
    assert 11 <= alarm.since <= 13
    assert alarm.at < 22
    moved = moved_in_hand(Watched(found, states, camera=known.camera), alarm.since)
    assert moved.words.startswith("the camera moved")
    for axis, truth in zip("xyz", 1e3 * PUSH[:3, 3]):
        figure = moved.figures[f"moved {axis}"]
        assert figure.value == pytest.approx(truth, abs=4 * figure.sigma)
        assert figure.sigma < 0.5


def test_nothing_is_named_where_nothing_moved(known: CalibrationResult, side: RobotSide) -> None:
    seen, said = working(60, np.random.default_rng(11), PUSH, at=60)
    assert watch(sights(known, side, seen, said), Rule(freedom=side.freedom)).alarm is None


def test_a_moved_target_is_told_from_a_moved_camera(known: CalibrationResult, side: RobotSide) -> None:
    step = se3.make(so3.exp([0.0, 0.0, 0.01]), [0.004, 0.002, 0.0])
    seen, said = working(30, np.random.default_rng(12), np.eye(4), at=12, target=step)
    found = sights(known, side, seen, said)
    states = watched(found, Rule(freedom=side.freedom))
    alarm = states[-1].alarm
    assert alarm is not None
    assert moved_in_hand(Watched(found, states), alarm.since).words.startswith("the target has moved")


def test_a_camera_and_a_tag_that_stand_still() -> None:
    rng = np.random.default_rng(13)
    T = se3.make(so3.exp([np.pi - 0.4, 0.2, 0.0]), [0.02, 0.01, 0.6])
    D = se3.make(so3.exp(np.deg2rad([0.0, 0.1, 0.0])), np.zeros(3))
    poses = np.stack([T if i < 15 else se3.inverse(D) @ T for i in range(30)])
    seen = observe(CAMERA, TAG.points, poses, sigma_px=0.1, rng=rng)
    views = [replace(v, sigma_px=np.full(len(v), 0.1)) for v in seen.views]
    placed = placed_views(CAMERA, views, np.tile(T, (30, 1, 1)))
    alarm = watch(standing_still(placed, None), Rule()).alarm
    assert alarm is not None
    assert 14 <= alarm.since <= 16
    assert alarm.at <= 25


def test_another_target_than_the_calibrations_is_learnt(known: CalibrationResult, side: RobotSide) -> None:
    """Its place is known by half a metre: the first pictures tell it, and a push among them is told as well."""
    rng = np.random.default_rng(14)
    seen, said = working(28, rng, PUSH, at=14)
    rough = with_target_at(side, se3.retract(side.Z, [0.02, -0.01, 0.0, 0.01, 0.0, 0.02]))
    placed = placed_views(known.camera, seen.views, rough.predicted(said), stated_px=known.sigma_px)
    alarm = watch(at_robot_poses(known.camera, rough, placed, said), Rule(freedom=side.freedom)).alarm
    assert alarm is not None
    assert 13 <= alarm.since <= 15
    assert alarm.at < 24


def test_what_corners_share_while_nothing_moves_is_one_pictures_noise() -> None:
    T = se3.make(so3.exp([np.pi - 0.4, 0.2, 0.0]), [0.02, 0.01, 0.6])
    seen = observe(CAMERA, TAG.points, np.stack([T, T]), sigma_px=0.1, rng=np.random.default_rng(15))
    views = [replace(v, sigma_px=np.full(len(v), 0.1)) for v in seen.views]
    sight = standing_still(placed_views(CAMERA, views, np.tile(T, (2, 1, 1))), T)[-1]
    C = shared_while_still(sight)
    assert sight.of_move @ C @ sight.of_move.T == pytest.approx(sight.covariance, rel=1e-6)
