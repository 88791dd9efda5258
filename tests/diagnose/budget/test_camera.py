"""Uncertainty in pixels and millimetres against direct sampling of the covariance."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.cameras import Camera
from calibrant.data import as_transform
from calibrant.diagnose.budget import camera as uncertainty
from calibrant.errors import InputError
from calibrant.geometry import se3
from calibrant.simulate.scenes import standard_camera

RNG = np.random.default_rng(0)
PLAIN = standard_camera()
ROOT = 1e-3 * RNG.normal(size=(9, 9)) * np.maximum(np.abs(PLAIN.values), 0.01)[:, None] * 0.3
CAMERA = Camera(PLAIN.model, PLAIN.image_size, PLAIN.values, ROOT @ ROOT.T)
TURN = 1e-3 * RNG.normal(size=(6, 6))
X = as_transform("gripper", "camera", se3.exp(RNG.normal(size=6)), TURN @ TURN.T)
SAMPLES = 4000
# A sampled variance of 4000 is right to 2.2 %; entries are compared with 10 % of the largest.


def sampled(values: np.ndarray) -> np.ndarray:
    return np.cov(values.T)


def test_pixel() -> None:
    p = np.array([0.1, -0.15, 0.8])
    drawn = CAMERA.values + RNG.normal(size=(SAMPLES, 9)) @ ROOT.T
    C = sampled(np.array([CAMERA.model.project(k, p) for k in drawn]))
    np.testing.assert_allclose(uncertainty.of_pixel(CAMERA, p), C, atol=0.10 * np.abs(C).max())
    more = uncertainty.of_pixel(CAMERA, p, of_p_camera=1e-6 * np.eye(3))
    assert np.all(np.diag(more) > np.diag(uncertainty.of_pixel(CAMERA, p)))


def test_point_through_a_transform() -> None:
    p = np.array([[0.1, -0.15, 0.8], [0.0, 0.3, 0.5]])
    drawn = se3.retract(X.matrix, RNG.normal(size=(SAMPLES, 6)) @ TURN.T)
    for point, found in zip(p, uncertainty.of_point(X, p)):
        C = sampled(se3.apply(drawn, point))
        np.testing.assert_allclose(found, C, atol=0.10 * np.abs(C).max())


def test_position_from_pixel_and_depth() -> None:
    """The point that a perturbed camera would report for the same pixel and depth."""
    p = np.array([0.1, -0.15, 0.8])
    uv = CAMERA.project(p)
    drawn = CAMERA.values + RNG.normal(size=(600, 9)) @ ROOT.T
    rays = np.array([CAMERA.model.unproject(k, uv) for k in drawn])
    depth = 0.8 + 0.002 * RNG.normal(size=600)
    C = sampled(rays / rays[:, 2:] * depth[:, None])
    found = uncertainty.of_position(CAMERA, p, sigma_depth=0.002)
    np.testing.assert_allclose(found, C, atol=0.25 * np.abs(C).max())  # 600 samples: 6 %, four sigmas


def test_chain_of_robot_and_camera() -> None:
    T_base_gripper = se3.exp(RNG.normal(size=6))
    product = uncertainty.of_product([T_base_gripper, X])
    assert (product.parent, product.child) == ("gripper", "camera")
    np.testing.assert_allclose(product.matrix, T_base_gripper @ X.matrix)
    # An exact robot turns the error with it: the size of a point's error stays.
    p = np.array([0.2, 0.1, 0.6])
    a, b = uncertainty.of_point(product, p), uncertainty.of_point(X, p)
    assert np.trace(a) == pytest.approx(np.trace(b))


def test_volume_grows_away_from_the_camera() -> None:
    volume = uncertainty.over_volume(X, [-0.2, -0.2, 0.3], [0.2, 0.2, 1.0])
    worst, where = volume.worst
    assert where[2] == 1.0
    assert worst >= volume.mean_mm > 0
    assert volume.points.shape == (125, 3)


def test_bad_input() -> None:
    with pytest.raises(InputError, match="the camera has no covariance"):
        uncertainty.of_pixel(PLAIN, [0, 0, 1.0])
    with pytest.raises(InputError, match="gripper -> camera has no covariance"):
        uncertainty.of_point(as_transform("gripper", "camera", np.eye(4)), [0, 0, 1.0])
    with pytest.raises(InputError, match="at least one estimated transform"):
        uncertainty.of_product([np.eye(4)])
    with pytest.raises(InputError, match="low <= high"):
        uncertainty.over_volume(X, [0, 0, 1], [0, 0, 0.5])
