"""Sigma of a pose from one view whose neighbouring points err alike."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibrant.arrays import Array
from calibrant.calibrate.pose.both_solutions import view_poses
from calibrant.calibrate.pose.shared_errors import with_shared_errors
from calibrant.data import View
from calibrant.geometry import se3
from calibrant.simulate.scenes import grid, look_at_board, observe, standard_camera
from calibrant.simulate.truth import chi_square

POINTS = grid(11, 8, 0.03)


def _waved(view: View, rng: np.random.Generator) -> View:
    """Pixels moved by a wave over the board as large as the noise: a sheet not flat, a lens not quite fitted."""
    across = view.points[:, :2] / POINTS[:, 0].max()
    along = rng.normal(size=2)
    phase = across @ (2 * rng.uniform(2, 5) * along / np.linalg.norm(along)) + rng.uniform(0, 2 * np.pi)
    direction = rng.uniform(0, 2 * np.pi)
    wave = 0.1 * np.sqrt(2) * np.sin(phase)[:, None] * [np.cos(direction), np.sin(direction)]
    return replace(view, uv=view.uv + wave)


def _normalised(waved: bool, seeds: int) -> tuple[Array, Array]:
    """e^T C^-1 e over 6 of poses from one view each, and how much wider sigma is than with independent points."""
    camera, found, times = standard_camera(), [], []
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        T = look_at_board(camera, POINTS, 1, rng=rng)
        (view,) = observe(camera, POINTS, T, sigma_px=0.1, rng=rng).views
        (pose,) = view_poses(camera, [_waved(view, rng) if waved else view]).views
        found.append(chi_square(se3.local(pose.best.T_camera_target, T[0]), pose.best.covariance) / 6)
        times.append(pose.best.times)
    return np.array(found), np.array(times)


def test_a_wave_over_the_board_is_in_sigma() -> None:
    clean, _ = _normalised(False, 10)
    waved, times = _normalised(True, 10)
    assert np.median(times) > 1.3
    assert np.median(waved) < 3 * np.median(clean)


def test_few_points_share_nothing() -> None:
    C = np.diag([1e-6, 1e-6, 1e-6, 1e-4, 1e-4, 1e-4])
    rng = np.random.default_rng(0)
    J, r = rng.normal(size=(12, 2, 6)), rng.normal(size=(12, 2))
    assert with_shared_errors(C, J, r, rng.normal(size=(12, 3))) is C


@pytest.mark.statistics
@pytest.mark.parametrize(("waved", "most", "wider"), [(False, 1.1, 1.12), (True, 2.0, 3.0)])
def test_poses_err_as_stated(waved: bool, most: float, wider: float) -> None:
    found, times = _normalised(waved, 200)
    assert np.mean(found) < most
    assert np.mean(times) < wider
