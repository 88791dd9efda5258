"""What is eliminated: the many, whatever they are called; and never into one giant component."""

from __future__ import annotations

import numpy as np
import pytest
from problems import bundle, curve, graph

from calibrant.optimize import Problem
from calibrant.optimize.structure import SHARED


def eliminated(problem: Problem) -> set[str]:
    return {
        v.name
        for v, p in zip(problem.variables, problem.structure.placements)
        if p is not None and not np.all(p.batch == SHARED)
    }


def test_points_go_when_there_are_more_points() -> None:
    assert eliminated(bundle(0, poses=4, points=60)) == {"point"}


def test_poses_go_when_there_are_more_poses() -> None:
    assert eliminated(bundle(0, poses=60, points=5)) == {"pose"}


def test_one_of_two_coupled_kinds_stays() -> None:
    # Eliminating both would join everything into one component as large as the problem.
    assert len(eliminated(bundle(1, poses=30, points=30))) == 1


def test_chained_poses_stay_dense() -> None:
    # All nodes hang together: their elimination is the dense solve itself.
    assert eliminated(graph(0)) == set()


def test_single_vectors_stay() -> None:
    problem = curve(0)
    assert eliminated(problem) == set()
    assert problem.structure.shared == 3


def test_components_of_different_sizes_get_a_batch_each() -> None:
    problem = bundle(3, poses=4, points=40, seen=0.5)
    assert problem.structure.batches == ((3, 40),)
    assert problem.structure.shared == 4 * 6 + 1


@pytest.mark.parametrize("seed", range(3))
def test_analysis_is_deterministic(seed: int) -> None:
    a, b = bundle(seed).structure, bundle(seed).structure
    assert a.batches == b.batches
    for p, q in zip(a.placements, b.placements):
        assert p is not None
        assert q is not None
        np.testing.assert_array_equal(p.offset, q.offset)
