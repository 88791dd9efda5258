"""Stopping long work on request: whoever starts it holds a token, the work asks for it once a step.

    token = Token()
    with cancellable(token):      # in the thread that works
        ...                       # token.cancel() from any other thread

`checkpoint` stands in every loop that a person may wait for: each step of the optimizer, each image, each hypothesis
of the doctor. Cancelled work raises CancelledError at the next of them and writes nothing. A token stays cancelled
until it is `answered`, so that code that takes an error for an answer (one hypothesis of many does not fit) is stopped
at its next step.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from threading import Event

from calibrant.errors import CancelledError

__all__ = ["CancelledError", "Token", "answered", "cancellable", "checkpoint", "undisturbed"]


class Token:
    """Says whether work is to stop; safe to use from any thread."""

    def __init__(self) -> None:
        self._asked = Event()

    def cancel(self) -> None:
        """Ask the work to stop at its next step."""
        self._asked.set()

    def answer(self) -> None:
        """What was asked has been done; work goes on until it is asked again."""
        self._asked.clear()

    @property
    def cancelled(self) -> bool:
        """Whether the work was asked to stop."""
        return self._asked.is_set()


_token: ContextVar[Token | None] = ContextVar("calibrant-cancel", default=None)


@contextmanager
def cancellable(token: Token) -> Iterator[None]:
    """What runs inside, in this thread, stops when the token is cancelled."""
    before = _token.set(token)
    try:
        yield
    finally:
        _token.reset(before)


def checkpoint() -> None:
    """Raises: CancelledError when the work that this is a step of was asked to stop."""
    token = _token.get()
    if token is not None and token.cancelled:
        raise CancelledError("cancelled; no result was written")


def answered() -> None:
    """A task that a person ends by Ctrl-C, as a running camera's, has ended: what it does with what it has is not
    stopped by that."""
    token = _token.get()
    if token is not None:
        token.answer()


@contextmanager
def undisturbed() -> Iterator[list[int]]:
    """Ctrl-C waits for the few moments of what runs inside; its signals are in the list after it.

    Elsewhere than in the main thread, where no signal arrives, nothing is to be done.
    """
    told: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield told
        return
    before = signal.signal(signal.SIGINT, lambda number, frame: told.append(number))
    try:
        yield told
    finally:
        signal.signal(signal.SIGINT, before if before is not None else signal.default_int_handler)
