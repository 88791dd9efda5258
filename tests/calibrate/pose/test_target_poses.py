"""Poses of a flat target from single views: exact, with an honest covariance, and of two solutions the right one."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.calibrate.pose.target_poses import target_poses
from calibrant.data import View
from calibrant.errors import InputError
from calibrant.geometry import se3
from calibrant.optimize.losses import cauchy
from calibrant.simulate.scenes import grid, look_at_board, observe, standard_camera

CAMERA, POINTS = standard_camera(), grid(6, 5, 0.02)


def views(n: int, *, sigma_px: float, seed: int = 0) -> tuple[np.ndarray, tuple[View, ...]]:
    rng = np.random.default_rng(seed)
    T = look_at_board(CAMERA, POINTS, n, rng=rng, distance=(0.3, 0.8))
    return T, observe(CAMERA, POINTS, T, sigma_px=sigma_px, rng=rng).views


def test_exact_without_noise() -> None:
    T, seen = views(30, sigma_px=0)
    found = target_poses(CAMERA, seen)
    assert np.abs(found.T_camera_target - T).max() < 1e-9
    assert found.rms_px.max() < 1e-8
    assert np.all(found.doubles_rms_px >= found.rms_px)


def test_errors_are_what_the_covariance_says() -> None:
    T, seen = views(200, sigma_px=0.1, seed=1)
    found = target_poses(CAMERA, seen)
    d = se3.local(found.T_camera_target, T)
    statistic = np.einsum("ni,nij,nj->n", d, np.linalg.inv(found.covariance * 0.1**2), d)
    # Mean of 200 chi-squares of 6 degrees: 6 +- 0.245; the double solution would add thousands.
    assert statistic.mean() == pytest.approx(6, abs=5 * 0.245)


def test_a_robust_loss_ignores_gross_points() -> None:
    T, seen = views(10, sigma_px=0.05)
    uv = seen[4].uv.copy()
    uv[[0, 7]] += [25.0, -10.0]
    bent = [*seen[:4], View("4", seen[4].points, uv, seen[4].point_ids), *seen[5:]]
    plain, robust = (
        target_poses(CAMERA, bent, loss=loss, sigma=sigma).T_camera_target[4]
        for loss, sigma in ((None, 1.0), (cauchy(2.385), 0.05))
    )
    error = [np.linalg.norm(T_found[:3, 3] - T[4, :3, 3]) for T_found in (plain, robust)]
    assert error[1] < 0.2 * error[0]


def test_points_that_determine_no_pose_are_refused_by_name() -> None:
    _, seen = views(3, sigma_px=0.1)
    line = seen[1].subset(np.arange(30) < 6)
    with pytest.raises(InputError, match=r"view '1': its 6 points determine no pose"):
        target_poses(CAMERA, [seen[0], line, seen[2]])


def test_a_view_without_points_is_refused_by_name_beside_others() -> None:
    _, seen = views(3, sigma_px=0.1)
    nothing = seen[1].subset(np.zeros(len(seen[1]), dtype=bool))
    for given in ([nothing], [seen[0], nothing], [nothing, seen[2]]):
        with pytest.raises(InputError, match=r"view '1': its 0 points determine no pose"):
            target_poses(CAMERA, given)
