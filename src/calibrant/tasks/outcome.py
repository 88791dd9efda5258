"""What a task hands back: a result, and what is to be written; whoever called the task renders and writes it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from calibrant.data import CalibrationResult
    from calibrant.errors import CalibrantError


@dataclass(frozen=True)
class Document:
    """A file to be written whole or not at all. content: its bytes, or what makes them when their turn comes, so that
    of a thousand pictures one at a time is in memory. within: a folder that is written as a whole, and made with those
    in it; of another file the one folder that it lies in is made."""

    path: Path
    content: bytes | Callable[[], bytes]
    within: Path | None = None

    def bytes(self) -> bytes:
        """The content, made now where it is made late."""
        return self.content if isinstance(self.content, bytes) else self.content()


@dataclass(frozen=True, eq=False)
class Answer:
    """What a task found where that is no calibration: a study's tables. value: from Python; text: the same as JSON."""

    value: Any
    text: Callable[[], str]


@dataclass(frozen=True)
class NextStep:
    """What to do next, in words, and the command that does it: with the arguments that this one was given, and more."""

    words: str
    command: str
    more: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """The end of a task.

    result: the reviewed result; None for tasks that only make documents. answer: what stands in its place.
    documents: what was asked for by name, written by whoever called the task, all or none of them.
    beside: documents that accompany the result file, where one is written; their paths are file names alone.
    summary, page: a terminal's words (Rich renderables, texts, and results, which are told as every result is; a tuple
    of several in their order) and an HTML page, where they are not those that every result has.
    warnings: what a person should know where there is no result whose checks say it. then: what to do next.
    printed: what --json prints, where that is not the result file's text: a series' table as data.
    refusal: raised when all is shown and written: the task did its work, and its answer is no.
    """

    result: CalibrationResult | None = None
    answer: Answer | None = None
    documents: Iterable[Document] = ()
    beside: tuple[Document, ...] = ()
    summary: Callable[[], Any] | None = None
    page: Callable[[], str] | None = None
    warnings: tuple[str, ...] = ()
    then: NextStep | None = None
    printed: Callable[[], str] | None = None
    refusal: CalibrantError | None = None

    def noted(self, notes: Sequence[str]) -> Outcome:
        """The outcome whose result says what readers said on the way; where there is none, it warns of it."""
        if not notes:
            return self
        if self.result is None:
            return replace(self, warnings=(*self.warnings, *notes))
        return replace(self, result=replace(self.result, notes=(*self.result.notes, *notes)))

    def text(self) -> str:
        """The result file's text, or that of the answer; nothing for tasks that only make documents."""
        if self.answer is not None:
            return self.answer.text() + "\n"
        return "" if self.result is None else _result_text(self.result)


def result_document(result: CalibrationResult, path: Path) -> Document:
    """A result file, its text made when its turn comes."""
    return Document(path, lambda: _result_text(result).encode())


def page_document(result: CalibrationResult, path: Path, **how: Any) -> Document:
    """A result's page, HTML or PDF by the file's ending, made when its turn comes. Args: how, as `report_page`."""
    return Document(path, partial(_page, result, path, how))


def _result_text(result: CalibrationResult) -> str:
    from calibrant.data.result_file import result_text

    return result_text(result) + "\n"


def _page(result: CalibrationResult, path: Path, how: dict[str, Any]) -> bytes:
    from calibrant.reports.html import report_file, report_page

    return report_file(lambda still: report_page(result, still=still, **how), path)
