"""Graduated non-convexity: gross errors from a start where plain robust fits stay wrong."""

from __future__ import annotations

import numpy as np
import pytest
from problems import Directions, curve, similarity

from calibrant.errors import InputError
from calibrant.geometry import so3
from calibrant.optimize import SO3, Factor, Problem, Variable, solve, solve_graduated, vector
from calibrant.optimize.losses import geman_mcclure


def spoiled(seed: int, share: float) -> tuple[Problem, np.ndarray, np.ndarray]:
    """Directions of which a share point anywhere; the rotation from the good ones alone."""
    clean = similarity(seed, n=40)
    factor = clean.factors[0]
    assert isinstance(factor, Directions)
    rng = np.random.default_rng(seed + 1000)
    bad = rng.choice(40, int(share * 40), replace=False)
    e = factor.e.copy()
    e[bad] = 2 * rng.normal(size=(len(bad), 3))
    good = np.setdiff1d(np.arange(40), bad)
    truth = solve(Problem(clean.variables, (Directions(factor.d[good], factor.e[good]),), clean.sigmas)).value("R")[0]
    far = Variable("R", SO3(), so3.exp([0, 2.0, 0]) @ truth[None])  # 115 degrees away
    return Problem((far, clean.variables[1]), (Directions(factor.d, e),), clean.sigmas), truth, bad


def angle(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.linalg.norm(a - b) / np.sqrt(2))


@pytest.mark.parametrize("seed", range(8))
def test_forty_percent_gross_errors(seed: int) -> None:
    problem, truth, bad = spoiled(seed, 0.4)
    found = solve_graduated(problem, factors=["directions"], k=4.0)
    assert found.solution.converged
    # 0.01 of noise over 24 directions leave about 0.002 rad; the two fits weigh the same points a little differently.
    assert angle(found.solution.value("R")[0], truth) < 3e-3
    weights = found.weights["directions"]
    assert np.all(weights[bad] < 0.01)
    assert np.median(np.delete(weights, bad)) > 0.5


class Location(Factor):
    """One number measured many times: r = x - y."""

    def __init__(self, y: np.ndarray) -> None:
        self.y = y
        super().__init__("y", variables=("x",), indices=(np.zeros(len(y), int),), dim=1, noise="y")

    def linearize(self, *values: np.ndarray) -> tuple[np.ndarray, tuple[np.ndarray, ...]]:
        return values[0] - self.y[:, None], (np.ones((len(self.y), 1, 1)),)


def test_leaves_the_valley_of_a_minority() -> None:
    """A start among 40 % that agree on a wrong value: the loss alone stays there, the graduated fit does not."""
    rng = np.random.default_rng(0)
    y = np.concatenate([rng.normal(0, 1, 60), rng.normal(30, 1, 40)])
    problem = Problem((vector("x", [30.0], "x"),), (Location(y),))
    alone = solve(problem.with_losses({"y": geman_mcclure(3.0)}))
    assert alone.value("x")[0, 0] == pytest.approx(30, abs=1)
    graduated = solve_graduated(problem, factors=["y"], k=3.0)
    assert graduated.solution.value("x")[0, 0] == pytest.approx(0, abs=0.5)
    assert graduated.solution.cost < alone.cost


def test_clean_data_keep_their_fit() -> None:
    problem = curve(4)
    found = solve_graduated(problem, factors=["curve"], k=5.0)
    # The tails weigh a little less: the fit moves by a fraction of its own sigma.
    sigma = np.sqrt(np.diag(solve(problem).covariance("abc")))
    assert np.all(np.abs(found.solution.value("abc")[0] - solve(problem).value("abc")[0]) < 0.5 * sigma)
    assert np.min(found.weights["curve"]) > 0.3


def test_unknown_factors_are_refused() -> None:
    with pytest.raises(InputError, match=r"factors of the problem \(curve\)"):
        solve_graduated(curve(0), factors=["other"], k=3.0)
