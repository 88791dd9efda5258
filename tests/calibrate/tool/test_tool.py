"""Tool tips by touch and by sight: exact without noise, errors as large as predicted with it, refusals by name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import chi2

from calibrant.calibrate.tool.tip import ToolTip, tip_by_sight, tip_by_touch
from calibrant.data import TransformEstimate, as_transform
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3, so3
from calibrant.simulate.scenes import standard_camera
from calibrant.simulate.truth import chi_square

Array = NDArray[np.float64]
TIP, POINT = np.array([0.012, -0.034, 0.151]), np.array([0.5, 0.1, 0.05])
CAMERA_AT = se3.make(so3.exp([np.pi, 0, 0]), [0.5, 0.0, 1.0])


def touching(n: int, rng: np.random.Generator, *, tilt: float = 0.6) -> Array:
    """Flange poses (n, 4, 4) whose tip rests on POINT."""
    R = so3.exp([np.pi, 0, 0]) @ so3.exp(tilt * rng.uniform(-1, 1, (n, 3)))
    return se3.make(R, POINT - R @ TIP)


def swinging(n: int, rng: np.random.Generator) -> Array:
    """Flange poses with the tip in different places in view of the camera."""
    R = so3.exp([np.pi, 0, 0]) @ so3.exp(0.7 * rng.uniform(-1, 1, (n, 3)))
    return se3.make(R, rng.uniform((0.35, -0.15, 0.25), (0.65, 0.15, 0.45), (n, 3)))


def seen(poses: Array, T_base_camera: Array = CAMERA_AT) -> Array:
    return standard_camera().project(se3.apply(se3.inverse(T_base_camera) @ poses, TIP))


def test_touch_is_exact_without_noise() -> None:
    found = tip_by_touch(touching(4, np.random.default_rng(0)))
    np.testing.assert_allclose(found.tip, TIP, atol=1e-12)
    assert found.point is not None
    np.testing.assert_allclose(found.point, POINT, atol=1e-12)
    assert found.residuals.max() < 1e-9


@pytest.mark.statistics
def test_touch_errors_are_as_large_as_predicted() -> None:
    rng, sigma, n = np.random.default_rng(1), 2e-4, 8
    poses = touching(n, rng)
    squares, levels = [], []
    for _ in range(300):
        noisy = poses.copy()
        noisy[:, :3, 3] += sigma * rng.standard_normal((n, 3))
        found = tip_by_touch(noisy)
        error = found.tip - TIP
        # With the true level: its estimate from 18 spare residuals makes the ratio an F instead of a chi-square.
        true = found.covariance * (sigma * 1e3 / found.sigma) ** 2 * (16 / 18)
        squares.append(chi_square(error, true))
        levels.append(found.sigma**2)
    low, high = chi2.ppf([0.0005, 0.9995], 3 * len(squares))
    assert low < np.sum(squares) < high
    assert np.sqrt(np.mean(levels)) == pytest.approx(1e3 * sigma, rel=0.05)


@pytest.mark.statistics
@pytest.mark.parametrize("n", [4, 6])
def test_few_touches_are_as_certain_as_stated(n: int) -> None:
    rng = np.random.default_rng(n)
    poses, squares, flagged = touching(n, rng), [], 0
    for _ in range(400):
        noisy = poses.copy()
        noisy[:, :3, 3] += 2e-4 * rng.standard_normal((n, 3))
        found = tip_by_touch(noisy)
        error = found.tip - TIP
        squares.append(chi_square(error, found.covariance) / 3)
        flagged += found.chances.min() < 0.01 / n
    # Six spare residuals of four touches: 1.5 without Student's widening. The mean scatters by 0.11 (heavy tails).
    assert 0.75 < np.mean(squares) < 1.3
    assert flagged < 12  # once in a hundred: 4 of 400, more than 11 by chance once in a thousand


def test_a_touch_that_slipped_is_named() -> None:
    rng = np.random.default_rng(9)
    poses = touching(8, rng)
    poses[:, :3, 3] += 1e-4 * rng.standard_normal((8, 3))
    poses[3, :3, 3] += [0.0, 0.0, 0.002]
    found = tip_by_touch(poses)
    assert np.argmin(found.chances) == 3
    assert found.chances[3] < 1e-6
    assert np.delete(found.chances, 3).min() > 0.01


def test_orientations_too_alike_are_refused_by_name() -> None:
    rng = np.random.default_rng(2)
    same = np.tile(touching(1, rng), (5, 1, 1))
    with pytest.raises(RefusedError, match="same orientation"):
        tip_by_touch(same)
    down = so3.exp([np.pi, 0, 0])
    R = np.array([down @ so3.exp([0, 0, a]) for a in np.linspace(0, 2, 6)])
    with pytest.raises(RefusedError, match=r"one axis, \(\+0.00, \+0.00, [+-]1.00\)|one axis, \([+-]0.00, [+-]0.00"):
        tip_by_touch(se3.make(R, POINT - R @ TIP))
    with pytest.raises(InputError, match="3 touches; at least 4"):
        tip_by_touch(touching(3, rng))


def camera_estimate(sigma_rotation: float, sigma_translation: float) -> TransformEstimate:
    return as_transform("base", "camera", CAMERA_AT, np.diag([sigma_rotation**2] * 3 + [sigma_translation**2] * 3))


def test_sight_is_exact_without_noise() -> None:
    poses = swinging(4, np.random.default_rng(3))
    found = tip_by_sight(poses, seen(poses), camera=standard_camera(), base_camera=camera_estimate(0, 0))
    np.testing.assert_allclose(found.tip, TIP, atol=1e-9)
    assert found.residuals.max() < 1e-6


@pytest.mark.statistics
def test_sight_errors_are_as_large_as_predicted() -> None:
    rng, n, camera = np.random.default_rng(4), 10, standard_camera()
    poses = swinging(n, rng)
    squares = []
    for _ in range(200):
        estimate = camera_estimate(5e-4, 5e-4)
        truth = se3.retract(CAMERA_AT, 5e-4 * rng.standard_normal(6))
        pixels = seen(poses, truth) + 0.2 * rng.standard_normal((n, 2))
        found: ToolTip = tip_by_sight(poses, pixels, camera=camera, base_camera=estimate)
        error = found.tip - TIP
        squares.append(chi_square(error, found.covariance))
    # 200 trials of 3 degrees of freedom scatter by 0.17 about 3, the noise from 17 residuals adds to it.
    assert np.mean(squares) == pytest.approx(3.0, abs=0.6)
    assert 0.5 < found.of_camera < 1


def test_an_error_of_lens_and_place_that_cancel_costs_nothing() -> None:
    # The principal point is off, and the camera was found turned so that it sees as before: known only together.
    rng, camera = np.random.default_rng(6), standard_camera()
    poses, k = swinging(8, rng), len(camera.values)
    direction = np.zeros(6 + k)
    direction[1], direction[6 + list(camera.model.parameter_names).index("cx")] = 1e-3, -1.1
    joint = np.outer(direction, direction) + 1e-12 * np.eye(6 + k)
    pixels = seen(poses) + 0.1 * rng.standard_normal((8, 2))
    alone = replace(camera, covariance=np.diag(np.diag(joint)[6:]))
    estimate = as_transform("base", "camera", CAMERA_AT, np.diag(np.diag(joint)[:6]))
    apart = tip_by_sight(poses, pixels, camera=alone, base_camera=estimate)
    together = tip_by_sight(poses, pixels, camera=alone, base_camera=estimate, covariance=joint)
    assert np.trace(together.covariance) < 0.5 * np.trace(apart.covariance)
    with pytest.raises(InputError, match=r"place and camera is \(15, 15\)"):
        tip_by_sight(poses, pixels, camera=camera, base_camera=estimate, covariance=np.eye(6))


def test_unusable_sights_are_refused_by_name() -> None:
    rng, camera, estimate = np.random.default_rng(5), standard_camera(), camera_estimate(0, 0)
    poses = swinging(4, rng)
    with pytest.raises(InputError, match="at least 3"):
        tip_by_sight(poses[:2], seen(poses[:2]), camera=camera, base_camera=estimate)
    with pytest.raises(InputError, match="need 4 finite pixels"):
        tip_by_sight(poses, seen(poses)[:3], camera=camera, base_camera=estimate)
    still = np.tile(poses[:1], (4, 1, 1))
    with pytest.raises(RefusedError, match="turn the tool"):
        tip_by_sight(still, seen(still), camera=camera, base_camera=estimate)
