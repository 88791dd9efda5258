"""What points weigh: the detector's word completed by what residuals show, and covariances of moved pictures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibrant.calibrate.intrinsics.calibrate import calibrate_intrinsics
from calibrant.calibrate.reprojection.weights import reweighted
from calibrant.data import Observations, View
from calibrant.simulate.scenes import intrinsics_scene


def moved(view: View, rng: np.random.Generator, *, stated: bool) -> View:
    """A view with noise 0.1 px across a direction of its own and 0.1 to 0.8 px along it; whether it says so."""
    turn, long = rng.uniform(0, np.pi), rng.uniform(0.1, 0.8)
    axis = np.array([np.cos(turn), np.sin(turn)])
    C = 0.01 * np.eye(2) + (long**2 - 0.01) * np.outer(axis, axis)
    noise = rng.standard_normal((len(view), 2)) @ np.linalg.cholesky(C).T
    each = np.tile(C, (len(view), 1, 1))
    known = {"covariance_px": each} if stated else {"sigma_px": np.full(len(view), np.sqrt(0.5 * np.trace(C)))}
    return replace(view, uv=view.uv + noise, **known)


def test_an_excess_is_added_to_all_sides() -> None:
    rng = np.random.default_rng(0)
    n = 4000
    C = np.tile([[0.04, 0.01], [0.01, 0.01]], (n, 1, 1))
    view = View("a", np.zeros((n, 3)), np.zeros((n, 2)), np.arange(n), covariance_px=C)
    noise = rng.standard_normal((n, 2)) @ np.linalg.cholesky(C[0]).T + 0.2 * rng.standard_normal((n, 2))
    (found,) = reweighted([view], np.sum(noise**2, axis=1), unknowns=0)
    assert found.covariance_px is not None
    assert found.sigma_px is not None
    # 4000 points tell a variance to 3 %; 0.2 px is most of it.
    np.testing.assert_allclose(found.covariance_px[0], C[0] + 0.04 * np.eye(2), atol=0.004)
    assert found.sigma_px[0] == pytest.approx(np.sqrt(0.065), rel=0.05)
    (enough,) = reweighted([view], np.full(n, 1e-6), unknowns=0)
    np.testing.assert_array_equal(enough.covariance_px, C)


@pytest.mark.statistics
def test_sigma_of_a_camera_of_moved_pictures_is_true_and_smaller() -> None:
    squares, scaled = [], []
    for seed in range(40):
        scene = intrinsics_scene(12, seed=seed, sigma_px=0.0)
        errors, cameras = [], []
        for stated in (True, False):
            rng = np.random.default_rng(seed)
            views = tuple(moved(v, rng, stated=stated) for v in scene.observations.views)
            result = calibrate_intrinsics(Observations(views, scene.observations.image_sizes))
            cameras.append(result.cameras["camera"])
            errors.append(cameras[-1].values - scene.camera.values)
        covariance = cameras[0].covariance
        assert covariance is not None
        free = np.flatnonzero(np.diag(covariance) > 0)
        C, e = covariance[np.ix_(free, free)], errors[0][free]
        squares.append(e @ np.linalg.solve(C, e) / len(free))
        scaled.append(np.array(errors)[:, free] / np.sqrt(np.diag(C)))
    # Of 40 seeds with 9 parameters, chi-square per degree of freedom scatters by 0.08; a covariance that counts
    # clusters with the few views there are is above what independent points would have.
    assert 0.7 < np.mean(squares) < 1.2
    known, alike = np.sqrt(np.mean(np.array(scaled) ** 2, axis=(0, 2)))
    assert known < 0.9 * alike
