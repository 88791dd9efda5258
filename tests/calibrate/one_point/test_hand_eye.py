"""Hand-eye from one point: exact without noise in both set-ups, as certain as stated with it, refused where blind."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from calibrant.calibrate.one_point.hand_eye import SeenPoint, hand_eye_of_point, widened
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3, so3
from calibrant.perceive.registered_depth.noise import D435

X_TO_HAND = se3.make(so3.exp([2.0, 0.3, -0.4]), [1.2, -0.3, 0.7])
X_IN_HAND = se3.make(so3.exp([0.05, -0.1, 1.5]), [0.03, -0.04, 0.07])
B = np.array([0.01, 0.02, 0.11])
C = np.array([0.5, 0.1, 0.02])


def _poses(rng: np.random.Generator, n: int, *, turn: float = 0.6) -> np.ndarray:
    down = np.diag([1.0, -1.0, -1.0])
    R = np.array([so3.exp(w) @ down for w in rng.uniform(-turn, turn, (n, 3))])
    return se3.make(R, np.array([0.5, 0.0, 0.4]) + rng.uniform(-0.2, 0.2, (n, 3)))


def _points(A: np.ndarray, setup: str) -> np.ndarray:
    if setup == "eye-to-hand":
        return se3.apply(se3.inverse(X_TO_HAND), se3.apply(A, B))
    return se3.apply(se3.inverse(A @ X_IN_HAND), C)


def _truth(setup: str) -> tuple[np.ndarray, np.ndarray]:
    return (X_TO_HAND, B) if setup == "eye-to-hand" else (X_IN_HAND, C)


@pytest.mark.parametrize("setup", ["eye-to-hand", "eye-in-hand"])
@pytest.mark.parametrize("n", [5, 20])
def test_exact_points_give_the_camera_exactly(setup: str, n: int) -> None:
    A = _poses(np.random.default_rng(n), n)
    found = hand_eye_of_point(A, _points(A, setup), setup=setup)
    X, point = _truth(setup)
    assert se3.local(X, found.T) == pytest.approx(np.zeros(6), abs=1e-8)
    assert found.point == pytest.approx(point, abs=1e-8)


def test_points_in_a_plane_still_tell_the_turn() -> None:
    rng = np.random.default_rng(4)
    A = _poses(rng, 12)
    A[:, :3, 3] -= (se3.apply(A, B) - [0, 0, 0.3]) * [0, 0, 1]  # the point stays at one height
    found = hand_eye_of_point(A, _points(A, "eye-to-hand"), setup="eye-to-hand")
    assert se3.local(X_TO_HAND, found.T) == pytest.approx(np.zeros(6), abs=1e-7)


@pytest.mark.statistics
@pytest.mark.parametrize("setup", ["eye-to-hand", "eye-in-hand"])
def test_errors_are_as_large_as_stated(setup: str) -> None:
    """Points as a depth camera sees them: noise along the ray grows with the distance squared, across it by pixels."""
    squares = []
    for seed in range(150):
        rng = np.random.default_rng(seed)
        A = _poses(rng, 20)
        p = _points(A, setup)
        spread = []
        for q in p:
            ray = q / q[2]
            along = float(D435.sigma_z(abs(q[2]))) + 1e-5
            spread.append((0.3 * q[2] / 600) ** 2 * np.eye(3) + along**2 * np.outer(ray, ray))
        noisy = p + np.array([np.linalg.cholesky(S) @ rng.normal(size=3) for S in spread])
        found = hand_eye_of_point(A, noisy, setup=setup, covariances=np.array(spread))
        e = se3.local(_truth(setup)[0], found.T)
        squares.append(e @ np.linalg.solve(found.covariance, e))
    # The mean of 150 chi-squares of 6 has sigma 0.28.
    assert np.mean(squares) == pytest.approx(6.0, abs=0.9)
    assert np.sum(np.array(squares) < chi2.ppf(0.95, 6)) >= 135


def test_more_noise_than_stated_is_told_and_widens() -> None:
    rng = np.random.default_rng(0)
    A = _poses(rng, 20)
    found = hand_eye_of_point(A, _points(A, "eye-to-hand") + rng.normal(0, 3e-3, (20, 3)), setup="eye-to-hand")
    assert found.noise_ratio == pytest.approx(3.0, rel=0.3)
    assert found.chance < 1e-4
    assert np.trace(widened(found).covariance) == pytest.approx(found.noise_ratio**2 * np.trace(found.covariance))


def test_motions_that_tell_nothing_are_refused() -> None:
    rng = np.random.default_rng(1)
    still = _poses(rng, 10, turn=0.0)
    for setup in ("eye-to-hand", "eye-in-hand"):
        with pytest.raises(RefusedError, match="never turned"):
            hand_eye_of_point(still, _points(still, setup), setup=setup)
    one_axis = se3.make(so3.exp(np.outer(rng.uniform(-1, 1, 10), [0, 0, 1.0])), rng.uniform(-0.2, 0.2, (10, 3)))
    with pytest.raises(RefusedError, match="about one axis"):
        hand_eye_of_point(one_axis, _points(one_axis, "eye-to-hand"), setup="eye-to-hand")
    spot = _poses(rng, 10)
    spot[:, :3, 3] += [0.5, 0.0, 0.3] - se3.apply(spot, B)  # the point never moves: turned about itself
    with pytest.raises(RefusedError):
        hand_eye_of_point(spot, _points(spot, "eye-to-hand"), setup="eye-to-hand")


def test_input_that_is_none_is_named() -> None:
    A = _poses(np.random.default_rng(2), 5)
    p = _points(A, "eye-to-hand")
    with pytest.raises(InputError, match="4 poses"):
        hand_eye_of_point(A[:3], p[:3], setup="eye-to-hand")
    with pytest.raises(InputError, match="as many points"):
        hand_eye_of_point(A, p[:4], setup="eye-to-hand")
    with pytest.raises(InputError, match="eye-in-hand or eye-to-hand"):
        hand_eye_of_point(A, p, setup="front")


def test_slopes_are_central_differences() -> None:
    rng = np.random.default_rng(3)
    A = _poses(rng, 4)
    factor = SeenPoint(A, rng.normal(size=(4, 3)), np.tile(np.eye(3), (4, 1, 1)))
    X, c = np.tile(X_IN_HAND, (4, 1, 1)), np.tile(C, (4, 1))
    _, (J_X, J_c) = factor.linearize(X, c)
    h = 1e-6
    for k in range(6):
        d = h * np.eye(6)[k]
        numeric = (factor.residuals(se3.retract(X, d), c) - factor.residuals(se3.retract(X, -d), c)) / (2 * h)
        assert J_X[:, :, k] == pytest.approx(numeric, abs=1e-8)
    for k in range(3):
        d = h * np.eye(3)[k]
        numeric = (factor.residuals(X, c + d) - factor.residuals(X, c - d)) / (2 * h)
        assert J_c[:, :, k] == pytest.approx(numeric, abs=1e-8)
