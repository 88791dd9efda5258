"""Loop errors: figures worked out by hand, and medians that a minority of wrong views cannot move."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from calibrant.calibrate.solvers.loop_errors import loop_consistency, loop_errors
from calibrant.calibrate.solvers.relative import pose_pairs
from calibrant.errors import InputError
from calibrant.geometry import se3, so3

Array = NDArray[np.float64]


def loop_with_errors(delta: Array, seed: int = 0) -> tuple[Array, Array, Array, Array]:
    """A, B, X, Z with A_i X B_i = retract(Z, delta_i)."""
    rng = np.random.default_rng(seed)
    A = se3.make(so3.random(rng, len(delta)), rng.normal(scale=0.3, size=(len(delta), 3)))
    X, Z = se3.make(so3.random(rng, 2), rng.normal(scale=0.3, size=(2, 3)))
    return A, se3.inverse(X) @ se3.inverse(A) @ se3.retract(Z, delta), X, Z


def test_closed_loop_is_zero() -> None:
    A, B, X, Z = loop_with_errors(np.zeros((7, 6)))
    loop = loop_errors(A, B, X)
    assert max(loop.rms_mm, loop.rms_deg) < 1e-10
    np.testing.assert_allclose(loop.Z, Z, atol=1e-12)
    robust = loop_consistency(A, B, X)
    assert max(robust.median_mm, robust.median_deg, robust.score) < 1e-9


def test_known_spread() -> None:
    # Two views off by +3 mm and -3 mm along x and by +2 and -2 degrees about z, two not at all: mean Z unchanged.
    delta = np.zeros((4, 6))
    delta[:2, 3], delta[:2, 2] = [3e-3, -3e-3], np.deg2rad([2.0, -2.0])
    A, B, X, Z = loop_with_errors(delta)
    loop = loop_errors(A, B, X)
    np.testing.assert_allclose(loop.Z, Z, atol=1e-12)
    np.testing.assert_allclose(loop.view_mm, [3, 3, 0, 0], atol=1e-9)
    np.testing.assert_allclose(loop.view_deg, [2, 2, 0, 0], atol=1e-9)
    assert loop.rms_mm == pytest.approx(3 / np.sqrt(2))
    assert loop.rms_deg == pytest.approx(2 / np.sqrt(2))


def test_a_third_of_wrong_views_does_not_move_the_medians() -> None:
    rng = np.random.default_rng(1)
    delta = rng.normal(size=(15, 6)) * np.array([1e-3] * 3 + [1e-3] * 3)
    clean = loop_consistency(*loop_with_errors(delta)[:3])
    delta[:5, 2], delta[:5, 3] = np.pi, 0.5
    A, B, X, Z = loop_with_errors(delta)
    robust = loop_consistency(A, B, X)
    # A third of outliers on one side moves a median within the noise, by about its own size.
    assert robust.median_mm < 3 * clean.median_mm
    assert robust.median_deg < 3 * clean.median_deg
    assert np.linalg.norm(robust.Z[:3, 3] - Z[:3, 3]) < 2e-3
    assert set(np.argsort(robust.view_mm)[-5:]) == set(range(5))
    assert loop_errors(A, B, X).rms_mm > 100


def test_score_ranks_a_right_transform_far_before_wrong_ones() -> None:
    rng = np.random.default_rng(2)
    A, B, X, _ = loop_with_errors(rng.normal(scale=1e-3, size=(20, 6)))
    assert loop_consistency(A, B, X).score < 0.02
    for wrong in se3.make(so3.random(rng, 10), rng.normal(scale=0.3, size=(10, 3))):
        assert loop_consistency(A, B, wrong).score > 0.1


def test_score_does_not_depend_on_the_unit() -> None:
    rng = np.random.default_rng(3)
    A, B, X, _ = loop_with_errors(rng.normal(scale=1e-3, size=(20, 6)))
    millimetres = np.ones((4, 4))
    millimetres[:3, 3] = 1e3
    scaled = loop_consistency(A * millimetres, B * millimetres, X * millimetres).score
    assert scaled == pytest.approx(loop_consistency(A, B, X).score, rel=1e-6)


def test_bad_input_is_named() -> None:
    A, B, X, _ = loop_with_errors(np.zeros((4, 6)))
    with pytest.raises(InputError, match="at least one view"):
        loop_errors(A[:0], B[:0], X)
    with pytest.raises(InputError, match="4 poses A of the robot but 3"):
        loop_consistency(A, B[:3], X)
    with pytest.raises(InputError, match="X: the upper left"):
        loop_errors(A, B, 2 * X - np.diag([0, 0, 0, 1.0]))


def test_the_same_poses_are_the_same_pairs() -> None:
    """Asked for again with a copy, pairs keep what was computed of them; other numbers are other pairs."""
    A, B = (se3.make(so3.random(np.random.default_rng(k), 5), np.ones((5, 3))) for k in (1, 2))
    pairs = pose_pairs(A, B)
    assert pose_pairs(A.copy(), B.copy()) is pairs
    np.testing.assert_array_equal(pairs.A, A)
    moved = B.copy()
    moved[0, 0, 3] += 1e-12
    assert pose_pairs(A, moved) is not pairs
