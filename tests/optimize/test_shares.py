"""Variables that share components: one unknown, in every factor of both, with one variance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibrant.errors import InputError
from calibrant.optimize.factors import VectorPrior
from calibrant.optimize.levenberg_marquardt import solve
from calibrant.optimize.manifolds import Variable, vector
from calibrant.optimize.problem import Problem

A, B = ("p", "q", "f"), ("f", "r")


def variables(start: float = 0.0) -> tuple[Variable, Variable, Variable]:
    """a, b and one between them that shares nothing."""
    a = vector("a", [0.0, 0.0, start], A)
    b = replace(vector("b", [start, 0.0], B), shares=("a", 1))
    return a, vector("c", [0.0], ("s",)), b


def test_shared_components_are_one_unknown() -> None:
    """Linear terms in a, b and c against the same least squares in (p, q, f, r, s)."""
    rng = np.random.default_rng(1)
    M_a, M_b, M_c = rng.normal(size=(4, 3)), rng.normal(size=(3, 2)), rng.normal(size=(1, 1))
    m_a, m_b, m_c = rng.normal(size=3), rng.normal(size=2), rng.normal(size=1)
    factors = [
        VectorPrior(name, name, 0, mean, sqrt_information=M)
        for name, M, mean in (("a", M_a, m_a), ("b", M_b, m_b), ("c", M_c, m_c))
    ]
    problem = Problem(variables(), factors)
    assert problem.free_count == problem.structure.shared == 5
    solution = solve(problem)
    X = np.zeros((8, 5))
    X[:4, :3], X[4:7, 2:4], X[7:, 4:] = M_a, M_b, M_c
    y = np.concatenate([M_a @ m_a, M_b @ m_b, M_c @ m_c])
    best, C = np.linalg.lstsq(X, y, rcond=None)[0], np.linalg.inv(X.T @ X)
    np.testing.assert_allclose(solution.value("a")[0], best[:3], atol=1e-9)
    np.testing.assert_allclose(solution.value("b")[0], best[2:4], atol=1e-9)
    np.testing.assert_allclose(solution.value("c")[0], best[4:], atol=1e-9)
    joint = solution.joint_covariance([("a", 0), ("b", 0), ("c", 0)])
    at = [0, 1, 2, 2, 3, 4]
    np.testing.assert_allclose(joint, C[np.ix_(at, at)], atol=1e-12)


def test_what_cannot_be_shared_is_refused() -> None:
    a, c, b = variables()
    prior = [VectorPrior(n, n, 0, np.zeros(k), sqrt_information=np.eye(k)) for n, k in (("a", 3), ("b", 2), ("c", 1))]
    for changed, words in (
        (replace(b, shares=("nobody", 1)), "both stand alone"),
        (replace(b, shares=("a", 3)), "more than they have"),
        (replace(b, shares=("b", 1)), "both stand alone"),
    ):
        with pytest.raises(InputError, match=words):
            Problem((a, c, changed), prior)
    with pytest.raises(InputError, match="one follows another"):
        Problem((a, replace(c, shares=("a", 1)), b), prior)
