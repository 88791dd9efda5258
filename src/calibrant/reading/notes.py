"""What readers say on their way: a key that was not used, a column that was passed over.

    with heard() as notes:        # whoever runs a task
        ...                       # a reader calls note("camera.yaml: not used: binning_x")

What is noted while nobody listens, as where a reader is called from Python by itself, is a Python warning.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_heard: ContextVar[list[str] | None] = ContextVar("calibrant-notes", default=None)
_LISTED = 12
"""Names in a note: more are counted."""


@contextmanager
def heard() -> Iterator[list[str]]:
    """Collects what is noted inside, in this thread; each sentence once."""
    notes: list[str] = []
    before = _heard.set(notes)
    try:
        yield notes
    finally:
        _heard.reset(before)


def note(text: str) -> None:
    """Say something to whoever listens."""
    notes = _heard.get()
    if notes is None:
        warnings.warn(text, stacklevel=3)
    elif text not in notes:
        notes.append(text)


def note_unused(source: str, names: Iterable[str]) -> None:
    """Say which parts of a file were not used; nothing where all were."""
    unused = list(dict.fromkeys(names))
    if unused:
        more = f" and {len(unused) - _LISTED} more" if len(unused) > _LISTED else ""
        note(f"{source}: not used: {', '.join(unused[:_LISTED])}{more}")
