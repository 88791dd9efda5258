"""The summary of a result for a terminal: the answer first, plain text, colour only as a help.

What a person acts on is shown: where things are, how well that is known, what was left out, what warns. What passed
and what the methods give beside it is folded into a line, and shown when asked for. Every table fits 80 columns and
uses the width there is; a status is always a word. Rich drops the colours by itself when the output is not a terminal.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from textwrap import fill
from typing import Literal

from rich.columns import Columns
from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.table import Table
from rich.text import Text

from calibrant.cameras import Camera
from calibrant.data import DEFAULT_CAMERA, CalibrationResult, Check, TransformEstimate
from calibrant.diagnose.budget.volume import is_workspace_check
from calibrant.diagnose.look import Look, look
from calibrant.diagnose.loop import LoopView, by_view
from calibrant.reports.kinds.registry import kind_of
from calibrant.reports.parts.blocks import TextTable
from calibrant.reports.parts.figures import (
    Fact,
    is_point,
    listed_figures,
    matrix_text,
    method_rows,
    quaternion_figures,
    translation_figures,
    yaw_pitch_roll_figures,
)
from calibrant.reports.parts.numbers import Figure, plain, sigma_text
from calibrant.reports.parts.phrases import decisions
from calibrant.reports.parts.rows import ViewRow, view_rows
from calibrant.reports.words import (
    FEW,
    STATUS_WORDS,
    sorted_checks,
    title,
    verdict_sentence,
    verdict_word,
)

_STATUS_STYLES = {"ok": "green", "warn": "yellow", "fail": "bold red"}
_VERDICT_STYLES = {"ok": "bold green", "warn": "bold yellow", "refused": "bold red"}
_VIEW_STYLES = {"used": "", "used, flagged": "yellow", "left out": "red"}
_ALL_VIEWS_UP_TO = 40
"""Longer lists scroll the verdict's reasons out of sight: then only views with a reason and the worst are shown."""
_WORST_SHOWN = 5
_GAP = 2
"""Blanks after a column."""


def summary(at: CalibrationResult | Look, *, verbose: bool = False) -> RenderableType:
    """What a person wants to know after a calibration: the answer first, the verdict last, where the eye is.

    Args: at, a result of any kind, or a look at one that serves others too; parts it does not have are left out.
    verbose: with the methods beside it, the checks that passed, and transforms as matrices.
    Returns: a rich renderable.
    """
    seen = look(at)
    result, kind = seen.result, kind_of(seen.result)
    if kind.terminal is not None:
        return Group(*kind.terminal(result), *notes(result))
    parts: list[RenderableType] = [_headed(title(result))]
    if result.transforms:
        parts.append(Columns([_transform_table(t, matrix=verbose) for t in result.transforms], padding=(0, 3)))
    parts += [_camera_table(name, camera) for name, camera in result.cameras.items()]
    parts += [text_table(table) for table in kind.tables(result)]
    facts = kind.facts(result)
    if facts:
        parts.append(_facts_table(facts))
    if result.methods and verbose:
        parts.append(_methods_table(result))
    rows = view_rows(result)
    if rows:
        parts.append(_views(rows, by_view(seen.loop), name=kind.rows))
    if result.decided:
        parts.append(_headed("Decided", Text(decisions(result))))
    if result.checks:
        parts.append(_checks(sorted_checks(result), said=kind.said, verbose=verbose))
    return Group(*parts, *notes(result), _verdict(result))


def notes(result: CalibrationResult) -> list[RenderableType]:
    """What readers said: which parts of the inputs were not used; nothing where they said nothing."""
    return [_headed("Notes", *(Text(note) for note in result.notes))] if result.notes else []


def text_table(given: TextTable) -> RenderableType:
    """A table of texts with its heading and its note."""
    note = [Text(given.note, style="dim")] if given.note else []
    return _headed(given.heading, *([_Fitting(given)] if given.rows else []), *note)


