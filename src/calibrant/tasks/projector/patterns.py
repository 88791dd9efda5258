"""The patterns that a projector shows: pictures, and a page that shows them one after the other."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.option import Option
from calibrant.tasks.options.patterns import PatternOptions
from calibrant.tasks.outcome import Document, Outcome

if TYPE_CHECKING:
    from rich.text import Text

    from calibrant.patterns.sequence import Pattern, PatternSequence

EXAMPLE = 'cb.projector_patterns(projector_size="1024x768", out="patterns")'
PAGE = "patterns.html"


@dataclass(frozen=True, kw_only=True)
class Request:
    """Write the patterns that a projector shows, as pictures and as a page that shows them full-screen.

    calibrant projector patterns --projector-size 1024x768 --out patterns

    Open patterns.html on the projector's screen, press F for full screen, and a key or a click for each next pattern;
    or let it step by itself. Take one photo a pattern, in their order, nothing moving.
    """

    patterns: PatternOptions = PatternOptions()
    out: Annotated[Path, Option("DIR", "-o", output="folder")]
    """The folder to write into."""


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """The pictures and the page. Raises: InputError for an impossible size, period or count."""
    sequence = request.patterns.sequence()
    return Outcome(documents=_documents(sequence, request.out), summary=partial(_said, sequence, request.out))


def _documents(sequence: PatternSequence, folder: Path) -> Iterator[Document]:
    for name, pattern in zip(sequence.names, sequence.patterns):
        yield Document(folder / name, partial(_png, sequence, pattern))
    yield Document(folder / PAGE, partial(_page, sequence))


def _png(sequence: PatternSequence, pattern: Pattern) -> bytes:
    from calibrant.opencv import cv2

    return bytes(cv2.imencode(".png", sequence.picture(pattern), [cv2.IMWRITE_PNG_COMPRESSION, 9])[1])


def _page(sequence: PatternSequence) -> bytes:
    from calibrant.reports.pattern_page import pattern_page

    pictures = [(p.words, _png(sequence, p)) for p in sequence.patterns]
    return pattern_page(pictures, sequence.projector_size).encode()


def _said(sequence: PatternSequence, folder: Path) -> Text:
    from rich.text import Text

    width, height = sequence.projector_size
    count = len(sequence.patterns)
    return Text(
        f"{folder}: {count} patterns for {width} × {height} px, and {PAGE}, which shows them\n"
        "Open the page on the projector's screen at 100 %, press F for full screen; keystone correction and scaling "
        "off.\n"
        f"Take {count} photos of each pose of the board, one a pattern, and keep each pose in a folder of its own."
    )
