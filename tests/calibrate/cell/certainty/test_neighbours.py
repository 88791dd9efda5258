"""Errors that neighbours share: seen where they are, held by sigma, and not seen where there are none."""

from __future__ import annotations

import numpy as np
import pytest

import calibrant as cb
from calibrant.arrays import Array
from calibrant.calibrate.cell.calibrate import fit_cell
from calibrant.calibrate.cell.certainty.alike import LEFT, MOST_COLUMNS, by_order, by_place
from calibrant.calibrate.cell.problem.layout import ONLY_ROBOT, Pictures, TargetPoses, variable
from calibrant.geometry import se3, so3
from calibrant.simulate.scenes import hand_eye_scene
from calibrant.simulate.truth import chi_square


def test_roots_give_their_kernels_back() -> None:
    n = 40
    F = by_order(n, 5.0)
    K = np.exp(-0.5 * (np.subtract.outer(np.arange(n), np.arange(n)) / 5.0) ** 2)
    np.testing.assert_allclose(F @ F.T, K, atol=LEFT)
    T = np.array([se3.make(so3.exp(np.array([0, 0, a])), np.array([a, 0, 0])) for a in np.linspace(0, 1, 9)])
    F = by_place(T, metres=0.5, radians=0.7)
    assert (F @ F.T)[0, 8] == pytest.approx(np.exp(-0.5 * (4 + 4 * np.sin(0.5) ** 2 / 0.49)), abs=LEFT)


def test_a_long_order_is_taken_in_stretches() -> None:
    F = by_order(10 * MOST_COLUMNS, 2.0)
    assert F.shape[1] <= MOST_COLUMNS
    np.testing.assert_array_equal(F[0], F[9])


def _errors_of_poses(n: int, rng: np.random.Generator, memory: float) -> Array:
    """Errors (n, 6) of 0.5 mm and 0.05 degrees, each with this share of the one before."""
    e = rng.normal(size=(n, 6))
    for i in range(1, n):
        e[i] = memory * e[i - 1] + np.sqrt(1 - memory**2) * e[i]
    return e * np.array([np.deg2rad(0.05)] * 3 + [5e-4] * 3)


def _calibrated(seed: int, memory: float, n: int = 24) -> tuple[float, float]:
    """The normalised error of the camera over 6 of a fit of target poses, and how likely errors are shared."""
    scene, rng = hand_eye_scene("exact", views=n, seed=seed), np.random.default_rng(seed)
    e = _errors_of_poses(n, rng, memory)
    A = np.array([T @ se3.make(so3.exp(d[:3]), d[3:]) for T, d in zip(scene.T_base_gripper, e)])
    ids = tuple(str(i) for i in range(n))
    seen = TargetPoses(ids, scene.T_camera_target)
    fit = fit_cell(cb.RobotPoses(ids, A), [Pictures("camera", "eye-in-hand", seen)])
    name = variable(fit.cell.layout.unknown[0])
    solution = fit.noise.solution
    off = se3.local(scene.X, solution.value(name)[0])
    return chi_square(off, solution.covariance(name)) / 6, fit.certainty.poses.shared[ONLY_ROBOT].chance


@pytest.mark.statistics
def test_sigma_holds_errors_that_neighbours_share_and_is_as_it_was_without() -> None:
    shared = np.array([_calibrated(seed, 0.9) for seed in range(30)])
    alone = np.array([_calibrated(seed, 0.0) for seed in range(30)])
    assert shared[:, 0].mean() < 1.5  # 4 with the noise levels alone
    assert np.median(shared[:, 1]) > 0.99
    assert 0.6 < alone[:, 0].mean() < 1.2
    assert np.median(alone[:, 1]) < 0.3
