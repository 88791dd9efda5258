"""What is added to the covariance of the shared unknowns moves the eliminated ones along."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from problems import bundle

from calibrant.optimize.levenberg_marquardt import solve


def test_what_is_added_moves_the_eliminated_unknowns_along() -> None:
    solution = solve(bundle(0, poses=4, points=6))
    names = [v.name for v in solution.problem.variables]
    every = [(n, k) for n in names for k in range(solution.problem.variables[names.index(n)].count)]
    plain = solution.joint_covariance(every)
    more = replace(solution, beside=0.5 * solution.shared_covariance)
    grown = more.joint_covariance(every)
    # C = D + F C_s F^T: what the shared unknowns give grows by half, D stays.
    for name, k in every:
        np.testing.assert_allclose(more.covariance(name, k), more.covariances(name)[k], rtol=1e-9, atol=1e-15)
    assert np.all(np.linalg.eigvalsh(grown - plain) > -1e-12 * np.abs(plain).max())
    double = replace(solution, beside=solution.shared_covariance).joint_covariance(every)
    np.testing.assert_allclose(double - grown, grown - plain, atol=1e-12 * np.abs(plain).max())
