"""Assembly, elimination and steps against the dense matrices."""

from __future__ import annotations

import numpy as np
import pytest
from dense import first_columns, retract, system
from problems import SHAPES, bundle

from calibrant.optimize import Problem, linear
from calibrant.optimize.linear import NormalEquations
from calibrant.optimize.structure import SHARED

DAMPING = 1e-3


def dense_normal_equations(problem: Problem, equations: NormalEquations) -> tuple[np.ndarray, np.ndarray]:
    """H and g in the variables' order, put together from the blocks."""
    starts = first_columns(problem)
    places = []  # (batch, row, column) of every unknown
    for p in problem.structure.placements:
        if p is not None:
            for i in range(len(p.batch)):
                places += [(int(p.batch[i]), int(p.row[i]), int(p.offset[i]) + c) for c in range(p.dim)]
    n = starts[-1]
    H, g = np.zeros((n, n)), np.zeros(n)
    for a, (batch, row, column) in enumerate(places):
        g[a] = equations.s[column] if batch == SHARED else equations.v[batch][row, column]
        for b, (batch_b, row_b, column_b) in enumerate(places):
            if batch == SHARED and batch_b == SHARED:
                H[a, b] = equations.S[column, column_b]
            elif batch_b == SHARED:
                H[a, b] = equations.W[batch][row, column, column_b]
            elif batch == SHARED:
                H[a, b] = equations.W[batch_b][row_b, column_b, column]
            elif (batch, row) == (batch_b, row_b):
                H[a, b] = equations.V[batch][row, column, column_b]
    return H, g


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("shape", SHAPES)
def test_assembly_is_the_dense_product(shape: str, seed: int) -> None:
    problem = SHAPES[shape](seed)
    equations = problem.linearize(problem.start, problem.sigmas)
    r, J = system(problem, problem.start)
    H, g = dense_normal_equations(problem, equations)
    np.testing.assert_allclose(H, J.T @ J, rtol=1e-10, atol=1e-10 * np.abs(J.T @ J).max())
    np.testing.assert_allclose(g, J.T @ r, rtol=1e-9, atol=1e-10 * np.abs(J.T @ r).max())
    assert equations.cost == pytest.approx(0.5 * r @ r, rel=1e-12)


@pytest.mark.parametrize("shape", SHAPES)
def test_step_is_the_dense_step(shape: str) -> None:
    problem = SHAPES[shape](4)
    equations = problem.linearize(problem.start, problem.sigmas)
    step = linear.solve(equations, DAMPING)
    assert step is not None
    r, J = system(problem, problem.start)
    H, g = J.T @ J, J.T @ r
    delta = -np.linalg.solve(H + DAMPING * np.diag(np.diag(H)), g)
    moved, expected = problem.retract(problem.start, step), retract(problem, problem.start, delta)
    for a, b in zip(moved, expected):
        np.testing.assert_allclose(a, b, rtol=1e-8, atol=1e-9)
    assert step.predicted == pytest.approx(-(g @ delta + 0.5 * delta @ H @ delta), rel=1e-6)


def test_compiled_elimination_equals_the_numpy_form() -> None:
    problem = bundle(2)
    equations = problem.linearize(problem.start, problem.sigmas)
    for V, W, v in zip(equations.V, equations.W, equations.v):
        compiled, plain = linear.eliminate(V, W, v, DAMPING), linear.eliminate_numpy(V, W, v, DAMPING)
        for name in ("L", "Y", "z", "weak"):
            a, b = getattr(compiled, name), getattr(plain, name)
            np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9 * max(np.abs(b).max(), 1e-300))


def test_elimination_says_which_pivot_is_rounding() -> None:
    V = np.array([[[4.0, 2, 0], [2, 1, 0], [0, 0, 3]], np.eye(3)])
    part = linear.eliminate(V, np.zeros((2, 3, 1)), np.zeros((2, 3)), 0.0)
    assert part.weak.tolist() == [1, -1]


def test_reweighing_equals_a_new_linearisation() -> None:
    problem = bundle(5)
    before = dict(problem.sigmas)
    after = {"pixel": 3e-3, "gauge": 0.01}
    known = problem.linearize(problem.start, before)
    again = problem.reweigh(known, problem.start, before, after)
    fresh = problem.linearize(problem.start, after)
    for a, b in zip((*again.V, *again.W, again.S, again.s), (*fresh.V, *fresh.W, fresh.S, fresh.s)):
        np.testing.assert_allclose(a, b, rtol=1e-11, atol=1e-11 * max(np.abs(b).max(), 1))
    assert again.cost == pytest.approx(fresh.cost)
