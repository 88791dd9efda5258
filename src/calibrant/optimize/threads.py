"""All cores for compiled kernels: a range of independent items cut into pieces, each run by a thread.

Kernels release Python's lock. A pool of Python threads is used and not Numba's own, because that one does not survive
a fork (a user's process pool would abort in its workers) and spins while it waits.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from itertools import pairwise

SMALLEST_PIECE_SECONDS = 2.5e-4
"""Work below which a thread does not pay: handing a piece over costs about 5e-5 s."""


@cache
def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(max(cores() - 1, 1), thread_name_prefix="calibrant")


if hasattr(os, "register_at_fork"):
    # Threads do not cross a fork: the child starts its own pool.
    os.register_at_fork(after_in_child=_pool.cache_clear)


def over_range(run: Callable[[int, int], None], count: int, *, seconds: float) -> None:
    """Call run(first, last) over pieces of range(count), at once on several threads; returns when all are done.

    run must only write what belongs to its own items: the result then does not depend on the pieces. seconds: an
    estimate of the whole work's time on one core, which decides how many pieces are worth their overhead.
    """
    pieces = max(1, min(cores(), count, int(seconds / SMALLEST_PIECE_SECONDS)))
    if pieces == 1:
        run(0, count)
        return
    bounds = [count * k // pieces for k in range(pieces + 1)]
    others = [_pool().submit(run, first, last) for first, last in pairwise(bounds[1:])]
    try:
        run(bounds[0], bounds[1])
    finally:
        # Pieces write into the caller's arrays: leave only when none is at work, also when interrupted.
        for other in others:
            other.exception()
    for other in others:
        other.result()
