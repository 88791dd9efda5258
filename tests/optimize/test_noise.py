"""Variance components: exact formulas where they exist, statistics where they do not, chi-square tests."""

from __future__ import annotations

import numpy as np
import pytest
from dense import system
from problems import SHAPES, Curve, bundle, curve

from calibrant.optimize import (
    SE3,
    Problem,
    SolverOptions,
    TranslationPrior,
    Variable,
    VectorPrior,
    chi_squares,
    estimate_noise,
    solve,
    vector,
)
from calibrant.optimize.consistency import ChiSquare, against_stated
from calibrant.optimize.factors import RotationPrior
from calibrant.optimize.noise import redundancies


def test_one_group_is_the_textbook_estimate() -> None:
    estimate = estimate_noise(curve(0), sigmas={"y": 1.0})
    r = estimate.solution.residuals("curve")
    # One group: sigma^2 = sum r^2 / (n - unknowns), whatever the start.
    assert estimate.levels["y"].sigma == pytest.approx(np.sqrt(np.sum(r**2) / (40 - 3)), rel=1e-6)
    assert estimate.levels["y"].redundancy == pytest.approx(37, rel=1e-9)
    assert estimate.levels["y"].deviation == pytest.approx(estimate.levels["y"].sigma / np.sqrt(74), rel=1e-9)
    assert estimate.settled


def test_redundancies_add_up() -> None:
    solution = solve(bundle(1, poses=8, points=20))
    total = sum(r for _, r, _ in redundancies(solution).values())
    # The exact prior's share of the unknowns is its own: 3 residuals, their trace counted apart.
    C = solution.covariance("point", 0)
    prior = np.trace(C) / 0.01**2
    n = solution.problem.residual_count - 3
    assert total == pytest.approx(n - (solution.problem.free_count - prior), rel=1e-6)


def two_groups(seed: int) -> Problem:
    """Two curves over the same unknowns with noise 0.05 and 0.4."""
    rng = np.random.default_rng(seed)
    x = np.linspace(0, 3, 30)
    y = 2 * np.exp(-x) + 0.3
    return Problem(
        (vector("abc", [1.8, -0.9, 0.2], "abc"),),
        (
            Curve(x, y + 0.05 * rng.normal(size=30), name="fine", noise="fine"),
            Curve(x, y + 0.4 * rng.normal(size=30), name="coarse", noise="coarse"),
        ),
    )


@pytest.mark.statistics
def test_two_groups_over_many_trials() -> None:
    logs, scores = [], []
    for seed in range(100):
        estimate = estimate_noise(two_groups(seed))
        fine, coarse = estimate.levels["fine"], estimate.levels["coarse"]
        logs.append([np.log(fine.sigma / 0.05), np.log(coarse.sigma / 0.4)])
        scores.append([(fine.sigma - 0.05) / fine.deviation, (coarse.sigma - 0.4) / coarse.deviation])
    # sigma of one estimate ~ 1 / sqrt(2 * 28) = 13 %; of the mean of 100: 1.3 %; 4 sigmas allowed.
    assert np.all(np.abs(np.mean(logs, axis=0)) < 0.053)
    # The stated deviation is the true one: normalised deviations have unit spread (within 4 / sqrt(2 * 100)).
    assert np.all(np.abs(np.std(scores, axis=0) - 1) < 0.29)


@pytest.mark.parametrize("guess", [1e-3, 1.0, 30.0])
def test_the_start_does_not_matter(guess: float) -> None:
    reference = estimate_noise(two_groups(3)).levels
    levels = estimate_noise(two_groups(3), sigmas={"fine": guess, "coarse": 1.0}).levels
    for group, level in reference.items():
        # The rounds stop at changes of 1e-3.
        assert levels[group].sigma == pytest.approx(level.sigma, rel=5e-3)


def test_exact_data_stop_at_the_floor() -> None:
    x = np.linspace(0, 3, 20)
    problem = Problem((vector("abc", [1.8, -0.9, 0.2], "abc"),), (Curve(x, 2 * np.exp(-x) + 0.3),))
    level = estimate_noise(problem, floors={"y": 1e-4}).levels["y"]
    assert level.sigma == 1e-4
    assert level.at_floor


