"""Propagation against Monte-Carlo-free truth: finite differences of the function itself."""

from __future__ import annotations

import numpy as np
import pytest
from problems import bundle, curve

from calibrant.errors import InputError
from calibrant.geometry import se3
from calibrant.optimize import solve, uncertainty

RNG = np.random.default_rng(1)
T_A = se3.exp(RNG.normal(size=6))
T_B = se3.exp(RNG.normal(size=6))
ROOT = RNG.normal(size=(6, 6)) * 0.01
C_A = ROOT @ ROOT.T
C_B = np.diag([1, 2, 3, 4, 5, 6.0]) * 1e-4


def numeric(f: object, n: int) -> np.ndarray:
    """Central differences of f(delta) at 0."""
    h = 1e-6
    return np.stack([(f(h * e) - f(-h * e)) / (2 * h) for e in np.eye(n)], axis=-1)  # type: ignore[operator]


def test_point_through_a_transform() -> None:
    p = RNG.normal(size=(5, 3))
    C_p = np.eye(3) * 1e-4
    out = uncertainty.of_point(T_A, C_A, p, of_p_b=C_p)
    for i in range(5):
        J = numeric(lambda d, i=i: se3.apply(se3.retract(T_A, d), p[i]), 6)
        np.testing.assert_allclose(out[i], J @ C_A @ J.T + 1e-4 * np.eye(3), rtol=1e-6, atol=1e-12)


def test_inverse_of_a_transform() -> None:
    J = numeric(lambda d: se3.local(se3.inverse(T_A), se3.inverse(se3.retract(T_A, d))), 6)
    np.testing.assert_allclose(uncertainty.of_inverse(T_A, C_A), J @ C_A @ J.T, rtol=1e-6, atol=1e-12)


def test_product_of_transforms() -> None:
    T, C = uncertainty.of_product([T_A, T_B, T_A], [C_A, None, C_B])
    np.testing.assert_allclose(T, T_A @ T_B @ T_A)
    J_1 = numeric(lambda d: se3.local(T, se3.retract(T_A, d) @ T_B @ T_A), 6)
    J_3 = numeric(lambda d: se3.local(T, T_A @ T_B @ se3.retract(T_A, d)), 6)
    np.testing.assert_allclose(C, J_1 @ C_A @ J_1.T + J_3 @ C_B @ J_3.T, rtol=1e-6, atol=1e-12)


def test_function_of_several_unknowns() -> None:
    """The distance between two estimated points, whose errors are correlated."""
    solution = solve(bundle(3))
    d = solution.value("point")[4] - solution.value("point")[9]
    J = (d / np.linalg.norm(d))[None]
    variance = uncertainty.of_function(solution, {("point", 4): J, ("point", 9): -J})[0, 0]
    joint = solution.joint_covariance([("point", 4), ("point", 9)])
    row = np.concatenate([J, -J], axis=1)
    assert variance == pytest.approx((row @ joint @ row.T).item())
    apart = solution.covariance("point", 4) + solution.covariance("point", 9)
    assert variance != pytest.approx((J @ apart @ J.T).item(), rel=1e-3)


def test_wrong_widths_are_refused() -> None:
    solution = solve(curve(0))
    with pytest.raises(InputError, match="2 columns, the variables 3"):
        uncertainty.of_function(solution, {("abc", 0): np.ones((1, 2))})
    with pytest.raises(InputError, match="at least one variable"):
        uncertainty.of_function(solution, {})
    with pytest.raises(InputError, match="2 transforms need as many covariances"):
        uncertainty.of_product([T_A, T_B], [C_A])
