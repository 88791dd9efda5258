"""A tracked object: its pose and speed are as certain as stated, other objects are gated out, symmetries followed."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.perceive.object_pose.poses import ObjectPose
from calibrant.perceive.object_pose.shapes import box
from calibrant.perceive.tracking.filter import LOST, Motion, Track

SPREAD = np.diag([2e-3, 2e-3, 1e-3, 2e-4, 2e-4, 3e-4]) ** 2
SYMMETRIES = box([0.054, 0.037, 0.005]).symmetries
TWIST = np.array([0.0, 0.0, 0.4, 0.15, -0.02, 0.0])


def _truth(t: float) -> np.ndarray:
    return se3.make(so3.exp(t * TWIST[:3]), np.array([0.0, 0.0, 0.4]) + t * TWIST[3:])


def _measured(T: np.ndarray, rng: np.random.Generator) -> ObjectPose:
    """A noisy measurement, as any of the poses that look the same."""
    noisy = se3.retract(T, np.linalg.cholesky(SPREAD) @ rng.normal(size=6))
    return ObjectPose("box", noisy @ SYMMETRIES[rng.integers(4)], SPREAD, SYMMETRIES)


def _tracked(rng: np.random.Generator, n: int = 30) -> Track:
    track = Track.start(_measured(_truth(0.0), rng), 0.0)
    for k in range(1, n):
        track = track.seen(_measured(_truth(k / 15), rng), k / 15)
    return track


def test_speed_and_pose_are_found_and_predicted() -> None:
    track = _tracked(np.random.default_rng(0))
    assert track.accepted
    assert track.twist == pytest.approx(TWIST, abs=0.02)
    assert track.pose.sigma_mm[0] < 0.2  # less than one picture's
    later = track.at(track.time_s + 0.2)
    mm, deg = se3.mm_and_deg(later.pose.error(_truth(later.time_s)))
    assert mm < 1.5
    assert deg < 1.0
    assert later.pose.sigma_mm[0] > track.pose.sigma_mm[0]


@pytest.mark.statistics
def test_errors_are_as_large_as_stated() -> None:
    squares, inside = [], 0
    for seed in range(60):
        rng = np.random.default_rng(seed)
        track = _tracked(rng, 20)
        e = np.concatenate([track.pose.error(_truth(track.time_s)), track.twist - TWIST])
        squares.append(e @ np.linalg.solve(track.covariance, e))
        inside += squares[-1] < chi2.ppf(0.95, 12)
    # The motion is steadier than the filter was told: errors are below what it states, by as much at most.
    assert 0.5 < np.mean(squares) / 12 < 1.15
    assert inside >= 54


def test_a_restless_motion_is_as_uncertain_as_stated() -> None:
    """Accelerations drawn from the filter's own densities: the normalised error is 1."""
    motion, squares = Motion(turn=0.05**2, shift=0.02**2), []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        T, twist, dt = _truth(0.0), TWIST.copy(), 1 / 15
        track = Track.start(_measured(T, rng), 0.0, motion=motion)
        for k in range(1, 15):
            for _ in range(10):
                kick = np.concatenate([rng.normal(0, 0.05, 3), rng.normal(0, 0.02, 3)]) * np.sqrt(dt / 10)
                T = se3.retract(T, dt / 10 * (twist + kick / 2))
                twist = twist + kick
            track = track.seen(_measured(T, rng), k * dt)
        e = np.concatenate([track.pose.error(T), track.twist - twist])
        squares.append(e @ np.linalg.solve(track.covariance, e) / 12)
    # 40 means of 12: sigma 0.065.
    assert np.mean(squares) == pytest.approx(1.0, abs=0.2)


def test_another_object_is_gated_out_and_a_lost_one_told() -> None:
    rng = np.random.default_rng(1)
    track = _tracked(rng)
    t = track.time_s + 1 / 15
    far = _measured(se3.make(np.eye(3), [0.05, 0, 0]) @ _truth(t), rng)
    assert not track.seen(far, t).accepted
    picked = track.one_of([far, _measured(_truth(t), rng)], t)
    assert picked.accepted
    assert picked.pose.error(_truth(t))[3:] == pytest.approx(np.zeros(3), abs=2e-3)
    for k in range(LOST):
        assert not track.lost
        track = track.one_of([], t + k / 15)
    assert track.lost
    assert track.pose.sigma_mm[0] > picked.pose.sigma_mm[0]


def test_time_does_not_run_backwards() -> None:
    track = _tracked(np.random.default_rng(2), 3)
    with pytest.raises(InputError, match="before"):
        track.at(0.0)
    with pytest.raises(InputError, match="above 0"):
        Motion(turn=0.0)
