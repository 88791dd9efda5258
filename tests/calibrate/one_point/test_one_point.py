"""Hand-eye from one point: exact without noise, as certain as stated with it, and what cannot be known is named."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.calibrate.one_point.factor import PointFactor
from calibrant.calibrate.one_point.solve import OnePoint, Setup, calibrate_one_point
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3, so3
from calibrant.simulate.truth import normalised

POINT = np.array([0.02, -0.03, 0.12])
SETUPS: tuple[Setup, ...] = ("eye-to-hand", "eye-in-hand")


def cell(setup: Setup, n: int, seed: int, *, tilt: float = 0.5):
    """Poses (n, 4, 4), points (n, 3) as the camera would see them exactly, and the camera's true pose."""
    rng = np.random.default_rng(seed)
    down = np.diag([1.0, -1.0, -1.0])
    if setup == "eye-to-hand":
        R = so3.exp(tilt * rng.normal(size=(n, 3))) @ down
        T = se3.make(R, np.array([0.45, 0.0, 0.35]) + rng.uniform(-0.15, 0.15, size=(n, 3)))
        camera = se3.make(so3.exp([0.1, 0.2, 0.05]) @ np.array([[0, 0, -1.0], [1, 0, 0], [0, -1, 0]]), [1.4, 0.1, 0.3])
        return T, se3.apply(se3.inverse(camera) @ T, POINT), camera
    camera = se3.make(so3.exp([0.03, -0.05, 1.5]), [0.03, -0.04, 0.07])
    scene = np.array([0.5, 0.05, 0.0])
    R = so3.exp(0.5 * tilt * rng.normal(size=(n, 3))) @ down
    T = se3.make(R, scene + np.array([0.0, 0.0, 0.5]) + rng.uniform(-0.1, 0.1, size=(n, 3)))
    return T, se3.apply(se3.inverse(T @ camera), scene), camera


def noisy(q: np.ndarray, rng: np.random.Generator, *, scale: float = 0.0) -> np.ndarray:
    """As a D435 measures: 0.3 px of 617 across, 0.08 px of disparity along, and a common factor."""
    z = q[:, 2]
    d = q / np.linalg.norm(q, axis=1, keepdims=True)
    off = rng.normal(size=q.shape) * (0.3 / 617 * z)[:, None]
    along = rng.normal(size=len(q)) * z**2 * 0.08 / (617 * 0.05)
    off += (along - np.sum(off * d, axis=1))[:, None] * d
    return (1 + scale) * q + off


@pytest.mark.parametrize("setup", SETUPS)
@pytest.mark.parametrize("n", [6, 20])
def test_exact_without_noise(setup: Setup, n: int) -> None:
    T, q, camera = cell(setup, n, 1)
    found = calibrate_one_point(T, 1.013 * q if n == 20 else q, setup=setup, scale_sigma=0.02)
    np.testing.assert_allclose(found.transform.matrix, camera, atol=1e-8)
    assert found.scale == pytest.approx(0.013 if n == 20 else 0.0, abs=1e-8)
    assert found.used.all()
    where = POINT if setup == "eye-to-hand" else [0.5, 0.05, 0.0]
    np.testing.assert_allclose(found.point, where, atol=1e-8)


def test_points_in_a_plane_are_enough() -> None:
    T, q, camera = cell("eye-to-hand", 12, 2)
    flat = q.copy()
    flat[:, 2] = 1.0
    # The gripper is moved along so that the point is where the camera shall see it.
    T = T.copy()
    T[:, :3, 3] += se3.apply(camera, flat) - se3.apply(camera, q)
    found = calibrate_one_point(T, flat, scale_sigma=0.0)
    np.testing.assert_allclose(found.transform.matrix, camera, atol=1e-8)


def test_jacobians_agree_with_differences() -> None:
    T, q, camera = cell("eye-to-hand", 5, 3)
    rng = np.random.default_rng(0)
    factor = PointFactor("p", T, q, rng.normal(size=(5, 2, 3)), noise="n")
    X, p, k = np.repeat(camera[None], 5, 0), np.tile(POINT + 0.01, (5, 1)), np.full((5, 1), 0.02)
    _, J = factor.linearize(X, p, k)
    step = 1e-6

    def differences(moved, size: int) -> np.ndarray:
        columns = [
            (factor.residuals(*moved(step * e)) - factor.residuals(*moved(-step * e))) / (2 * step)
            for e in np.eye(size)
        ]
        return np.stack(columns, axis=2)

    np.testing.assert_allclose(J[0], differences(lambda d: (se3.retract(X, d), p, k), 6), atol=1e-8)
    np.testing.assert_allclose(J[1], differences(lambda d: (X, p + d, k), 3), atol=1e-8)
    np.testing.assert_allclose(J[2], differences(lambda d: (X, p, k + d), 1), atol=1e-8)


