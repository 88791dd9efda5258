"""Work shared out to threads: every item once, errors come back, forks keep working."""

from __future__ import annotations

import os

import numpy as np
import pytest

from calibrant.optimize import threads


@pytest.fixture
def four(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threads, "cores", lambda: 4)


@pytest.mark.usefixtures("four")
@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 1000])
@pytest.mark.parametrize("seconds", [0.0, 1e-3, 10.0])
def test_every_item_once(count: int, seconds: float) -> None:
    done = np.zeros(count, dtype=int)

    def run(first: int, last: int) -> None:
        done[first:last] += 1

    threads.over_range(run, count, seconds=seconds)
    assert np.all(done == 1)


@pytest.mark.usefixtures("four")
@pytest.mark.parametrize("where", [0, 99])
def test_errors_come_back(where: int) -> None:
    def run(first: int, last: int) -> None:
        if first <= where < last:
            raise ValueError("in a piece")

    with pytest.raises(ValueError, match="in a piece"):
        threads.over_range(run, 100, seconds=1.0)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")
@pytest.mark.filterwarnings("ignore:.*multi-threaded.*fork")
@pytest.mark.usefixtures("four")
def test_a_forked_child_starts_its_own_threads() -> None:
    threads.over_range(lambda first, last: None, 8, seconds=1.0)
    child = os.fork()
    if child == 0:
        done = np.zeros(8)
        threads.over_range(lambda first, last: done.__setitem__(slice(first, last), 1), 8, seconds=1.0)
        os._exit(0 if done.all() else 1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
