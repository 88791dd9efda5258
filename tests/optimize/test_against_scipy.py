"""The same optimum as SciPy's least_squares on 20 random problems of every shape."""

from __future__ import annotations

import numpy as np
import pytest
from dense import first_columns, retract, system
from problems import SHAPES
from scipy.optimize import least_squares

from calibrant.optimize import solve

SMALL = {"bundle": {"poses": 3, "points": 6}, "graph": {"nodes": 4, "extra": 3}}


@pytest.mark.parametrize("seeds", [range(2), pytest.param(range(2, 20), marks=pytest.mark.long)], ids=["first", "rest"])
@pytest.mark.parametrize("shape", SHAPES)
def test_cost_equals_scipys(shape: str, seeds: range) -> None:
    for seed in seeds:
        problem = SHAPES[shape](100 + seed, **SMALL.get(shape, {}))
        ours = solve(problem)
        assert ours.converged
        n = first_columns(problem)[-1]

        # SciPy walks in the chart at our start: another parameterisation, the same minimum.
        def residuals(x: np.ndarray, problem=problem) -> np.ndarray:
            return system(problem, retract(problem, problem.start, x))[0]

        theirs = least_squares(residuals, np.zeros(n), method="lm", xtol=1e-14, ftol=1e-14, gtol=1e-14, max_nfev=40 * n)
        assert ours.cost <= theirs.cost * (1 + 1e-8)
        # LM in another chart may stop in another minimum; it must not be a better one, and nearly always it is ours.
        if theirs.cost > ours.cost * (1 + 1e-8):
            again = least_squares(residuals, theirs.x, xtol=1e-15, ftol=1e-15, gtol=1e-15)
            assert again.cost >= ours.cost * (1 - 1e-8)