@pytest.mark.parametrize("setup", SETUPS)
def test_gross_errors_are_set_aside(setup: Setup) -> None:
    T, q, camera = cell(setup, 20, 4)
    rng = np.random.default_rng(5)
    q = noisy(q, rng)
    bad = [2, 7, 11, 16]
    q[bad] += rng.choice([-1, 1], size=(4, 3)) * [0.05, 0.1, 0.2]
    found = calibrate_one_point(T, q, setup=setup)
    assert not found.used[bad].any()
    assert found.used.sum() >= 15
    # 99.9 % of chi-square with six degrees of freedom.
    assert normalised(found.transform, camera) < 22.5


def test_what_cannot_be_known_is_named() -> None:
    T, q, camera = cell("eye-to-hand", 12, 6)
    still = T.copy()
    still[:, :3, :3] = T[0, :3, :3]
    see = se3.inverse(camera)
    with pytest.raises(RefusedError, match="same orientation"):
        calibrate_one_point(still, se3.apply(see @ still, POINT))
    turned = still.copy()
    turned[:, :3, :3] = T[0, :3, :3] @ so3.exp(np.linspace(-1, 1, 12)[:, None] * [0.0, 0.0, 1.0])
    with pytest.raises(RefusedError, match=r"one axis, \(.0.00, .0.00, .1.00\) in the gripper"):
        calibrate_one_point(turned, se3.apply(see @ turned, POINT))
    line = T.copy()
    line[:, :3, 3] += np.linspace(-0.2, 0.2, 12)[:, None] * [0, 1.0, 0] + [0.4, 0, 0.3] - se3.apply(T, POINT)
    with pytest.raises(RefusedError, match="in a line"):
        calibrate_one_point(line, se3.apply(see @ line, POINT))
    q_line = noisy(se3.apply(see @ line, POINT), np.random.default_rng(0))
    with pytest.raises(RefusedError, match="nearly in a line"):
        calibrate_one_point(line, q_line)
    one = T.copy()
    one[:, :3, 3] += [0.4, 0, 0.3] - se3.apply(T, POINT)
    with pytest.raises(RefusedError, match="at one place"):
        calibrate_one_point(one, se3.apply(see @ one, POINT))
    with pytest.raises(RefusedError, match=r"belong together|poses agree on one point"):
        calibrate_one_point(T, q[np.random.default_rng(1).permutation(12)])
    with pytest.raises(InputError, match="z > 0"):
        calibrate_one_point(T, -q)
    with pytest.raises(InputError, match="at least 6"):
        calibrate_one_point(T[:5], q[:5])


def _errors(setup: Setup, trials: int, *, stated: bool, n: int = 15) -> tuple[list[float], list[float], list[float]]:
    chi2, point, scale = [], [], []
    for seed in range(trials):
        T, q, camera = cell(setup, n, 100 + seed)
        rng = np.random.default_rng(seed)
        k = 0.02 * rng.normal()
        C = None
        if stated:
            z, d = q[:, 2], q / np.linalg.norm(q, axis=1, keepdims=True)
            dd = d[:, :, None] * d[:, None, :]
            across, along = (0.3 / 617 * z) ** 2, (z**2 * 0.08 / (617 * 0.05)) ** 2
            C = across[:, None, None] * (np.eye(3) - dd) + along[:, None, None] * dd
        found: OnePoint = calibrate_one_point(T, noisy(q, rng, scale=k), setup=setup, covariances=C)
        chi2.append(normalised(found.transform, camera))
        e = found.point - (POINT if setup == "eye-to-hand" else [0.5, 0.05, 0.0])
        point.append(float(e @ np.linalg.solve(found.point_covariance, e)))
        scale.append((found.scale - k) / found.scale_sigma)
    return chi2, point, scale


@pytest.mark.statistics
@pytest.mark.parametrize("setup", SETUPS)
@pytest.mark.parametrize("stated", [True, False])
def test_errors_are_as_large_as_stated(setup: Setup, stated: bool) -> None:
    """Mean of chi-square with d degrees over N trials: d within 4 of its own sigmas, sqrt(2 d / N)."""
    trials = 60
    chi2, point, scale = _errors(setup, trials, stated=stated)
    # Levels that are estimated of few residuals spread chi-square by Student's t, 30 % wider.
    for values, d in ((chi2, 6), (point, 3), (np.square(scale), 1)):
        assert np.mean(values) == pytest.approx(d, abs=4 * np.sqrt(2 * d / trials) * 1.3)
