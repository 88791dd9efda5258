"""Inverse kinematics reach what the arm can reach, and say where they do not."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.errors import InputError
from calibrant.geometry import se3
from calibrant.robots.arms import arm
from calibrant.robots.inverse import solve_inverse

WORKING = np.array([0, -1.2, 1.6, -1, 0.5, 0])
"""An ordinary posture, away from the stretched arm."""


def test_poses_near_the_start_are_reached() -> None:
    chain = arm("ur5e")
    rng = np.random.default_rng(0)
    q = rng.uniform(-1.2, 1.2, size=(40, 6)) + WORKING
    T = chain.forward(q)
    solution = solve_inverse(chain, T, q + rng.uniform(-0.3, 0.3, size=q.shape))
    assert solution.reached.mean() > 0.9  # a few start beside a singular arm
    error = se3.local(chain.forward(solution.q), T)[solution.reached]
    assert np.abs(error).max() < 1e-8


def test_targets_and_starts_broadcast() -> None:
    chain = arm("ur10e")
    q = np.random.default_rng(1).uniform(-1, 1, size=(3, 6)) + WORKING
    starts = q[:, None] + np.array([0.0, 0.1])[None, :, None]
    solution = solve_inverse(chain, chain.forward(q)[:, None], starts)
    assert solution.q.shape == (3, 2, 6)
    assert solution.reached.shape == (3, 2)
    assert np.all(solution.reached[:, 0])


def test_out_of_reach_is_said() -> None:
    solution = solve_inverse(arm("ur5e"), se3.make(np.eye(3), [3.0, 0, 0]), np.zeros(6))
    assert not solution.reached
    assert np.all(arm("ur5e").within_limits(solution.q))


def test_a_pose_that_is_no_transform_is_refused() -> None:
    with pytest.raises(InputError, match="T_base_flange"):
        solve_inverse(arm("ur5e"), 2 * np.eye(4), np.zeros(6))
