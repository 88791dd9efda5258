"""Fresh views: their chi-square and 95 % regions hold where nothing is wrong, and a wrong calibration is told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import calibrant as cb
from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, RobotPoses
from calibrant.data.details import TaskRuns
from calibrant.geometry import se3
from calibrant.simulate.noise import noisy_poses
from calibrant.simulate.scenes import gripper_poses, look_at_board, observe, standard_mounting
from calibrant.targets.registry import parse_target
from calibrant.verification.held_out.result import at_poses, by_lens, held_out_result
from calibrant.verification.unchanged.robot_noise import RobotSide, robot_side
from calibrant.verification.watch.placed import at_robot_poses, placed_views
from calibrant.verification.watch.sequential import joint_chi2

CAMERA = Camera.create("pinhole", {"fx": 600.0, "fy": 600.0, "cx": 319.5, "cy": 239.5}, image_size=(640, 480))
BOARD = parse_target("chessboard:7x6:30mm")
X, Z = standard_mounting("eye-in-hand")
ROBOT = {"sigma_mm": 0.1, "sigma_deg": 0.01}


def views(n: int, rng: np.random.Generator) -> tuple[Array, cb.Observations]:
    T = look_at_board(CAMERA, BOARD.points, n, rng=rng, distance=(0.35, 0.6), tilt_deg=40, roll_deg=60)
    said = noisy_poses(gripper_poses("eye-in-hand", X, Z, T), rng=rng, **ROBOT)
    return said, observe(CAMERA, BOARD.points, T, sigma_px=0.05, rng=rng)


@pytest.fixture(scope="module")
def known() -> CalibrationResult:
    said, seen = views(20, np.random.default_rng(4))
    return cb.calibrate_hand_eye(RobotPoses.from_matrices(said), seen, setup="eye-in-hand")


def judged(known: CalibrationResult, side: RobotSide, *, tolerance_mm: float | None = None) -> CalibrationResult:
    said, seen = views(40, np.random.default_rng(9))
    placed = placed_views(known.camera, seen.views, side.predicted(said), stated_px=known.sigma_px)
    sights = at_robot_poses(known.camera, side, placed, said)
    rows = at_poses(known.camera, placed, sights)
    return held_out_result(rows, joint_chi2(sights), tolerance_mm=tolerance_mm)


def test_views_that_were_kept_out_are_as_predicted(known: CalibrationResult) -> None:
    found = judged(known, robot_side(known, "camera"), tolerance_mm=2.0)
    assert found.check("held-out").status == "ok"
    assert found.check("chi-square").status == "ok"
    record = found.detail(TaskRuns)
    assert record is not None
    # Of 40 with one calibration's error in all of them, 95 % are expected; 32 would be 4 sigma off if independent.
    assert sum(bool(r.inside) for r in record.runs) >= 32


def test_a_camera_that_is_off_by_two_millimetres_is_told(known: CalibrationResult) -> None:
    side = robot_side(known, "camera")
    off = replace(side, X=se3.retract(side.X, [0, 0, 0, 2e-3, 0, 0]))
    found = judged(known, off, tolerance_mm=1.0)
    assert found.check("held-out").status == "fail"
    assert found.check("chi-square").status == "warn"


def test_a_tolerance_that_cannot_be_met_is_said(known: CalibrationResult) -> None:
    found = judged(known, robot_side(known, "camera"), tolerance_mm=0.01)
    assert "cannot be met" in found.check("tolerance").message


def test_a_lens_alone_is_asked_without_a_robot() -> None:
    rng = np.random.default_rng(3)
    _, seen = views(12, rng)
    placed = placed_views(CAMERA, seen.views, np.tile(np.eye(4), (12, 1, 1)))
    rows, total, freedom = by_lens(CAMERA, placed, 0.05)
    assert total / freedom == pytest.approx(1, abs=4 * np.sqrt(2 / freedom))
    assert np.mean([v.px for v in rows]) == pytest.approx(0.05 * np.sqrt(2 * (84 - 6) / 84), rel=0.1)
    values = CAMERA.parameters
    wrong = Camera.create("pinhole", {**values, "fx": 606.0}, image_size=CAMERA.image_size)
    found = placed_views(wrong, seen.views, np.tile(np.eye(4), (12, 1, 1)))
    rows, total, freedom = by_lens(wrong, found, 0.05)
    assert held_out_result(rows, (total, freedom)).check("chi-square").status == "warn"
