"""Poses between samples on the geodesic, and the stretches in which a motion stands still."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.geometry.motion import STILL_M, Motion


def turning(times: np.ndarray, rate: float = 0.7) -> Motion:
    axis = np.array([1.0, 2.0, -1.0]) / np.sqrt(6.0)
    return Motion(times, se3.make(so3.exp(rate * times[:, None] * axis), np.outer(times, [0.1, -0.2, 0.05])))


def test_a_constant_screw_is_met_exactly_between_samples() -> None:
    sparse, dense = turning(np.arange(0.0, 3.0, 0.5)), turning(np.arange(0.0, 2.5, 0.01))
    np.testing.assert_allclose(sparse.at(dense.times), dense.T, atol=1e-12)
    np.testing.assert_allclose(sparse.at([-1.0, 9.0]), sparse.T[[0, -1]])
    assert sparse.covers([-0.1, 0.0, 2.5, 2.6]).tolist() == [False, True, True, False]


def held(hold_s: float, move_s: float, hz: float, poses: int = 4, noise_m: float = 0.0) -> Motion:
    corners = np.concatenate([[k * (hold_s + move_s), k * (hold_s + move_s) + hold_s] for k in range(poses)])
    places = np.repeat(np.arange(poses), 2)[:, None] * [[0.05, 0.0, 0.02]]
    path = Motion(corners, se3.make(np.repeat(np.eye(3)[None], len(corners), axis=0), places))
    times = np.arange(0.0, corners[-1] + 1e-9, 1 / hz)
    T = path.at(times).copy()
    T[:, :3, 3] += noise_m * np.random.default_rng(1).standard_normal((len(T), 3))
    return Motion(times, T)


@pytest.mark.parametrize("hz", [5.0, 50.0, 500.0])
def test_every_hold_is_found_and_nothing_between(hz: float) -> None:
    found = held(1.0, 1.0, hz, noise_m=0.02e-3).still()
    assert len(found) == 4
    for k, (begin, end) in enumerate(found):
        assert 2.0 * k - 1e-9 <= begin <= 2.0 * k + 0.25
        assert 2.0 * k + 0.7 <= end <= 2.0 * k + 1.0 + 1e-9


def test_a_slow_motion_is_none_that_stands() -> None:
    times = np.arange(0.0, 5.0, 0.02)
    T = np.repeat(np.eye(4)[None], len(times), axis=0)
    T[:, 0, 3] = 6 * STILL_M * times  # 1.5 times the limit in a window
    assert Motion(times, T).still() == []


def test_snapshots_far_apart_stand_only_where_both_are_one_pose() -> None:
    T = np.repeat(np.eye(4)[None], 4, axis=0)
    T[:, 0, 3] = [0.0, 2e-3, 2e-3, 4e-3]  # so slow between them that no quarter of a second shows it
    assert Motion(np.array([0.0, 10.0, 20.0, 30.0]), T).still() == [(10.0, 20.0)]
    assert Motion(np.array([0.0]), T[:1]).still() == []


def test_times_that_go_back_are_refused() -> None:
    with pytest.raises(InputError, match="increase"):
        Motion(np.array([0.0, 0.0]), np.repeat(np.eye(4)[None], 2, axis=0))
