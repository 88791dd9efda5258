"""The camera's latency by the arm's own motion."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.errors import RefusedError
from calibrant.geometry import se3, so3
from calibrant.geometry.motion import Motion
from calibrant.servoing.conveyor.latency import latency_from

HAND = se3.make(so3.exp([0.0, 0.0, 1.0]), [0.03, -0.04, 0.06])


def pictures(latency: float, noise: float, seed: int, sway: float = 0.05):
    rng = np.random.default_rng(seed)
    times = np.arange(0, 4, 0.01)

    def gripper(t):
        return se3.make(
            so3.exp(np.stack([0.1 * np.sin(2 * t), 0 * t, 0 * t], axis=-1)) @ so3.exp([np.pi, 0, 0]),
            np.stack([0.4 + sway * np.sin(3 * t), 0.02 * np.cos(2 * t) * sway / 0.05, 0.4 + 0 * t], axis=-1),
        )

    stamps = np.arange(0.5, 3.5, 0.1)
    exposed = stamps - latency
    p = np.array([0.4, 0.05, 0.02]) + exposed[:, None] * np.array([0.0, 0.03, 0.0])
    seen = se3.apply(se3.inverse(gripper(exposed) @ HAND), p)
    return stamps, seen + noise * rng.standard_normal(seen.shape), Motion(times, gripper(times))


def test_it_is_exact_without_noise() -> None:
    stamps, seen, motion = pictures(0.045, 0.0, 0)
    assert latency_from(stamps, seen, motion, HAND).seconds == pytest.approx(0.045, abs=1e-5)


def test_its_sigma_is_right() -> None:
    off = []
    for seed in range(60):
        found = latency_from(*pictures(0.03, 0.001, seed), HAND)
        off.append((found.seconds - 0.03) / found.sigma)
    assert abs(np.std(off) - 1) < 4 / np.sqrt(120)
    assert abs(np.mean(off)) < 4 / np.sqrt(60)


def test_an_arm_that_stands_tells_none() -> None:
    stamps, seen, _ = pictures(0.03, 0.001, 0)
    still = Motion(np.array([0.0, 4.0]), np.stack([np.eye(4)] * 2))
    with pytest.raises(RefusedError, match="to and fro"):
        latency_from(stamps, seen, still, HAND)
    with pytest.raises(RefusedError, match="3 pictures"):
        latency_from(stamps[:3], seen[:3], still, HAND)
