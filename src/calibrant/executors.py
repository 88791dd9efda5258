"""Where images are detected: in this process, in a pool of processes, or on the machines of a Dask cluster."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, wait
from contextlib import contextmanager
from typing import TypeVar

from calibrant.cancel import checkpoint
from calibrant.errors import CancelledError, InputError, MissingExtraError

T = TypeVar("T")
R = TypeVar("R")

WORTH_A_POOL = 40
"""Images from which two processes save time: a process takes about a second to start, an image some 20 ms."""
POOL_SIZE = 2
LOOK_EVERY = 0.1
"""Seconds between two looks whether waiting work was cancelled."""
SCHEMES = ("tcp://", "tls://", "ucx://", "ws://", "wss://")
"""How addresses of Dask schedulers begin."""


@contextmanager
def executor_for(workers: int | str | Executor | None, count: int) -> Iterator[Executor | None]:
    """The executor for `count` images, None for this process; closed at the end unless it was given.

    Args: workers: how many processes, or the address of a Dask scheduler (tcp://host:8786), or an executor, or None to
    choose.
    Raises: InputError for a bad number or an address that does not answer; MissingExtraError without Dask.
    """
    if isinstance(workers, Executor):
        yield workers
        return
    if isinstance(workers, str) and not workers.strip().isdigit():
        with _dask(workers.strip()) as executor:
            yield executor
        return
    number = None if workers is None else int(workers)
    if number is not None and number < 1:
        raise InputError(f"workers must be at least 1, got {workers}")
    number = number if number is not None else (POOL_SIZE if count >= WORTH_A_POOL else 1)
    if min(number, count) <= 1:
        yield None
        return
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    # Fresh processes: a fork would copy the threads' locks of libraries that this process has already used.
    pool = ProcessPoolExecutor(min(number, count), mp_context=get_context("spawn"))
    patient = True
    try:
        yield pool
    except CancelledError:
        # Nobody waits for the images that are being searched: the processes end by themselves behind them.
        patient = False
        raise
    finally:
        # After an error or Ctrl-C the images that wait are not begun.
        pool.shutdown(wait=patient, cancel_futures=True)


def in_order(
    executor: Executor, work: Callable[[Sequence[T]], Sequence[R]], parts: Sequence[Sequence[T]]
) -> Iterator[R]:
    """What `work` gives for every part, in order; while it waits, it asks whether to stop. Raises: CancelledError."""
    futures = [executor.submit(work, part) for part in parts]
    for future in futures:
        while not wait([future], timeout=LOOK_EVERY).done:
            checkpoint()
        yield from future.result()


@contextmanager
def _dask(address: str) -> Iterator[Executor]:
    if not address.startswith(SCHEMES):
        raise InputError(
            f"workers are a number of processes or a Dask scheduler's address, tcp://HOST:PORT; got {address!r}"
        )
    try:
        from distributed import Client
    except ImportError:
        raise MissingExtraError(
            f"workers at {address} need Dask: install it with pip install 'calibrant[fleet]'"
        ) from None
    try:
        client = Client(address, timeout="10s", set_as_default=False)
    except (OSError, TimeoutError) as error:
        raise InputError(f"no Dask scheduler answers at {address}: {error}") from None
    with client:
        executor: Executor = client.get_executor()
        yield executor
