"""All cores for compiled kernels: a range of independent items cut into pieces, each run by a thread.

Whoever is free takes the next piece. Kernels release Python's lock. A pool of Python threads is used and not Numba's
own, because that one does not survive a fork (a user's process pool would abort in its workers) and spins while it
waits.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from itertools import pairwise

SMALLEST_PIECE_SECONDS = 2.5e-4
"""Work below which a thread does not pay: handing a piece over costs about 5e-5 s."""

PIECES_PER_CORE = 4
"""Pieces that a core gets when all are equally fast: one that falls behind delays the end by a quarter of its share."""


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
    pieces = max(1, min(cores() * PIECES_PER_CORE, count, int(seconds / SMALLEST_PIECE_SECONDS)))
    if cores() == 1 or pieces == 1:
        run(0, count)
        return
    bounds = [count * k // pieces for k in range(pieces + 1)]
    waiting = iter(list(pairwise(bounds)))

    def take() -> None:
        for first, last in waiting:
            run(first, last)

    others = [_pool().submit(take) for _ in range(min(cores(), pieces) - 1)]
    try:
        take()
    finally:
        # A thread that did not wake in time has nothing left to do: an idle core can take longer than the whole work.
        # Those at work write into the caller's arrays: leave only when none is, also when interrupted.
        begun = [other for other in others if not other.cancel()]
        for other in begun:
            other.exception()
    for other in begun:
        other.result()
