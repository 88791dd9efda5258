"""What a kind of result registers: its title, the answer and the figures that count, its rows, tables of its own."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from calibrant.data import CalibrationResult
from calibrant.reports.parts.blocks import Block, TextTable
from calibrant.reports.parts.figures import Fact, noise_facts

if TYPE_CHECKING:
    from rich.console import RenderableType

    from calibrant.diagnose.look import Look


def no_answer(result: CalibrationResult) -> str:
    """For a kind without an accuracy of its own."""
    return ""


def no_tables(result: CalibrationResult) -> list[TextTable]:
    """For a kind that has no other tables than every result."""
    return []


def no_blocks(look: Look) -> list[Block]:
    """For a kind without drawings of its own."""
    return []


@dataclass(frozen=True)
class Kind:
    """How results of a kind are told, by a terminal, a page, `print` and a notebook alike.

    headline: the few figures that answer "how good is it". answer: one sentence that says how well what was asked for
    is known, empty where nothing says so. facts: errors and noise. rows: what the rows of the result are, in the
    plural. tables: what only this kind has; blocks: the same, drawn, for a page. said: how names of checks begin whose
    message is an answer, shown though they passed. page and terminal: in place of the parts that other kinds have, for
    a kind that is no calibration.
    verdicts: own words for "ok", "warn" and "refused", where GOOD and DO NOT USE do not fit. judged: the verdict's word
    and its sentence, where they follow from more than that.
    """

    title: str
    headline: Callable[[CalibrationResult], list[Fact]]
    answer: Callable[[CalibrationResult], str] = no_answer
    facts: Callable[[CalibrationResult], list[Fact]] = noise_facts
    rows: str = "views"
    tables: Callable[[CalibrationResult], list[TextTable]] = no_tables
    blocks: Callable[[Look], list[Block]] = no_blocks
    said: tuple[str, ...] = ()
    page: Callable[[Look], list[Block]] | None = None
    terminal: Callable[[CalibrationResult], list[RenderableType]] | None = None
    verdicts: Mapping[str, str] = field(default_factory=dict)
    judged: Callable[[CalibrationResult], tuple[str, str]] | None = None
