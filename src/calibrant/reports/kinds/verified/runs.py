"""Results of tasks that verify a calibration: run by run, the error beside what was predicted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from calibrant.data import CalibrationResult
from calibrant.data.details import TaskRun, TaskRuns
from calibrant.reports.parts.blocks import Block, Column, TextTable
from calibrant.reports.parts.figures import Fact
from calibrant.reports.parts.kind import Kind
from calibrant.reports.parts.numbers import with_sigma

if TYPE_CHECKING:
    from rich.console import RenderableType

    from calibrant.diagnose.look import Look

VERDICTS = {"ok": "PASSED", "warn": "PASSED, with a remark", "refused": "FAILED"}
Cell = Callable[[TaskRun], str]


def _number(value: float | None, digits: int = 2) -> str:
    return "–" if value is None else f"{value:.{digits}f}"


def _offset(run: TaskRun) -> str:
    if run.offset_mm is None or run.sigma_mm is None:
        return "–"
    return ",\n".join(f"{v:.2f} ± {s:.2f}" for v, s in zip(run.offset_mm, run.sigma_mm))


OFFSETS = "x, y, z, mm"
COLUMNS: Sequence[tuple[str, Cell, Callable[[TaskRun], object]]] = (
    ("error, mm", lambda r: _number(r.error_mm), lambda r: r.error_mm),
    ("95 %, mm", lambda r: _number(r.predicted_95_mm), lambda r: r.predicted_95_mm),
    ("inside", lambda r: "–" if r.inside is None else "yes" if r.inside else "no", lambda r: r.inside),
    (OFFSETS, _offset, lambda r: r.offset_mm),
    ("turn, deg", lambda r: _number(r.turned_deg, 3), lambda r: r.turned_deg),
    ("after correction, mm", lambda r: _number(r.after_mm), lambda r: r.after_mm),
    ("after, deg", lambda r: _number(r.after_deg, 3), lambda r: r.after_deg),
    ("passed", lambda r: "yes" if r.passed else "NO", lambda r: True),
    ("remark", lambda r: r.reason or "–", lambda r: r.reason or None),
)
"""Header, text of a run, and what must be there in some run for the column to be shown."""


def run_tables(result: CalibrationResult) -> list[TextTable]:
    """Run by run, and what stands beside."""
    found = result.detail(TaskRuns)
    if found is None or not found.runs:
        return []
    shown = [c for c in COLUMNS if any(c[2](r) is not None for r in found.runs)]
    words = {OFFSETS, "remark", "passed", "inside"}
    names = [name.replace("after correction", found.after) for name, _, _ in shown]
    columns = (Column("run"), *(Column(name, name not in words) for name in names))
    rows = tuple((r.name, *(text(r) for _, text, _ in shown)) for r in found.runs)
    note = f"95 %: of errors that the calibration predicts. x, y, z: along the axes of the {found.frame}, where the "
    note += "camera said, less where it is."
    tables = [TextTable("Run by run", columns, rows, note if any(r.offset_mm for r in found.runs) else "")]
    if found.beside:
        pairs = tuple((name, text) for name, text in found.beside.items())
        tables.append(TextTable("Beside it", (Column("way"), Column("result")), pairs, ""))
    return tables


def _facts(result: CalibrationResult) -> list[Fact]:
    return [Fact(name, with_sigma(f.value, f.sigma, unit=f.unit)) for name, f in result.figures.items()]


def _headline(result: CalibrationResult) -> list[Fact]:
    return _facts(result)[:4]


def run_answer(result: CalibrationResult) -> str:
    """How many passed."""
    found = result.detail(TaskRuns)
    first = next((c for c in result.checks if found is not None and c.name == found.task), None)
    return "" if first is None else f"{first.message[:1].upper()}{first.message[1:]}."


def _page(look: Look) -> list[Block]:
    result = look.result
    found = result.detail(TaskRuns)
    blocks = [Block("advice", {"advice": found.advice})] if found is not None and found.advice else []
    blocks += [table.block for table in run_tables(result)]
    if result.checks:
        blocks.append(Block("checks", {"checks": list(result.checks)}))
    return blocks


def run_terminal(result: CalibrationResult) -> list[RenderableType]:
    """The answer, the tables, what to do, and what the checks say."""
    from rich.table import Table
    from rich.text import Text

    style = "bold red" if result.verdict == "refused" else "bold green"
    parts: list[RenderableType] = [Text(run_answer(result), style=style)]
    for table in run_tables(result):
        drawn = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="dim")
        for column in table.columns:
            drawn.add_column(column.name, no_wrap=column.name == OFFSETS, justify="right" if column.number else "left")
        for row in table.rows:
            drawn.add_row(*map(str, row))
        parts += [Text(), Text(table.heading, style="bold"), drawn]
    found = result.detail(TaskRuns)
    if found is not None and found.advice:
        parts += [Text(), Text(found.advice)]
    for check in result.checks:
        if found is not None and check.name != found.task:
            parts.append(
                Text(f"{check.message[:1].upper()}{check.message[1:]}.", style="yellow" * (check.status != "ok"))
            )
    return parts


def kind(title: str) -> Kind:
    """The kind of a task's results."""
    return Kind(
        title, _headline, run_answer, _facts, "runs", run_tables, page=_page, terminal=run_terminal, verdicts=VERDICTS
    )


PINPOINT = kind("The tip to a marker's centre")
TOUCH = kind("Touched points against the camera")
HELD_OUT = kind("Fresh views against the calibration")
PICK_PLACE = kind("A cube set upon another one")
STITCH = kind("Clouds of many poses")
