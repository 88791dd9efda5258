"""F and the relative pose from matches: exact, robust against wrong ones, as certain as stated, refused where open."""

from __future__ import annotations

import numpy as np
import pytest
from tests.perceive.stereo.made import LEFT, RIGHT, T_LEFT_RIGHT, made_eyes, pixels_of, seen_points

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import projective, se3, so3
from calibrant.perceive.stereo.epipolar import fundamental_from_matches, relative_pose

EYES = made_eyes()
BASELINE = float(np.linalg.norm(T_LEFT_RIGHT[:3, 3]))
TRUE = se3.make(T_LEFT_RIGHT[:3, :3], T_LEFT_RIGHT[:3, 3] / BASELINE)
PINHOLE = Camera.create("pinhole", {"fx": 530.0, "fy": 530.0, "cx": 320.0, "cy": 240.0}, image_size=(640, 480))


def _matches(n: int, seed: int) -> Array:
    return pixels_of(EYES, seen_points(EYES, n, np.random.default_rng(seed)))


def test_exact_matches_give_the_exact_pose_and_matrices() -> None:
    found = relative_pose((LEFT, RIGHT), *_matches(40, 1))
    np.testing.assert_allclose(found.T_a_b, TRUE, atol=1e-7)
    X = seen_points(EYES, 60, np.random.default_rng(2))
    T = se3.inverse(T_LEFT_RIGHT)
    uv = PINHOLE.project(X), PINHOLE.project(se3.apply(T, X))
    F = fundamental_from_matches(*uv).F
    true = projective.fundamental_from_transform(T, K_a=PINHOLE.K, K_b=PINHOLE.K)
    np.testing.assert_allclose(F * np.sign(np.sum(F * true)), true, atol=1e-6)
    np.testing.assert_allclose(
        found.E / np.linalg.norm(found.E), projective.essential_from_transform(T) / np.sqrt(2) / BASELINE, atol=1e-7
    )


def test_a_third_of_wrong_matches_is_left_out() -> None:
    rng = np.random.default_rng(3)
    uv = _matches(150, 3) + rng.normal(0, 0.3, (2, 150, 2))
    uv[1, :50] = rng.uniform(0, 480, (50, 2))
    found = relative_pose((LEFT, RIGHT), *uv, sigma_px=0.4)
    assert found.fitting[50:].mean() > 0.97
    assert found.fitting[:50].mean() < 0.2
    _, deg = se3.deviation(found.T_a_b, TRUE)
    assert deg < 0.3
    plain = fundamental_from_matches(*uv, sigma_px=0.4)
    assert plain.fitting[50:].mean() > 0.8
    assert plain.rms_px < 1.0


@pytest.mark.statistics
def test_the_error_is_as_large_as_stated() -> None:
    """200 pairs of pictures, five degrees of freedom: the mean square over sigma is 1 within 4.5 % (1 sigma)."""
    rng = np.random.default_rng(4)
    scores, sigmas = [], []
    for _ in range(200):
        uv = pixels_of(EYES, seen_points(EYES, 80, rng)) + rng.normal(0, 0.3, (2, 80, 2))
        found = relative_pose((LEFT, RIGHT), *uv, sigma_px=0.5)
        error = se3.local(found.T_a_b, TRUE)
        scores.append(float(error @ np.linalg.pinv(found.covariance, rcond=1e-8, hermitian=True) @ error) / 5)
        sigmas.append(found.sigma_px)
    assert np.mean(scores) == pytest.approx(1, abs=0.18)
    assert np.mean(sigmas) == pytest.approx(0.3, rel=0.03)


def test_what_leaves_the_direction_open_is_refused() -> None:
    X = seen_points(EYES, 80, np.random.default_rng(5))
    turned = se3.make(so3.exp([0.0, 0.1, 0.0]), [0.0, 0.0, 0.0])
    rng = np.random.default_rng(6)
    uv = [LEFT.project(X), LEFT.project(se3.apply(turned, X))]
    with pytest.raises(RefusedError, match="a turn alone explains"):
        relative_pose((LEFT, LEFT), *[m + rng.normal(0, 0.3, m.shape) for m in uv])
    wild = rng.uniform(0, 480, (2, 60, 2))
    with pytest.raises(RefusedError):
        relative_pose((LEFT, RIGHT), *wild, sigma_px=0.02)


def test_no_fundamental_matrix_where_a_homography_does() -> None:
    """The same picture twice, a camera that turned, a wall: refused; a wall with things before it is not."""
    rng = np.random.default_rng(6)
    wall = np.column_stack([rng.uniform([-0.5, -0.4], [0.5, 0.4], (120, 2)), np.full(120, 1.5)])
    relief = wall - np.outer(np.arange(120) % 5 == 0, [0, 0, 0.4])
    deep = wall + np.outer(rng.uniform(-0.4, 0.4, 120), [0, 0, 1])
    still, turned = np.eye(4), se3.make(so3.exp([0.02, 0.1, 0.05]), np.zeros(3))
    moved = se3.make(so3.exp([0.02, 0.1, 0.05]), [-0.1, 0.01, 0.02])
    for points, T, noise in ((deep, still, 0.0), (deep, turned, 0.3), (wall, moved, 0.3)):
        uv = np.stack([PINHOLE.project(points), PINHOLE.project(se3.apply(T, points))])
        with pytest.raises(RefusedError, match="one homography holds for the matches"):
            fundamental_from_matches(*(uv + noise * rng.normal(size=uv.shape)))
    for points in (deep, relief):
        uv = np.stack([PINHOLE.project(points), PINHOLE.project(se3.apply(moved, points))])
        assert fundamental_from_matches(*(uv + 0.3 * rng.normal(size=uv.shape))).fitting.mean() > 0.9


def test_bad_input_is_named() -> None:
    uv = _matches(20, 7)
    with pytest.raises(InputError, match="as many of each"):
        relative_pose((LEFT, RIGHT), uv[0], uv[1, :5])
    with pytest.raises(InputError, match="5 matches; at least 8"):
        fundamental_from_matches(uv[0, :5], uv[1, :5])
    with pytest.raises(InputError, match="NaN"):
        relative_pose((LEFT, RIGHT), uv[0] * np.nan, uv[1])
    with pytest.raises(InputError, match="two cameras, got 1"):
        relative_pose((LEFT,), uv[0], uv[1])
