"""The filter of moving things: exact on exact data, its covariance right on noisy ones."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.servoing.conveyor.tracker import FLAT_RAD, Unsteadiness, first_seen, laid_flat, on_plane

UP = np.array([0.0, 0.0, 1.0])
STEADY = Unsteadiness(1e-6, 1e-6)


def moving(t: float, rate: np.ndarray, first: np.ndarray) -> np.ndarray:
    return se3.retract(first, rate * t)


@pytest.mark.parametrize("normal", [None, UP], ids=["space", "belt"])
def test_even_motion_is_found_exactly(normal: np.ndarray | None) -> None:
    rate = np.array([0, 0, 0.5, 0.1, -0.05, 0.0]) if normal is not None else np.array([0.1, 0.2, 0.5, 0.1, -0.05, 0.02])
    first, C = se3.make(so3.exp([0.0, 0.0, 0.3]), [0.4, 0.1, 0.02]), 1e-12 * np.eye(6)
    tracked = first_seen(first, C, 0.0, normal=normal, unsteadiness=STEADY)
    for k in range(1, 20):
        tracked = tracked.measured(moving(0.05 * k, rate, first), C, 0.05 * k)
    np.testing.assert_allclose(tracked.rate, rate, atol=1e-5)
    np.testing.assert_allclose(tracked.at(1.5).T_base_object, moving(1.5, rate, first), atol=1e-5)


def test_errors_are_as_large_as_the_covariance_says() -> None:
    rng = np.random.default_rng(0)
    rate, first = np.array([0, 0, -0.4, 0.02, 0.15, 0.0]), se3.make(np.eye(3), [0.4, -0.2, 0.02])
    sigma = np.r_[np.full(3, 0.01), np.full(3, 0.002)]
    D = on_plane(UP)
    basis = np.block([[np.eye(6), np.zeros((6, 3))], [np.zeros((6, 6)), D]])
    squares = []
    for _ in range(60):
        noisy = [se3.retract(moving(0.05 * k, rate, first), sigma * rng.standard_normal(6)) for k in range(15)]
        tracked = first_seen(noisy[0], np.diag(sigma**2), 0.0, normal=UP, unsteadiness=STEADY)
        for k in range(1, 15):
            tracked = tracked.measured(noisy[k], np.diag(sigma**2), 0.05 * k)
        off = np.r_[se3.local(tracked.T_base_object, moving(0.7, rate, first)), rate - tracked.rate] @ basis
        squares.append(off @ np.linalg.solve(basis.T @ tracked.covariance @ basis, off))
    # chi-square of 9: mean 9, sigma of the mean of 60 is sqrt(18 / 60)
    assert abs(np.mean(squares) - 9) < 4 * np.sqrt(18 / 60)


def test_what_is_none_of_the_things_is_left_out() -> None:
    C = np.diag(np.r_[np.full(3, 1e-4), np.full(3, 1e-6)])
    tracked = first_seen(np.eye(4), C, 0.0)
    for k in range(1, 10):
        tracked = tracked.measured(se3.make(np.eye(3), [0.01 * k, 0, 0]), C, 0.1 * k)
    after = tracked.measured(se3.make(np.eye(3), [0.5, 0.5, 0]), C, 1.0)
    assert after.misses == 1
    assert np.allclose(after.rate, tracked.rate)


def test_a_thing_that_lies_flat_is_placed_better_by_that() -> None:
    # Tilt and place err together, as a small tag's do: 20 mrad go with 2 mm.
    crossed = 0.002 * np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 0]])
    J = np.block([[0.02 * np.eye(3), np.zeros((3, 3))], [crossed, 2e-4 * np.eye(3)]])
    C, rng = J @ J.T, np.random.default_rng(1)
    flat = se3.make(so3.exp([0, 0, 0.4]), [0.1, 0.2, 0.3])
    off, raw = [], []
    for draw in rng.standard_normal((200, 6)) @ J.T:
        truth = se3.retract(flat, np.r_[FLAT_RAD * rng.standard_normal(2), 0, 0, 0, 0])
        T, predicted = laid_flat(se3.retract(truth, draw), C, UP)
        off.append(se3.local(truth, T)[3:5])
        raw.append(draw[3:5])
    assert np.std(off) < 0.35 * np.std(raw)
    np.testing.assert_allclose(np.std(off, axis=0), np.sqrt(np.diag(predicted))[3:5], rtol=0.2)


def test_a_normal_without_length_is_refused() -> None:
    with pytest.raises(InputError, match="normal"):
        on_plane(np.zeros(3))