@dataclass(frozen=True)
class _Fitting:
    """A table as wide as the terminal: where that is narrow, headings of numbers take several lines, then names do."""

    given: TextTable

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        columns, rows = self.given.columns, self.given.rows
        longest = [max(len(row[k]) for row in rows) for k in range(len(columns))]
        headings = [column.name for column in columns]
        if sum(max(n, len(h)) for n, h in zip(longest, headings)) + _GAP * len(columns) > options.max_width:
            headings = [_broken(h, n) if c.number else h for c, h, n in zip(columns, headings, longest)]
        table = _table(header=any(headings))
        for column, heading in zip(columns, headings):
            side: Literal["left", "right"] = "right" if column.number else "left"
            table.add_column(heading, justify=side, no_wrap=column.number, overflow="fold")
        for row in rows:
            table.add_row(*map(Text, row))
        yield table


def _broken(heading: str, longest: int) -> str:
    """A heading on several lines, as narrow as its words and the column's numbers let it be."""
    return fill(heading, max(longest, 1, *map(len, heading.split())), break_long_words=False)


def _table(*, header: bool = True) -> Table:
    return Table(box=None, pad_edge=False, padding=(0, _GAP, 0, 0), header_style="dim", show_header=header)


def _headed(heading: str, *parts: RenderableType) -> RenderableType:
    # A heading of its own, not the table's title: that would wrap at the width of a narrow table.
    return Group(Text(heading, style="bold"), *parts, Text())


def _camera_table(name: str, camera: Camera) -> RenderableType:
    width, height = camera.image_size
    label = "" if name == DEFAULT_CAMERA else f" {name}"
    table = _table()
    table.add_column("parameter")
    table.add_column("value", justify="right", no_wrap=True)
    table.add_column("± 1σ", justify="right", no_wrap=True)
    table.add_column("± 3σ", justify="right", no_wrap=True)
    table.add_column("unit")
    figures, others = listed_figures(camera)
    for figure in figures:
        unit = "" if figure.unit == "1" else figure.unit
        three = "" if figure.fixed else figure.sigma_text(3)
        table.add_row(figure.name, figure.value_text, figure.sigma_text(), three, unit)
    more = [Text(others, style="dim")] if others else []
    return _headed(f"Camera{label}: {camera.model.name}, {width} × {height} px", table, *more)


def _transform_table(estimate: TransformEstimate, *, matrix: bool) -> RenderableType:
    """Position and turn side by side, as few lines as they can have. matrix: with the 4x4 below."""
    heading = f"{estimate.parent} → {estimate.child} (T_{estimate.parent}_{estimate.child})"
    table = _table()
    for name, justify in (("", "left"), ("value", "right"), ("± 1σ", "right"), ("unit", "left")) * 2:
        table.add_column(name, justify=justify, no_wrap=True)  # type: ignore[arg-type]
    turn = [] if is_point(estimate) else yaw_pitch_roll_figures(estimate)
    for pair in zip_longest(translation_figures(estimate), turn):
        table.add_row(*(cell for figure in pair if figure is not None for cell in _figure_cells(figure)))
    if is_point(estimate):
        return _headed(heading, table)
    quaternion = ", ".join(figure.value_text for figure in quaternion_figures(estimate))
    below = [f"quaternion x, y, z, w: {quaternion}"]
    if (turns := estimate.sigma_rotation_deg) is not None:
        about = ", ".join(sigma_text(float(s)) for s in turns)
        below.append(f"rotation 1σ about {estimate.parent} x, y, z: {about} deg")
    if matrix:
        below.append(f"matrix, metres:\n{matrix_text(estimate.matrix)}")
    return _headed(heading, table, *(Text(line, style="dim") for line in below))


def _figure_cells(figure: Figure) -> tuple[str, str, str, str]:
    return figure.name, figure.value_text, figure.sigma_text(), "" if figure.unit == "1" else figure.unit


def _facts_table(facts: list[Fact]) -> RenderableType:
    table = _table(header=False)
    table.add_column(no_wrap=True)
    table.add_column(no_wrap=True)
    table.add_column(style="dim")
    for fact in facts:
        table.add_row(fact.name, fact.text, fact.note)
    return _headed("Errors and noise", table)