def test_a_group_with_nothing_to_spare_keeps_its_level() -> None:
    x = np.array([0.0, 1.0, 2.0])
    problem = Problem((vector("abc", [1.8, -0.9, 0.2], "abc"),), (Curve(x, 2 * np.exp(-x) + 0.3),), {"y": 0.7})
    level = estimate_noise(problem).levels["y"]
    assert level.sigma == 0.7
    assert not level.determined
    assert np.isinf(level.deviation)


def test_given_priors_are_not_estimated() -> None:
    problem = two_groups(0)
    prior = VectorPrior("prior", "abc", 0, np.array([2.0, -1, 0.3]), sqrt_information=np.eye(3) / 0.01)
    estimate = estimate_noise(Problem(problem.variables, (*problem.factors, prior)))
    assert set(estimate.levels) == {"fine", "coarse"}


def test_unsettled_is_said() -> None:
    estimate = estimate_noise(two_groups(1), options=SolverOptions(max_iterations=2))
    assert estimate.rounds >= 1
    assert estimate.settled in (True, False)


@pytest.mark.statistics
def test_chi_square_tells_a_wrong_level() -> None:
    verdicts = [
        [
            chi_squares(solve(two_groups(s), sigmas={"fine": k * 0.05, "coarse": 0.4}))["fine"].agrees()
            for s in range(40)
        ]
        for k in (1.0, 0.5, 2.0)
    ]
    right, small, large = np.mean(verdicts, axis=1)
    # 1 % of 40 right ones may fail; 27 degrees of freedom tell a factor of two with certainty.
    assert right >= 0.92
    assert small == 0
    assert large <= 0.03


def test_chi_square_probabilities() -> None:
    assert ChiSquare(11.07, 5).above == pytest.approx(0.05, abs=1e-4)  # tables
    assert ChiSquare(10.0, 5).ratio == 2.0


def test_estimate_against_stated_levels() -> None:
    estimate = estimate_noise(two_groups(2))
    tests = against_stated(estimate, {"fine": 0.05, "unknown": 1.0})
    assert set(tests) == {"fine"}
    level = estimate.levels["fine"]
    assert tests["fine"].ratio == pytest.approx((level.sigma / 0.05) ** 2)


def test_covariance_is_averaged_over_an_uncertain_level() -> None:
    """One group, nu residuals to spare: nu / (nu - 2) of the inverse, the variance of Student's t."""
    T = np.tile(np.eye(4), (9, 1, 1))
    T[:, :3, 3] = np.random.default_rng(5).standard_normal((9, 3))
    pose = Variable("T", SE3(), np.eye(4)[None])
    places = TranslationPrior("places", "T", T, noise="mm", indices=np.zeros(9, dtype=np.int64))
    upright = RotationPrior("upright", "T", np.eye(4)[None], noise="rotation")
    problem = Problem((pose,), (places, upright), {"mm": 1.0})
    found = estimate_noise(problem)
    level = found.levels["mm"]
    freedom = 3 * 9 - 3
    assert level.redundancy == pytest.approx(freedom)
    assert level.deviation == pytest.approx(level.sigma / np.sqrt(2 * freedom))
    expected = level.sigma**2 / 9 * freedom / (freedom - 2)
    np.testing.assert_allclose(np.diag(found.solution.covariance("T"))[3:], expected, rtol=1e-6)
    np.testing.assert_allclose(np.diag(found.solution.covariances("T")[0])[3:], expected, rtol=1e-6)


def test_level_information_is_the_trace_of_projections() -> None:
    """M against the dense form tr(E_k R E_l R), R = I - J C J^T, on problems of every shape."""
    for name in SHAPES:
        solution = solve(SHAPES[name](3))
        problem = solution.problem
        groups = list(problem.noise_groups)
        M = solution.noise_shares.information(tuple(groups))
        _, J = system(problem, solution.values)
        scale = 1 / np.linalg.norm(J, axis=0)
        U = np.linalg.qr(J * scale)[0]
        R = np.eye(len(J)) - U @ U.T
        rows = np.concatenate([np.full(f.residual_count, f.noise) for f in problem.factors])
        dense = np.array([[np.sum(R[np.ix_(rows == a, rows == b)] ** 2) for b in groups] for a in groups])
        np.testing.assert_allclose(M, dense, atol=1e-6 * len(J))
