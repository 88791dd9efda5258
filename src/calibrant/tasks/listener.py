"""Who is told how far a task is. Silent by default; a terminal or a page makes its own from this class."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

Step = Callable[[int, int, str], None]
"""Called with how many are done, how many there are, and the name of the last one."""


class Listener:
    """Hears what a task does; this one says nothing. Whether it is to stop, the work asks `calibrant.cancel`.

    class Loud(Listener):
        def note(self, text: str) -> None:
            print(text)
    """

    @contextmanager
    def status(self, text: str) -> Iterator[None]:
        """Something that takes a while runs inside."""
        yield

    @contextmanager
    def progress(self, title: str) -> Iterator[Step]:
        """Something that is counted runs inside, and calls what it is given after each step."""
        yield lambda done, total, name: None

    def note(self, text: str) -> None:
        """A sentence that a person should read now."""

    def ask(self, question: str) -> bool:
        """Whether a person says yes; where nobody can be asked, no. The question has no mark at its end."""
        return False


SILENT = Listener()
