"""Self-visibility: exact without noise, errors as large as predicted with it, features that do not fit refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import chi2

from calibrant.calibrate.pose.target_poses import target_poses
from calibrant.calibrate.tool.self_visibility import calibrate_self_visibility, moved_by_camera
from calibrant.data import View
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3, so3
from calibrant.simulate.scenes import grid, standard_camera
from calibrant.simulate.truth import normalised

Array = NDArray[np.float64]
TWO = np.array([[0.03, 0.002, -0.004], [-0.03, 0.001, -0.004]])
SIGMA_CAMERA = np.array([0.3, 0.3, 0.3, 0.3, 0, 0, 0, 0, 0])
SIGMA_TARGET = np.array([3e-4, 3e-4, 2e-4, 1e-4, 1e-4, 2e-4])


def truth() -> tuple[Array, Array]:
    """T_camera_target of a camera that looks at the plane from 0.3 m, tilted, and T_target_gripper on the plane."""
    T_camera_target = se3.make(so3.exp([0.5, -0.1, 0.4]), [-0.06, -0.02, 0.3])
    return T_camera_target, se3.make(so3.exp([0, 0, 0.7]), [0.08, 0.05, 0.0])


@pytest.mark.parametrize("features", [TWO, np.vstack([TWO, [[0.0, 0.02, -0.01]]])])
def test_exact_without_noise(features: Array) -> None:
    T_camera_target, T_target_gripper = truth()
    camera = standard_camera()
    uv = camera.project(se3.apply(T_camera_target @ T_target_gripper, features))
    found = calibrate_self_visibility(camera, T_camera_target, uv, features, sigma_px=0.1)
    np.testing.assert_allclose(found.gripper_camera.matrix, se3.inverse(T_camera_target @ T_target_gripper), atol=1e-9)
    assert found.angle == pytest.approx(0.7, abs=1e-9)
    np.testing.assert_allclose(found.position, [0.08, 0.05], atol=1e-9)
    assert found.misfit_mm < 1e-6


@pytest.mark.statistics
def test_errors_are_as_large_as_predicted() -> None:
    T_camera_target, T_target_gripper = truth()
    T_gripper_camera = se3.inverse(T_camera_target @ T_target_gripper)
    camera, rng = standard_camera(), np.random.default_rng(0)
    features = np.vstack([TWO, [[0.0, 0.02, -0.01]]])
    uv = camera.project(se3.apply(T_camera_target @ T_target_gripper, features))
    squares, misfits = [], []
    for _ in range(200):
        given = replace(
            camera, values=camera.values + SIGMA_CAMERA * rng.standard_normal(9), covariance=np.diag(SIGMA_CAMERA**2)
        )
        pose = se3.retract(T_camera_target, SIGMA_TARGET * rng.standard_normal(6))
        found = calibrate_self_visibility(
            given, pose, uv + 0.3 * rng.standard_normal(uv.shape), features,
            sigma_px=0.3, covariance_target=np.diag(SIGMA_TARGET**2),
        )  # fmt: skip
        squares.append(normalised(found.gripper_camera, T_gripper_camera))
        misfits.append((found.misfit_mm / found.sigma_misfit_mm) ** 2)
    low, high = chi2.ppf([0.0005, 0.9995], 6 * len(squares))
    assert low < np.sum(squares) < high
    assert np.mean(misfits) == pytest.approx(1.0, rel=0.2)  # 3 degrees of freedom, 200 trials: 6 % sigma


@pytest.mark.statistics
def test_the_lens_moves_board_and_features_alike() -> None:
    # From pixels to the camera: the pose is fitted with a lens that is off, as in life.
    T_camera_target, T_target_gripper = truth()
    T_gripper_camera = se3.inverse(T_camera_target @ T_target_gripper)
    camera, rng, points = standard_camera(), np.random.default_rng(1), grid(9, 6, 0.012)
    sigma = np.array([2.0, 2.0, 2.0, 2.0, 0, 0, 0, 0, 0])
    board = camera.project(se3.apply(T_camera_target, points))
    uv = camera.project(se3.apply(T_camera_target @ T_target_gripper, TWO))
    squares = []
    for _ in range(200):
        values = camera.values + sigma * rng.standard_normal(9)
        given = replace(camera, values=values, covariance=np.diag(sigma**2))
        view = View("0", points, board + 0.1 * rng.standard_normal(board.shape), np.arange(54))
        pose = target_poses(given, [view])
        T = pose.T_camera_target[0]
        found = calibrate_self_visibility(
            given, T, uv + 0.3 * rng.standard_normal(uv.shape), TWO, sigma_px=0.3,
            covariance_target=0.01 * pose.covariance[0], target_by_camera=moved_by_camera(given, view, T),
        )  # fmt: skip
        squares.append(normalised(found.gripper_camera, T_gripper_camera))
    low, high = chi2.ppf([0.0005, 0.9995], 6 * len(squares))
    assert low < np.sum(squares) < high


def test_features_that_do_not_fit_are_refused() -> None:
    T_camera_target, T_target_gripper = truth()
    camera = standard_camera()
    uv = camera.project(se3.apply(T_camera_target @ T_target_gripper, TWO))
    with pytest.raises(RefusedError, match="lies flat"):
        calibrate_self_visibility(camera, T_camera_target, uv, 1.2 * TWO, sigma_px=0.1)
    with pytest.raises(InputError, match="1 gripper features"):
        calibrate_self_visibility(camera, T_camera_target, uv[:1], TWO[:1], sigma_px=0.1)
    with pytest.raises(InputError, match="go together"):
        calibrate_self_visibility(camera, T_camera_target, uv, TWO[:, :2], sigma_px=0.1)
    with pytest.raises(InputError, match=r"feature 2 is at pixel \(9000, 10\), outside the image of 1280x1024"):
        calibrate_self_visibility(camera, T_camera_target, [uv[0], [9000, 10]], TWO, sigma_px=0.1)
    with pytest.raises(InputError, match="one spot"):
        calibrate_self_visibility(camera, T_camera_target, uv, TWO[[0, 0]], sigma_px=0.1)
    away = T_camera_target @ se3.exp([0, np.pi, 0, 0, 0, 0]) @ se3.exp([0, 0, 0, 0, 0, 5.0])
    with pytest.raises(InputError, match="plane"):
        calibrate_self_visibility(camera, away, uv, TWO, sigma_px=0.1)
