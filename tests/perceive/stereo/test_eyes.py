"""Eyes out of a result: places and lenses in one covariance, whichever camera the result is told from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.perceive.stereo.made import LEFT, RIGHT, T_LEFT_RIGHT, pixels_of, seen_points

import calibrant as cb
from calibrant.data import CalibrationResult, Observations, View, as_transform
from calibrant.errors import InputError
from calibrant.geometry import se3
from calibrant.perceive.stereo.eyes import Eyes, eyes_of
from calibrant.perceive.stereo.points import points_from_matches
from calibrant.simulate.scenes import look_at_board
from calibrant.targets.registry import parse_target

BOARD = parse_target("chessboard:9x6:25mm").points


def rig_result(seed: int, *, reference: str = "left", noise: float = 0.2) -> CalibrationResult:
    """A stereo calibration from 12 noisy views."""
    rng = np.random.default_rng(seed)
    views = []
    for i, T in enumerate(look_at_board(LEFT, BOARD, 12, rng=rng, distance=(0.4, 0.9), tilt_deg=40)):
        for name, camera, T_left in (("left", LEFT, np.eye(4)), ("right", RIGHT, T_LEFT_RIGHT)):
            uv = camera.project(se3.apply(se3.inverse(T_left) @ T, BOARD))
            inside = np.isfinite(uv).all(axis=1) & np.all((uv > 0) & (uv < [639, 479]), axis=1)
            uv = uv + rng.normal(0, noise, uv.shape)
            ids = np.arange(len(BOARD))
            views.append(View(f"{name}-{i}", BOARD[inside], uv[inside], ids[inside], name, str(i)))
    sizes = {"left": LEFT.image_size, "right": RIGHT.image_size}
    return cb.calibrate_rig(Observations(tuple(views), sizes), reference=reference)


def test_a_depth_is_as_certain_whichever_camera_is_the_reference() -> None:
    a, b = (eyes_of(rig_result(1, reference=name), ("left", "right")) for name in ("left", "right"))
    assert a.joint
    assert b.joint
    X = seen_points(a, 20, np.random.default_rng(2))
    np.testing.assert_allclose(a.T_first_camera, b.T_first_camera, atol=1e-6)
    sigma = [points_from_matches(e, pixels_of(a, X), sigma_px=1e-6).sigma_z for e in (a, b)]
    np.testing.assert_allclose(sigma[0], sigma[1], rtol=0.02)


def test_places_and_lenses_apart_look_less_certain_than_they_are_together() -> None:
    result = rig_result(3)
    whole = eyes_of(result)
    apart = eyes_of(replace(result, joint_covariance=None))
    assert not apart.joint
    X = seen_points(whole, 20, np.random.default_rng(2))
    uv = pixels_of(whole, X)
    with_all, without = (points_from_matches(e, uv, sigma_px=1e-6).sigma_z for e in (whole, apart))
    assert np.all(with_all < without)
    assert np.median(without / with_all) > 1.5


@pytest.mark.statistics
def test_depths_of_many_calibrations_err_as_stated() -> None:
    """60 calibrations of one rig: the mean square of depth errors over sigma of exact matches is 1 (0.96 +- 0.10 over
    150 of them)."""
    truth = Eyes(("left", "right"), (LEFT, RIGHT), np.stack([np.eye(4), T_LEFT_RIGHT]), np.zeros((24, 24)))
    X = seen_points(truth, 30, np.random.default_rng(2), depth=(0.5, 1.2))
    uv = pixels_of(truth, X)
    scores = []
    for seed in range(60):
        found = points_from_matches(eyes_of(rig_result(seed)), uv, sigma_px=1e-6)
        scores.append(np.nanmean(((found.points - X)[:, 2] / found.sigma_z) ** 2))
    assert 0.7 < np.mean(scores) < 1.3  # 60 scores, each chi-square of one or two numbers: two sigmas


def test_what_cannot_see_together_is_named() -> None:
    one = CalibrationResult("intrinsics", "ok", cameras={"camera": LEFT})
    with pytest.raises(InputError, match="two different cameras are needed; it has: camera"):
        eyes_of(one)
    two = CalibrationResult("rig", "ok", cameras={"left": LEFT, "right": RIGHT})
    with pytest.raises(InputError, match="does not say where right is from left"):
        eyes_of(two)
    with pytest.raises(InputError, match="no camera 'top'"):
        eyes_of(two, ("left", "top"))
    placed = replace(two, transforms=(as_transform("left", "right", T_LEFT_RIGHT),))
    assert eyes_of(placed).baseline == pytest.approx(np.linalg.norm(T_LEFT_RIGHT[:3, 3]))
    assert not np.any(eyes_of(placed).covariance)
