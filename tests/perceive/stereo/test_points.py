"""Triangulation: exact on exact matches, its covariance the propagated one, and as wide as the errors are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.perceive.stereo.made import drawn_eyes, made_eyes, pixels_of, seen_points

from calibrant.cameras import Camera
from calibrant.errors import InputError
from calibrant.geometry import se3
from calibrant.perceive.stereo.eyes import Eyes
from calibrant.perceive.stereo.points import METHODS, Method, points_from_matches


@pytest.mark.parametrize("method", METHODS)
def test_exact_matches_give_exact_points(method: Method) -> None:
    eyes = made_eyes()
    X = seen_points(eyes, 60, np.random.default_rng(1))
    found = points_from_matches(eyes, pixels_of(eyes, X), method=method)
    np.testing.assert_allclose(found.points, X, atol=1e-10)
    assert found.residuals_px.max() < 1e-7


@pytest.mark.parametrize("method", METHODS)
def test_the_covariance_is_the_propagated_one(method: Method) -> None:
    """Every pixel and every number of the calibration moved by itself."""
    eyes = made_eyes()
    X = seen_points(eyes, 5, np.random.default_rng(2))
    uv = pixels_of(eyes, X)
    found = points_from_matches(eyes, uv, sigma_px=(0.3, 0.7), method=method)
    noise = np.zeros((5, 3, 3))
    for camera, sigma in ((0, 0.3), (1, 0.7)):
        for axis in (0, 1):
            step = np.zeros(uv.shape)
            step[camera, :, axis] = 1e-3
            ends = [
                points_from_matches(eyes, uv + s * step, sigma_px=(0.3, 0.7), method=method).points for s in (1, -1)
            ]
            J = (ends[0] - ends[1]) / 2e-3
            noise += sigma**2 * J[:, :, None] * J[:, None, :]
    np.testing.assert_allclose(found.noise, noise, rtol=1e-4, atol=1e-12)
    for k in range(len(eyes.covariance)):
        h = 1e-2 * np.sqrt(eyes.covariance[k, k])
        ends = [
            points_from_matches(_moved(eyes, k, s * h), uv, sigma_px=(0.3, 0.7), method=method).points for s in (1, -1)
        ]
        J = (ends[0] - ends[1]) / (2 * h)
        np.testing.assert_allclose(found.by_calibration[:, :, k], J, rtol=2e-3, atol=2e-4 * np.abs(J).max() + 1e-12)


def _moved(eyes: Eyes, k: int, h: float) -> Eyes:
    delta = np.zeros(len(eyes.covariance))
    delta[k] = h
    T = np.stack([np.eye(4), se3.retract(eyes.T_first_camera[1], delta[:6])])
    cameras = tuple(
        Camera(c.model, c.image_size, c.values + delta[eyes.lens_columns(i)]) for i, c in enumerate(eyes.cameras)
    )
    return replace(eyes, T_first_camera=T, cameras=cameras)


@pytest.mark.statistics
@pytest.mark.parametrize("method", METHODS)
def test_errors_are_as_large_as_stated(method: Method) -> None:
    """Normalised squared errors of 200 calibrations with 10 points each: mean 1 per degree of freedom.

    Points of one calibration share its error, some three numbers: sigma of the mean is sqrt(2 / 3 / 200) = 6 %.
    """
    truth, rng = made_eyes(), np.random.default_rng(3)
    scores = []
    for _ in range(200):
        eyes = drawn_eyes(truth, rng)
        X = seen_points(truth, 10, rng)
        uv = pixels_of(truth, X) + rng.normal(0, 0.3, (2, 10, 2))
        found = points_from_matches(eyes, uv, sigma_px=0.3, method=method)
        off = found.points - X
        scores += np.einsum("ni,nij,nj->n", off, np.linalg.inv(found.covariance), off).tolist()
    assert np.mean(scores) / 3 == pytest.approx(1, abs=0.15)


def test_the_optimal_point_is_the_best_where_cameras_differ() -> None:
    """A near and a far camera, a good one and a poor one: the spread of errors by method."""
    eyes = made_eyes(scale=1e-6)
    far = Eyes(eyes.names, eyes.cameras, np.stack([np.eye(4), se3.make(np.eye(3), [0.3, 0.0, -1.5])]), eyes.covariance)
    rng = np.random.default_rng(4)
    X = seen_points(far, 800, rng, depth=(0.6, 1.0))
    uv = pixels_of(far, X) + rng.normal(0, 1, (2, 800, 2)) * np.array([0.2, 1.0])[:, None, None]
    spread = {
        m: np.sqrt(np.mean((points_from_matches(far, uv, sigma_px=(0.2, 1.0), method=m).points - X) ** 2))
        for m in METHODS
    }
    assert spread["optimal"] < spread["midpoint"]
    assert spread["optimal"] < spread["linear"]


def test_a_third_camera_that_misses_points_lowers_sigma_where_it_sees() -> None:
    eyes = made_eyes(scale=1e-6)
    T = np.concatenate([eyes.T_first_camera, [se3.make(np.eye(3), [0.0, 0.2, 0.0])]])
    cameras = (*eyes.cameras, eyes.cameras[0])
    size = 12 + sum(len(c.values) for c in cameras)
    three = Eyes(("left", "right", "top"), cameras, T, np.zeros((size, size)))
    X = seen_points(eyes, 10, np.random.default_rng(5), depth=(0.9, 1.1))
    uv = pixels_of(three, X)
    uv[2, :5] = np.nan
    found = points_from_matches(three, uv)
    np.testing.assert_allclose(found.points, X, atol=1e-10)
    two = points_from_matches(eyes, uv[:2])
    np.testing.assert_allclose(found.sigma_z[:5], two.sigma_z[:5], rtol=1e-3)
    assert np.all(found.sigma_z[5:] < 0.95 * two.sigma_z[5:])


def test_rays_that_do_not_meet_have_no_point_and_bad_input_is_named() -> None:
    eyes = made_eyes()
    X = seen_points(eyes, 3, np.random.default_rng(6))
    uv = pixels_of(eyes, X)
    crossed = uv.copy()
    crossed[1, 1, 0] += 300.0  # the rays part ahead, and meet behind
    found = points_from_matches(eyes, crossed)
    assert found.found.tolist() == [True, False, True]
    assert np.isnan(found.covariance[1]).all()
    with pytest.raises(InputError, match=r"pixels \(2, n, 2\)"):
        points_from_matches(eyes, uv[:1])
    with pytest.raises(InputError, match="unknown method"):
        points_from_matches(eyes, uv, method="best")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="above 0"):
        points_from_matches(eyes, uv, sigma_px=0.0)
    uv[0, 2] = np.nan
    with pytest.raises(InputError, match="match 2 is seen by fewer"):
        points_from_matches(eyes, uv)
