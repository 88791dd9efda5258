"""How far a command is: a bar on a terminal, plain lines where standard error is a file or a pipe, else nothing."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TextIO

from calibrant.cli.words import clean, console, tell
from calibrant.tasks.listener import SILENT, Listener, Step

FIRST = 0.5
"""Seconds until something that takes longer is said."""
EVERY = 3.0
"""Seconds between two lines of one count."""


class TerminalListener(Listener):
    """A bar or a turning sign on a terminal's standard error, gone when the work is done."""

    @contextmanager
    def status(self, text: str) -> Iterator[None]:
        with console(stderr=True).status(text):
            yield

    @contextmanager
    def progress(self, title: str) -> Iterator[Step]:
        from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
        from rich.progress import Progress as Bar

        columns = (
            TextColumn("{task.description}", markup=False),
            BarColumn(),
            MofNCompleteColumn(),
            TimeRemainingColumn(),
        )
        with Bar(*columns, console=console(stderr=True), transient=True) as bar:
            task = bar.add_task(title, total=None)
            yield lambda done, total, name: bar.update(task, completed=done, total=total, description=f"{title} {name}")

    def note(self, text: str) -> None:
        tell(text)

    def ask(self, question: str) -> bool:
        if not sys.stdin.isatty():
            return False
        tell(f"{question}? [y/N]")
        return sys.stdin.readline().strip().lower() in ("y", "yes")


class LinesListener(Listener):
    """Plain lines: what takes longer than half a second is said, and a count every few seconds."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    @contextmanager
    def status(self, text: str) -> Iterator[None]:
        with self._said_late(lambda: text):
            yield

    @contextmanager
    def progress(self, title: str) -> Iterator[Step]:
        text = f"{title} …"
        last = time.monotonic()

        def step(done: int, total: int, name: str) -> None:
            nonlocal text, last
            text = f"{title} {done}/{total}"
            if time.monotonic() - last > EVERY:
                last = time.monotonic()
                self.note(text)

        with self._said_late(lambda: text):
            yield step

    def note(self, text: str) -> None:
        self._stream.write(f"{clean(text)}\n")
        self._stream.flush()

    @contextmanager
    def _said_late(self, text: Callable[[], str]) -> Iterator[None]:
        timer = threading.Timer(FIRST, lambda: self.note(text()))
        timer.daemon = True
        timer.start()
        try:
            yield
        finally:
            timer.cancel()


def listener(*, silent: bool) -> Listener:
    """The listener for this process's standard error."""
    if silent or not _is_watched(sys.stderr):
        return SILENT
    return TerminalListener() if sys.stderr.isatty() else LinesListener(sys.stderr)


def _is_watched(stream: TextIO) -> bool:
    """Whether a stream leads out of the process; one that a program put in its place is read when all is done."""
    try:
        return stream.fileno() >= 0
    except (OSError, ValueError, AttributeError):
        return False
