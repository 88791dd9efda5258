"""What changed, from photos at robot poses, beside a photo of then, and of a lens alone."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import calibrant as cb
from calibrant.arrays import Array
from calibrant.calibrate.review.residuals import seen_poses
from calibrant.data import CalibrationResult, Observations, RobotPoses, View
from calibrant.geometry import se3, so3
from calibrant.simulate.noise import noisy_poses
from calibrant.simulate.scenes import grid, gripper_poses, look_at_board, observe, standard_camera, standard_mounting
from calibrant.verification.unchanged.answer import ANY_CHANGE, Tolerance, answer_of_target
from calibrant.verification.unchanged.compare import Compared, lens_alone, on_robot, seen_now, standing
from calibrant.verification.unchanged.decide import CAMERA, LENS_CHANGED, TARGET
from calibrant.verification.unchanged.robot_noise import robot_side
from calibrant.verification.unchanged.spread import Spread, own_lens, spread_of

VIEWS = 20
POINTS = grid(9, 7, 0.03)
PUSH = se3.make(so3.exp(np.deg2rad([0.0, 0.2, 0.0])), [0.002, 0.0, 0.0])


@cache
def calibrated(setup: str) -> tuple[CalibrationResult, Array, Array]:
    """A calibration, T_camera_target of 3 poses that come after it, and the poses that the robot says there."""
    rng = np.random.default_rng(5)
    camera = standard_camera()
    T = look_at_board(camera, POINTS, VIEWS + 3, rng=rng, distance=(0.4, 0.8), tilt_deg=35)
    X, Z = standard_mounting(setup)
    said = noisy_poses(gripper_poses(setup, X, Z, T), sigma_mm=0.05, sigma_deg=0.01, rng=rng)
    seen = observe(camera, POINTS, T[:VIEWS], sigma_px=0.1, rng=rng)
    poses = RobotPoses.from_matrices(said[:VIEWS])
    return cb.calibrate_hand_eye(poses, seen, setup=setup), T[VIEWS:], said[VIEWS:]


def now(setup: str, moved: Array, *, seed: int = 3, photos: int = 3, target: Array | None = None) -> Compared:
    """Photos of a camera that moved by `moved` since the calibration, before a target that moved by `target`."""
    result, T, said = calibrated(setup)
    rng = np.random.default_rng(seed)
    behind = np.eye(4) if target is None else target
    seen = observe(standard_camera(), POINTS, (se3.inverse(moved) @ T @ behind)[:photos], sigma_px=0.1, rng=rng)
    side, spread = robot_side(result, "camera"), spread_of(result, "camera", result.camera)
    return on_robot(result.camera, side, seen_now(result.camera, seen.views), said[:photos], spread)


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_nothing_changed(setup: str) -> None:
    found = now(setup, np.eye(4))
    answer = answer_of_target(found, None, ANY_CHANGE)
    assert not answer.changed
    assert "unchanged: 3 photos" in answer.words
    assert answer.figures["at the workpiece"][0] < 0.5


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_a_camera_that_was_pushed_is_named_with_the_push(setup: str) -> None:
    found = now(setup, PUSH)
    answer = answer_of_target(found, None, ANY_CHANGE)
    assert answer.changed
    assert [h.what for h in found.decision.explaining] == [CAMERA]
    assert re.search(r"the camera moved \S+ ± \S+ mm to the right and turned \S+ ± \S+ deg to the right;", answer.words)
    assert "to the left of where they should be" in answer.words
    h = found.decision.named(CAMERA)
    assert h is not None
    step = se3.local(PUSH, h.fit.place["camera moved"])
    assert step @ np.linalg.solve(h.fit.of("camera moved"), step) < 30  # chi-square of 6 at 4e-5


def test_a_target_that_was_moved_is_named() -> None:
    found = now("eye-in-hand", np.eye(4), target=se3.make(np.eye(3), [0.003, 0.0, 0.0]))
    answer = answer_of_target(found, None, ANY_CHANGE)
    assert answer.changed
    assert found.decision.explaining[0].what == TARGET
    assert CAMERA not in [h.what for h in found.decision.explaining]
    value, sigma, unit = answer.figures["at the workpiece"]
    assert unit == "mm"
    assert abs(value - 3) < 5 * sigma


def test_one_photo_cannot_tell_camera_from_target() -> None:
    answer = answer_of_target(now("eye-in-hand", PUSH, photos=1), None, ANY_CHANGE)
    assert answer.changed
    assert "take two or three" in answer.doubts[0]
    assert "; or the target" in answer.words or "; or the camera" in answer.words


def test_a_small_change_is_none_by_a_tolerance() -> None:
    found = now("eye-to-hand", PUSH)
    assert not answer_of_target(found, None, Tolerance(metres=0.02)).changed
    assert not answer_of_target(found, None, Tolerance(px=50.0)).changed
    assert answer_of_target(found, None, Tolerance(metres=0.001)).changed


def standing_views(moved: Array, *, seed: int = 0) -> Compared:
    camera, rng = replace(standard_camera(), covariance=None), np.random.default_rng(seed)
    T = look_at_board(camera, POINTS, 1, rng=rng, distance=(0.9, 1.0))
    then = seen_now(camera, observe(camera, POINTS, T, sigma_px=0.05, rng=rng).views)
    place = np.repeat(se3.inverse(moved) @ T, 3, axis=0)
    seen = seen_now(camera, observe(camera, POINTS, place, sigma_px=0.05, rng=rng).views)
    return standing(camera, then.views[0], then.sigmas[0], then.T_camera_target[0], seen, Spread())


def test_what_stands_is_compared_with_a_photo_of_then() -> None:
    assert not answer_of_target(standing_views(np.eye(4)), None, ANY_CHANGE).changed
    answer = answer_of_target(standing_views(se3.make(np.eye(3), [0.0, 0.001, 0.0])), None, ANY_CHANGE)
    assert answer.changed
    assert " up of where they should be" in answer.words
    assert "not told apart" in answer.doubts[0]


@pytest.mark.parametrize("scale", [1.0, 1.01])
def test_a_lens_alone(scale: float) -> None:
    rng, camera = np.random.default_rng(1), standard_camera()
    seen = observe(camera, POINTS, look_at_board(camera, POINTS, 15, rng=rng), sigma_px=0.1, rng=rng)
    result = cb.calibrate_intrinsics(seen)
    zoomed = replace(camera, values=camera.values * np.r_[scale, scale, np.ones(len(camera.values) - 2)])
    today = observe(zoomed, POINTS, look_at_board(camera, POINTS, 3, rng=rng), sigma_px=0.1, rng=rng)
    spread = spread_of(result, "camera", result.camera)
    found = lens_alone(result.camera, seen_now(result.camera, today.views), spread)
    answer = answer_of_target(found, None, ANY_CHANGE)
    assert answer.changed == (scale > 1)
    assert found.decision.hypotheses[0].what == LENS_CHANGED
    value, sigma, _ = answer.figures["focal length"]
    assert abs(value - 100 * (scale - 1)) < 5 * sigma


def test_the_gain_of_a_lens_of_its_own_is_chi_square_of_three() -> None:
    rng, camera = np.random.default_rng(2), standard_camera()
    T = look_at_board(camera, POINTS, 150, rng=rng)
    seen = observe(camera, POINTS, T, sigma_px=0.1, rng=rng)
    result = CalibrationResult("intrinsics", "ok", cameras={"camera": camera}, observations=seen)
    poses = seen_poses(result)
    gains = [own_lens(camera, v, poses["camera", v.id])[0] / 0.1**2 for v in seen.views]
    assert np.mean(gains) == pytest.approx(3, abs=5 * np.sqrt(6 / len(gains)))


def with_shared_errors(seen: Observations, rng: np.random.Generator) -> Observations:
    """Each view's points bent alike by a pattern of their own."""

    def bent(v: View) -> View:
        x = (v.uv - v.uv.mean(axis=0)) / np.ptp(v.uv, axis=0).max()
        return replace(v, uv=v.uv + 0.6 * rng.standard_normal((1, 2)) * x**2)

    return replace(seen, views=tuple(map(bent, seen.views)))


def test_views_whose_points_err_alike_widen_what_a_lens_may_differ_by() -> None:
    rng, camera = np.random.default_rng(3), standard_camera()
    seen = observe(camera, POINTS, look_at_board(camera, POINTS, 20, rng=rng), sigma_px=0.1, rng=rng)
    white = cb.calibrate_intrinsics(seen)
    alike = cb.calibrate_intrinsics(with_shared_errors(seen, rng))
    assert spread_of(white, "camera", white.camera).factor < 1.8
    assert spread_of(alike, "camera", alike.camera).factor > 1.5
    assert Spread(factor=1.5).shared_by(3, places=1) == 2.5
    assert Spread(factor=1.5).shared_by(3, places=3) == 1.5


@pytest.mark.statistics
def test_chances_are_as_stated() -> None:
    chances = [now("eye-to-hand", np.eye(4), seed=s).decision.hypotheses for s in range(60)]
    few = [min(h.chance for h in hs if h.what == CAMERA) for hs in chances]
    # The calibration and the robot's poses are the same in all: only the corners are drawn anew.
    assert np.mean(np.array(few) < 0.01) < 0.1
