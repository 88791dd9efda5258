"""A result in words: ten lines for `print`, the terminal's text, a page's piece for a notebook."""

from __future__ import annotations

from dataclasses import replace
from io import StringIO
from textwrap import shorten, wrap

from calibrant.advice import in_python
from calibrant.data import CalibrationResult, Check
from calibrant.reports.kinds.registry import kind_of
from calibrant.reports.parts.blocks import Block
from calibrant.reports.words import STATUS_WORDS, accuracy, sorted_checks, title, verdict_word

WIDTH = 80
"""Columns of a summary: what every terminal has."""
_MOST_WARNINGS = 4
"""Of many warnings the worst are said; the summary has them all."""
_SENTENCE = 120
"""Letters of a line of the verdict's sentence."""
_LINE = 96
"""Letters of a warning: the first words say what it is about."""


def brief(result: CalibrationResult) -> str:
    """What it is, the verdict, the figures that count, and the checks that warn, a line each: some ten lines."""
    result = _told(result)
    known = f" {accuracy(result)}" if result.verdict != "refused" else ""
    lines = [title(result), *wrap(f"{verdict_word(result)}.{known}", _SENTENCE)]
    facts = kind_of(result).headline(result)
    wide = max((len(fact.name) for fact in facts), default=0)
    lines += [f"  {fact.name:<{wide}}  {f'{fact.value} {fact.text}'.strip()}" for fact in facts]
    warned = _warned(result)
    for check in warned[:_MOST_WARNINGS]:
        text = f"{STATUS_WORDS[check.status]}: {check.name}: {check.message}"
        lines.append(f"  {shorten(text, _LINE, placeholder=' …')}")
    if len(warned) > _MOST_WARNINGS:
        lines.append(f"  and {len(warned) - _MOST_WARNINGS} more: summary() tells all")
    return in_python("\n".join(lines))


def summary(result: CalibrationResult) -> str:
    """What the terminal shows, all that it can fold unfolded, as plain text."""
    from rich.console import Console

    from calibrant.reports.terminal import summary as shown

    text = StringIO()
    Console(file=text, width=WIDTH, color_system=None, force_terminal=False, legacy_windows=False).print(
        shown(_told(result), verbose=True)
    )
    return "\n".join(line.rstrip() for line in text.getvalue().splitlines())


def notebook(result: CalibrationResult) -> str:
    """The answer as a piece of HTML without scripts: verdict, headline, the checks that warn."""
    from calibrant.reports.html import result_head
    from calibrant.reports.page import render_answer

    result = _told(result)
    warned = _warned(result)
    return render_answer(result_head(result, [Block("checks", {"checks": warned})] if warned else []))


def _told(result: CalibrationResult) -> CalibrationResult:
    """The result, its advice in the words of Python."""
    return replace(
        result,
        checks=tuple(replace(c, message=in_python(c.message)) for c in result.checks),
        views=tuple(replace(v, reason=in_python(v.reason)) if v.reason else v for v in result.views),
    )


def _warned(result: CalibrationResult) -> list[Check]:
    return [check for check in sorted_checks(result) if check.status != "ok"]
