"""What goes to a terminal, cleaned in one place: a file's name may hold codes that a terminal obeys.

Escape codes colour, move the cursor, change the window's title, and on some terminals type; marks of writing direction
turn words round. Names come from other people's folders, so that all of these are shown, not sent.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console

_CODES = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069\ud800-\udfff]")
"""Control characters but tab and new line, and those of writing direction; halves of pairs, which no stream takes."""


def clean(text: str) -> str:
    """The text with every code written out: `\\x1b`."""
    return _CODES.sub(lambda match: ascii(match[0])[1:-1], text)


def say(text: str) -> None:
    """Write to standard output."""
    sys.stdout.write(clean(text))


def tell(text: str) -> None:
    """Write a line to standard error."""
    sys.stderr.write(f"{clean(text)}\n")


def say_json(text: str) -> None:
    """Write JSON to standard output: codes stand in its texts alone, where JSON has a spelling for them."""
    sys.stdout.write(_CODES.sub(lambda match: f"\\u{ord(match[0]):04x}", text))


def console(*, stderr: bool = False, width: int | None = None) -> Console:
    """Rich's console, whose own codes are all that reaches the terminal."""
    from rich.console import Console, ConsoleOptions, RenderableType
    from rich.segment import Segment

    class CleanConsole(Console):
        """Cleans what it is given to show."""

        def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
            for segment in super().render(renderable, options):
                yield segment if segment.control else Segment(clean(segment.text), segment.style)

    return CleanConsole(stderr=stderr, width=width, markup=False, emoji=False)
