"""Where images are detected: in this process, in a pool of processes, or on the machines of a Dask cluster."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, wait
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from calibrant.cancel import checkpoint, undisturbed
from calibrant.errors import InputError, MissingExtraError

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

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
    spawn = get_context("spawn")
    leash, held = spawn.Pipe(duplex=False)
    pool = ProcessPoolExecutor(min(number, count), mp_context=spawn, initializer=serve, initargs=(leash,))
    try:
        # A process that is interrupted while it is started is half of one.
        with undisturbed() as told, _deaf(), _without_script():
            # The first starts all of them. One by one, on a busy machine, the first may have answered before the
            # second is asked for, which is then started later, and not deaf.
            pool._safe_to_dynamically_spawn_children = False  # type: ignore[attr-defined]
            for _ in range(min(number, count)):
                pool.submit(_nothing)
        if told:
            raise KeyboardInterrupt
        yield pool
    except BaseException:
        # Nobody waits for what is being searched: let go, the processes end at once.
        held.close()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
        held.close()
        leash.close()


def serve(leash: Connection) -> None:
    """What a worker does first: it leaves Ctrl-C to its parent, and ends when that lets go, or ends, in whatever way.

    Args: leash: the end for reading of a pipe whose other end the parent alone holds.
    """
    import signal
    import threading

    def watch() -> None:
        leash.poll(None)  # until the other end is closed
        os._exit(1)

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def _deaf() -> Iterator[None]:
    """Processes that start inside do not hear Ctrl-C, which a terminal sends to all, not even while they start."""
    import signal

    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _without_script() -> Iterator[None]:
    """Processes that start inside do not run the user's script where that has no `if __name__ == "__main__":`.

    They would run it from its first line on, files written and all, until they ask for processes themselves and fail.
    What they are given stands in this package. A script that has the line is run, as Python does: targets and models
    of the user's own may stand in it.
    """
    main = sys.modules["__main__"]
    file = getattr(main, "__file__", None)
    try:
        guarded = file is None or b"__main__" in Path(file).read_bytes()
    except OSError:
        guarded = True
    if guarded:
        yield
        return
    spec = main.__spec__
    del main.__file__
    main.__spec__ = None
    try:
        yield
    finally:
        main.__file__, main.__spec__ = file, spec


def _nothing() -> None:
    """Work that takes no time."""


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
