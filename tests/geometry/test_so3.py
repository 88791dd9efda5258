from __future__ import annotations

import numpy as np
import pytest

from calibrant.errors import InputError
from calibrant.geometry import so3


def test_hat_is_the_cross_product() -> None:
    a, b = np.random.default_rng(1).normal(size=(2, 5, 3))
    np.testing.assert_allclose(np.einsum("nij,nj->ni", so3.hat(a), b), np.cross(a, b), atol=1e-15)


def test_exp_turns_right_handed() -> None:
    np.testing.assert_allclose(so3.exp([0, 0, np.pi / 2]) @ [1, 0, 0], [0, 1, 0], atol=1e-15)


@pytest.mark.parametrize("axis", [*np.eye(3).tolist(), [0.6, 0, -0.8], [-0.6, 0.48, 0.64]])
def test_half_turn_keeps_its_axis(axis: list[float]) -> None:
    omega = so3.log(so3.exp(np.pi * np.array(axis)))
    # At pi both senses name one rotation: the axis is determined up to its sign.
    np.testing.assert_allclose(np.abs(omega @ axis), np.pi, atol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(omega), np.pi, atol=1e-14)


def test_mean_of_two_is_half_way() -> None:
    R, omega = so3.exp([0.3, -2.0, 0.5]), np.array([0.4, 0.1, -0.9])
    np.testing.assert_allclose(so3.mean([R, so3.exp(omega) @ R]), so3.exp(omega / 2) @ R, atol=1e-14)


def test_mean_of_two_with_weights_divides_the_arc() -> None:
    omega = np.array([0.4, 0.1, -0.9])
    mean = so3.mean([np.eye(3), so3.exp(omega)], weights=[3.0, 1.0])
    np.testing.assert_allclose(so3.log(mean), omega / 4, atol=1e-14)


def test_mean_balances_the_logs_and_follows_the_frame() -> None:
    rng = np.random.default_rng(2)
    R = so3.exp(rng.normal(size=(20, 3)) * 0.5) @ so3.random(rng, 1)
    mean, Q = so3.mean(R), so3.random(rng, 1)[0]
    np.testing.assert_allclose(so3.log(R @ mean.T).sum(axis=0), 0, atol=1e-13)
    np.testing.assert_allclose(so3.mean(Q @ R), Q @ mean, atol=1e-13)
    np.testing.assert_allclose(so3.mean(R @ Q), mean @ Q, atol=1e-13)


def test_mean_of_nothing_is_refused() -> None:
    with pytest.raises(InputError, match=r"n >= 1"):
        so3.mean(np.empty((0, 3, 3)))


def test_nearest_beats_every_neighbour() -> None:
    rng = np.random.default_rng(3)
    M = so3.random(rng, 1)[0] + 0.2 * rng.normal(size=(3, 3))
    best = so3.nearest(M)
    neighbours = so3.exp(0.01 * rng.normal(size=(200, 3))) @ best
    assert np.all(np.linalg.norm(neighbours - M, axis=(1, 2)) > np.linalg.norm(best - M))


def test_nearest_of_a_mirror_is_a_rotation() -> None:
    assert so3.is_rotation(so3.nearest(np.diag([1.0, 1.0, -1.0])))


def test_random_is_uniform_in_direction() -> None:
    R = so3.random(np.random.default_rng(4), 4000)
    # The mean of 4000 uniform rotations is 0 within 1 / sqrt(3 * 4000) = 0.009 an element; 5 sigma.
    assert np.abs(R.mean(axis=0)).max() < 0.046


@pytest.mark.parametrize(
    "M", [np.diag([1.0, 1.0, -1.0]), 1.001 * np.eye(3), np.full((3, 3), np.nan)], ids=["mirror", "scaled", "nan"]
)
def test_is_rotation_says_no(M: np.ndarray) -> None:
    assert not so3.is_rotation(M)
