"""One writer at a time: a lock on a file that the system takes back from a process that is no more.

Its file stays where it is: who removed it could remove it below another who has just locked it.
"""

from __future__ import annotations

import os
import socket
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from calibrant.errors import InputError
from calibrant.reading.files import reason_of

LOCK_FILE = ".calibrant.lock"
WAIT_S = 2.0
"""How long a command waits for another: most hold the lock for some milliseconds, `solve` for as long as it takes."""
_STEP_S = 0.02
_LONGEST = 200


@contextmanager
def locked(folder: Path, *, wait_s: float = WAIT_S) -> Iterator[None]:
    """Nobody else writes the project in this folder meanwhile. Raises: InputError where somebody does, naming them, or
    where the folder cannot be written."""
    path = folder / LOCK_FILE
    try:
        number = os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_CLOEXEC", 0), 0o644)
    except OSError as error:
        raise InputError(f"cannot write the project in {folder}: {reason_of(error)}") from None
    try:
        end = time.monotonic() + wait_s
        while not _taken(number):
            if time.monotonic() >= end:
                raise InputError(
                    f"the project in {folder} is being written by {_holder(number)}; wait until it is done, or end it. "
                    "A process that is no more holds nothing"
                )
            time.sleep(_STEP_S)
        _say(number, f"process {os.getpid()} on {socket.gethostname()}")
        yield
    finally:
        os.close(number)  # which gives the lock back


if sys.platform == "win32":
    import msvcrt

    def _taken(number: int) -> bool:
        # A byte far behind the text, which others may go on reading.
        os.lseek(number, 1 << 20, os.SEEK_SET)
        try:
            msvcrt.locking(number, msvcrt.LK_NBLCK, 1)
        except OSError:
            return False
        return True

else:
    import fcntl

    def _taken(number: int) -> bool:
        try:
            fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            return False
        return True


def _say(number: int, text: str) -> None:
    """Who holds it, for those who wait."""
    os.lseek(number, 0, os.SEEK_SET)
    os.truncate(number, 0)
    os.write(number, text.encode())


def _holder(number: int) -> str:
    os.lseek(number, 0, os.SEEK_SET)
    said = os.read(number, _LONGEST).decode(errors="replace")
    return said if said.isprintable() and said else "another process"
