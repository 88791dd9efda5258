"""Two processes for a first run: while this one compiles what it needs first, another compiles what comes next.

Numba compiles under one lock a process, so that threads wait for each other; the cache on disk is shared by processes.
Where everything is in the cache already, no other process is started.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from numba.core import event

from calibrant.cancel import checkpoint

LOOKS_S = 0.1
"""How often is asked whether the other process is done, and whether the work is cancelled."""


_ENDS_WITH_US = (
    "import os, sys, threading; "
    "threading.Thread(target=lambda: (sys.stdin.buffer.read(), os._exit(1)), daemon=True).start()"
)
"""The other process reads from a pipe that closes when this one ends, however it ends."""


class OtherProcess(event.Listener):
    """Hears of Numba's compilations: the first one starts a process that imports the modules, which compiles them.

    first: called then, with the compiler waiting.
    """

    def __init__(self, modules: Sequence[str], first: Callable[[], None]) -> None:
        self._modules = modules
        self._first = first
        self._heard = False
        self._process: subprocess.Popen[bytes] | None = None

    def on_start(self, event: event.Event) -> None:
        """A function is not in the cache."""
        if self._heard:
            return
        self._heard = True
        self._first()
        if sys.executable and _cores() > 1:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-c", f"{_ENDS_WITH_US}; import {', '.join(self._modules)}"],
                env={**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)},
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
            )

    def on_end(self, event: event.Event) -> None:
        """What the function took is of no interest here."""

    @property
    def runs(self) -> bool:
        """Whether it was needed and is not done."""
        return self._process is not None and self._process.poll() is None

    def wait(self) -> None:
        """Until it is done. What it could not do, this process will, and say what is wrong. Raises: CancelledError."""
        while self._process is not None and self.runs:
            checkpoint()
            try:
                self._process.wait(LOOKS_S)
            except subprocess.TimeoutExpired:
                continue

    def stop(self) -> None:
        """Its work is no longer wanted; the cache keeps what is whole."""
        if self._process is None:
            return
        if self.runs:
            self._process.terminate()
            self._process.wait()
        if self._process.stdin is not None:
            self._process.stdin.close()


@contextmanager
def compiled_beside(*modules: str, first: Callable[[], None] = lambda: None) -> Iterator[OtherProcess]:
    """While the block compiles, another process compiles these modules; it ends with the block at the latest.

    first: called when the first compilation begins, as it takes so long that a person should know.

    with compiled_beside("calibrant.optimize.linear_kernels") as other:
        ...  # load and use what is needed first
        other.wait()
    """
    other = OtherProcess(modules, first)
    event.register("numba:compile", other)
    try:
        yield other
    finally:
        event.unregister("numba:compile", other)
        other.stop()


def _cores() -> int:
    """How many this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
