"""Factors: Jacobians against differences, blocks against their definition, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from dense import retract, system
from problems import SHAPES, Curve

from calibrant.errors import InputError
from calibrant.optimize import Problem, VectorPrior, vector
from calibrant.optimize.losses import cauchy


@pytest.mark.parametrize("shape", SHAPES)
def test_jacobians_against_central_differences(shape: str) -> None:
    problem = SHAPES[shape](3)
    _, J = system(problem, problem.start)
    h = 1e-6
    for column in range(J.shape[1]):
        step = np.zeros(J.shape[1])
        step[column] = h
        ahead, _ = system(problem, retract(problem, problem.start, step))
        behind, _ = system(problem, retract(problem, problem.start, -step))
        # Whitened residuals reach 1e3: rounding 1e-13 / 1e-6, truncation h^2 times third derivatives.
        np.testing.assert_allclose((ahead - behind) / (2 * h), J[:, column], rtol=1e-5, atol=1e-5)


def test_blocks_are_the_weighted_sums() -> None:
    x = np.linspace(0, 1, 9)
    factor = Curve(x, np.cos(x), sigma=np.linspace(0.5, 2, 9), loss=cauchy(1.0))
    values = (np.array([[1.0, -0.5, 0.3]]),)
    r, (J,) = factor.linearize(*values)
    s = (r[:, 0] / np.linspace(0.5, 2, 9) / 0.2) ** 2
    w = 1 / (1 + s) / np.linspace(0.5, 2, 9) ** 2 / 0.2**2
    blocks = factor.blocks(values, sigma=0.2)
    np.testing.assert_allclose(blocks.gradient[0][0], np.einsum("n,n,nk->k", w, r[:, 0], J[:, 0]), rtol=1e-12)
    np.testing.assert_allclose(blocks.hessian[0, 0][0], np.einsum("n,nk,nl->kl", w, J[:, 0], J[:, 0]), rtol=1e-12)
    assert blocks.cost == pytest.approx(0.5 * np.log1p(s).sum())


def test_vector_prior_is_its_information() -> None:
    L = np.array([[2.0, 0.3], [0, 1.5]])
    factor = VectorPrior("prior", "x", 0, np.array([1.0, 2]), sqrt_information=L)
    blocks = factor.blocks((np.array([[1.5, 2.5]]),), sigma=1.0)
    np.testing.assert_allclose(blocks.hessian[0, 0][0], L.T @ L, rtol=1e-14)
    assert blocks.cost == pytest.approx(0.5 * np.sum((L @ [0.5, 0.5]) ** 2))


X = np.linspace(0, 1, 4)


@pytest.mark.parametrize("sigma", [0.0, -1.0, np.nan, np.inf, np.array([1, 1, 0.0, 1])])
def test_weights_must_be_finite(sigma: object) -> None:
    with pytest.raises(InputError, match="relative sigma must be finite and above 0"):
        Curve(X, X, sigma=sigma)  # type: ignore[arg-type]


def test_empty_factors_are_refused() -> None:
    with pytest.raises(InputError, match="empty"):
        Curve(X[:0], X[:0])


def test_names_and_indices_are_checked() -> None:
    abc = vector("abc", [1, -1, 0], "abc")
    with pytest.raises(InputError, match=r"uses variable 'abc'; there are: other"):
        Problem((vector("other", [1, -1, 0], "abc"),), (Curve(X, X),))
    with pytest.raises(InputError, match="names must differ"):
        Problem((abc, abc), (Curve(X, X),))
    with pytest.raises(InputError, match="no factor touches the variable 'idle'"):
        Problem((abc, vector("idle", [1.0], "x")), (Curve(X, X),))
    with pytest.raises(InputError, match="at least one factor"):
        Problem((abc,), ())
    with pytest.raises(InputError, match="noise levels must be finite and above 0"):
        Problem((abc,), (Curve(X, X),), {"y": 0.0})
    prior = VectorPrior("p", "abc", 3, np.zeros(3), sqrt_information=np.eye(3))
    with pytest.raises(InputError, match="uses instance 3 of 'abc', which has 1"):
        Problem((abc,), (Curve(X, X), prior))
    with pytest.raises(InputError, match="no variable 'b'; it has abc"):
        Problem((abc,), (Curve(X, X),)).variable_index("b")
    with pytest.raises(InputError, match="no factor 'b'; it has curve"):
        Problem((abc,), (Curve(X, X),)).factor_index("b")
