"""Results of `calibrant verify watch`: since when and by how much a camera has been moved, picture by picture."""

from __future__ import annotations

from typing import TYPE_CHECKING

from calibrant.data import CalibrationResult
from calibrant.data.details import Watching
from calibrant.percent import percent
from calibrant.reports.kinds.verified.runs import run_answer, run_tables, run_terminal
from calibrant.reports.parts.blocks import Block, Column, TextTable
from calibrant.reports.parts.figures import Fact
from calibrant.reports.parts.kind import Kind
from calibrant.reports.parts.numbers import with_sigma

if TYPE_CHECKING:
    from rich.console import RenderableType

    from calibrant.diagnose.look import Look

VERDICTS = {"ok": "NOT MOVED", "warn": "NOT MOVED, with a remark", "refused": "MOVED"}
AROUND = 12
"""Pictures that are shown before and after the one that told: the rest look alike."""


def _facts(result: CalibrationResult) -> list[Fact]:
    return [Fact(name, with_sigma(f.value, f.sigma, unit=f.unit)) for name, f in result.figures.items()]


def _headline(result: CalibrationResult) -> list[Fact]:
    return _facts(result)[:3]


def _answer(result: CalibrationResult) -> str:
    found = result.detail(Watching)
    if found is None:
        return run_answer(result)
    return f"{found.answer[:1].upper()}{found.answer[1:]}."


def _chance(value: float | None) -> str:
    if value is None:
        return "–"
    return "below 1 in a million" if value < 1e-6 else percent(value)


def _tables(result: CalibrationResult) -> list[TextTable]:
    found = result.detail(Watching)
    if found is None or not found.pictures:
        return run_tables(result)
    names = [p.name for p in found.pictures]
    middle = names.index(found.at) if found.at in names else len(names) - 1
    shown = found.pictures[max(middle - AROUND, 0) : middle + AROUND + 1]
    rows = tuple((p.name, _chance(p.chance), p.remark or "–") for p in shown)
    note = (
        f"{len(rows)} of {len(names)} pictures. The chance is that of as much where nothing moved, all questions of a "
        f"picture together; below 1 in {found.run:.0f} the camera is called moved."
    )
    columns = (Column("picture"), Column("chance", True), Column("remark"))
    return [TextTable("Picture by picture", columns, rows, note)]


def _page(look: Look) -> list[Block]:
    result = look.result
    found = result.detail(Watching)
    blocks = [Block("advice", {"advice": found.advice})] if found is not None and found.advice else []
    blocks += [table.block for table in _tables(result)]
    if result.checks:
        blocks.append(Block("checks", {"checks": list(result.checks)}))
    return blocks


def _terminal(result: CalibrationResult) -> list[RenderableType]:
    from rich.text import Text

    found = result.detail(Watching)
    if found is None:
        return run_terminal(result)
    style = "bold red" if result.verdict == "refused" else "bold green"
    parts: list[RenderableType] = [Text(_answer(result), style=style)]
    if found is not None and found.advice:
        parts += [Text(), Text(found.advice)]
    return parts + [Text(f"Note: {c.message}.", style="yellow") for c in result.checks if c.status == "warn"]


KIND = Kind(
    "Has the camera been moved?",
    _headline,
    _answer,
    _facts,
    "pictures",
    _tables,
    page=_page,
    terminal=_terminal,
    verdicts=VERDICTS,
)