def _methods_table(result: CalibrationResult) -> RenderableType:
    table = _table()
    table.add_column("method", no_wrap=True)
    for heading in ("loop mm", "loop deg", "from joint mm", "deg"):
        table.add_column(heading, justify="right")
    table.add_column("", overflow="fold")
    for row in method_rows(result):
        figures = (row.loop_mm, row.loop_deg, row.from_joint_mm, row.from_joint_deg)
        table.add_row(row.name, *(_optional(f) for f in figures), Text(row.message))
    return _headed("Methods: spread of the loop that should be constant, RMS", table)


def _views(rows: list[ViewRow], loop: Mapping[tuple[str, str], LoopView], *, name: str) -> RenderableType:
    """The rows' table; name: what they are, in the plural."""
    used = [row for row in rows if row.used]
    shown = _worth_a_look(rows, loop)
    with_camera, with_rms = len({row.camera for row in rows}) > 1, any(row.rms_px is not None for row in rows)
    table = _table()
    if with_camera:
        table.add_column("camera")
    table.add_column(name.removesuffix("s"), overflow="fold", max_width=28)
    # Beside a loop there is no room for the worst point; the report has it.
    with_max = not loop and any(row.max_px is not None for row in rows)
    headings = ["points", "RMS px"] * with_rms + ["max px"] * with_max + ["loop mm", "loop deg"] * bool(loop)
    for heading in headings:
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("", overflow="fold")
    for row in shown:
        cells: list[RenderableType] = [Text(row.camera)] if with_camera else []
        cells.append(Text(row.id))
        if with_rms:
            points = str(row.points) if not row.points_left_out else f"{row.points} (−{row.points_left_out})"
            cells += [points, _optional(row.rms_px)]
        if with_max:
            cells.append(_optional(row.max_px))
        if loop:
            step = loop.get((row.camera, row.id))
            cells += [_optional(step.mm if step else None), _optional(step.deg if step else None)]
        words = row.status if not row.reason else f"{row.status}: {row.reason}"
        table.add_row(*cells, Text(words, style=_VIEW_STYLES[row.status]))
    hidden = len(rows) - len(shown)
    more = (
        [Text(f"{hidden} more {name} used without remark; the report lists them all.", style="dim")] if hidden else []
    )
    return _headed(f"{name.capitalize()}: {len(used)} of {len(rows)} used", *([table] if shown else []), *more)


def _worth_a_look(rows: list[ViewRow], loop: Mapping[tuple[str, str], LoopView]) -> list[ViewRow]:
    """All rows, or of many those with a reason and the worst, by pixels where they are known, else by the loop."""
    if len(rows) <= _ALL_VIEWS_UP_TO:
        return rows

    def badness(row: ViewRow) -> float:
        step = loop.get((row.camera, row.id))
        return row.rms_px if row.rms_px is not None else step.mm if step is not None and step.mm is not None else 0.0

    worst = sorted((row for row in rows if row.used and badness(row) > 0), key=badness, reverse=True)[:_WORST_SHOWN]
    return [row for row in rows if row.reason or row in worst]


def _checks(checks: Sequence[Check], *, said: Sequence[str], verbose: bool) -> RenderableType:
    """The checks, the worst first; many that passed in one line, but for answers that were asked for."""
    every = verbose or sum(c.status == "ok" for c in checks) <= FEW
    shown = [c for c in checks if every or c.status != "ok" or is_workspace_check(c) or c.name.startswith(tuple(said))]
    passed = len(checks) - len(shown)
    table = _table(header=False)
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold", max_width=24)
    table.add_column("", overflow="fold")
    for check in shown:
        status = Text(STATUS_WORDS[check.status], style=_STATUS_STYLES[check.status])
        table.add_row(status, Text(check.name), Text(check.message))
    words = f"{passed} {'more ' if shown else ''}check{'s' * (passed > 1)} passed; --verbose or the report shows them"
    folded = [Text(words, style="dim")] if passed else []
    return _headed("Checks", *([table] if shown else []), *folded)


def _verdict(result: CalibrationResult) -> Text:
    style = _VERDICT_STYLES[result.verdict]
    return Text.assemble((f"Verdict: {verdict_word(result)}.", style), f" {verdict_sentence(result)}")


def _optional(value: float | None) -> str:
    return "–" if value is None else plain(value, digits=3)
