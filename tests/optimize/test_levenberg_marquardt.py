"""The iteration: how it ends, that it ends at the minimum, and what it says about bad input."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from dense import system
from problems import SHAPES, Curve, Sight, bundle, curve

from calibrant.errors import InputError
from calibrant.geometry import se3
from calibrant.optimize import SE3, Positive, Problem, SolverOptions, Status, Variable, VectorPrior, solve, vector
from calibrant.optimize.levenberg_marquardt import solve_again
from calibrant.optimize.losses import huber


@pytest.mark.parametrize("shape", SHAPES)
def test_converges_to_a_stationary_point(shape: str) -> None:
    problem = SHAPES[shape](7)
    solution = solve(problem)
    assert solution.converged, solution.message
    r, J = system(problem, solution.values)
    scale = np.sqrt(np.maximum(np.sum(J * J, axis=0), 1e-300))
    # cost_tolerance 1e-10: the whitened gradient is below sqrt(2e-10 cost).
    assert np.max(np.abs(J.T @ r) / scale) < 2e-5 * np.sqrt(max(solution.cost, 1e-6))


@pytest.mark.parametrize("shape", SHAPES)
def test_cost_never_rises_and_runs_repeat_bitwise(shape: str) -> None:
    a, b = solve(SHAPES[shape](8)), solve(SHAPES[shape](8))
    assert np.all(np.diff(a.history) <= 0)
    assert a.history == b.history
    for x, y in zip(a.values, b.values):
        np.testing.assert_array_equal(x, y)


def test_limit_of_iterations_is_said() -> None:
    solution = solve(curve(0), options=SolverOptions(max_iterations=1))
    assert not solution.converged
    assert solution.status == "max_iterations"
    assert "iteration limit" in solution.message
    assert solution.iterations == 1


def test_exact_data_end_at_zero() -> None:
    solution = solve(curve(1, sigma=0.05))
    again = solve(Problem(solution.problem.variables, (Curve(*_exact(solution)),), {"y": 0.05}))
    assert again.converged
    assert again.cost < 1e-16


def _exact(solution: object) -> tuple[np.ndarray, np.ndarray]:
    x = np.linspace(0, 3, 40)
    a, b, c = solution.value("abc")[0]  # type: ignore[attr-defined]
    return x, a * np.exp(b * x) + c


def test_start_at_the_minimum_stays() -> None:
    solution = solve(curve(2))
    again = solve(solution.problem, start=solution.values)
    assert again.converged
    assert again.status == Status.COST.name.lower()
    np.testing.assert_allclose(again.value("abc"), solution.value("abc"), rtol=1e-6)


def test_going_on_with_other_levels_equals_a_new_solve() -> None:
    first = solve(bundle(1))
    levels = {"pixel": 2e-3, "gauge": 0.005}
    a, b = solve_again(first, levels), solve(first.problem, start=first.values, sigmas=levels)
    assert a.cost == pytest.approx(b.cost, rel=1e-9)


def test_huber_resists_an_outlier() -> None:
    clean = curve(3)
    factor = clean.factors[0]
    assert isinstance(factor, Curve)
    y = factor.y.copy()
    y[7] += 5.0
    truth = solve(clean).value("abc")[0]
    spoiled = solve(Problem(clean.variables, (Curve(factor.x, y),), {"y": 0.05})).value("abc")[0]
    robust = solve(Problem(clean.variables, (Curve(factor.x, y, loss=huber(1.5)),), {"y": 0.05}))
    assert np.linalg.norm(robust.value("abc")[0] - truth) < 0.2 * np.linalg.norm(spoiled - truth)
    weights = robust.weights("curve")
    assert weights[7] < 0.1
    assert np.median(weights) == 1.0


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_bad_data_are_named(value: float) -> None:
    x = np.linspace(0, 1, 5)
    y = np.where(np.arange(5) == 3, value, 1.0)
    with pytest.raises(InputError, match=r"no finite residual in 'curve' \(abc\)"):
        solve(Problem((vector("abc", [1, -1, 0], "abc"),), (Curve(x, y),)))


def sights(depth: float) -> Problem:
    """One pose over a square of fixed points; the start depth is given, the truth is 1 m."""
    p = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0.2], [-1, 1, 0], [0.3, 0.2, -0.1]]) * 0.3
    T = se3.make(np.eye(3), np.array([[0.05, 0.02, 1.0]]))
    q = se3.apply(T, p)
    variables = (
        Variable("pose", SE3(), se3.make(np.eye(3), np.array([[0, 0, depth]]))),
        Variable("point", vector("p", np.zeros(3), "xyz").manifold, p, constant=True),
        Variable("focal", Positive(("f",)), np.ones((1, 1)), constant=True),
    )
    return Problem(variables, (Sight(np.zeros(5, int), np.arange(5), q[:, :2] / q[:, 2:]),))


def test_a_start_behind_the_camera_is_refused_by_name() -> None:
    with pytest.raises(InputError, match=r"'sight' \(pose, point 0, focal\): a point lies behind the camera"):
        solve(sights(-1.0))


def test_steps_behind_the_camera_are_not_taken() -> None:
    # From 0.08 m, where points hang at the edge of the image plane, undamped steps overshoot through the camera.
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        solution = solve(sights(0.08), options=SolverOptions(initial_damping=1e-12))
    assert solution.converged
    np.testing.assert_allclose(solution.value("pose")[0, :3, 3], [0.05, 0.02, 1.0], atol=1e-6)


def test_interruption_goes_through() -> None:
    class Interrupted(Curve):
        def linearize(self, *values: np.ndarray) -> tuple[np.ndarray, tuple[np.ndarray, ...]]:
            raise KeyboardInterrupt

    x = np.linspace(0, 1, 5)
    with pytest.raises(KeyboardInterrupt):
        solve(Problem((vector("abc", [1, -1, 0], "abc"),), (Interrupted(x, x),)))
    assert solve(curve(0)).converged


def test_constant_problem_is_done_at_once() -> None:
    prior = VectorPrior("p", "x", 0, np.zeros(2), sqrt_information=np.eye(2))
    held = Variable("x", vector("x", [1, 1], "ab").manifold, np.ones((1, 2)), constant=True)
    solution = solve(Problem((held,), (prior,)))
    assert solution.converged
    assert solution.cost == 1.0
