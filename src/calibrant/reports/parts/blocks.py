"""What a page is made of: a head that answers, and blocks, each drawn by the template of its name.

`templates/page.html.j2` is the one page of the house; `templates/blocks/NAME.html.j2` draws a block from its values. A
table can also be shown by a terminal.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import ceil, floor, log10
from typing import Any

from calibrant.reports.parts.figures import Fact


@dataclass(frozen=True)
class Block:
    """A part of a page: the name of its template, and what that needs, by name."""

    template: str
    values: Mapping[str, Any]


@dataclass(frozen=True)
class Column:
    """A column's heading; numbers stand at its right."""

    name: str
    number: bool = False


@dataclass(frozen=True)
class TextTable:
    """A table of texts under a heading, for a page and for a terminal; the first column names the rows.

    note: a sentence below. statuses: "ok", "warn" or "fail" of each row, which colours its name; empty for none.
    """

    heading: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""
    statuses: tuple[str, ...] = ()

    @property
    def block(self) -> Block:
        """The table as a block of a page."""
        return Block("table", {"table": self})


@dataclass(frozen=True)
class Page:
    """A page: what it is of, the answer first (verdict "ok", "warn", "refused" or empty, its word, a sentence, the
    figures that count), then blocks. data: for the scripts; None for a page without any."""

    title: str
    verdict: str
    word: str
    sentence: str
    facts: Sequence[Fact]
    blocks: Sequence[Block]
    kicker: str = ""
    created: str = ""
    data: Mapping[str, Any] | None = None
    scripts: Sequence[str] = field(default=())


def bars(heading: str, unit: str, names: Sequence[str], series: Mapping[str, Sequence[float | None]]) -> Block | None:
    """Bars side by side for each name, on a logarithmic scale: faults are a thousand times larger than noise.

    series: values by what they are, None where there is none. None for no value above 0.
    """
    values = [v for row in series.values() for v in row if v is not None and v > 0]
    if not values:
        return None
    low, high = floor(log10(min(values))), ceil(log10(max(values)) + 1e-9)
    low, high = max(low, high - _MOST_DECADES), max(high, low + 1)
    scale = (_HEIGHT - _BOTTOM - _TOP) / (high - low)
    step = (_WIDTH - _LEFT) / len(names)
    foot = _HEIGHT - _BOTTOM
    lines = [{"y": foot - (power - low) * scale, "text": f"{10.0**power:g} {unit}"} for power in range(low, high + 1)]
    wide = 0.8 / len(series)
    drawn = [
        {
            "x": _LEFT + (i + 0.1 + wide * k) * step,
            "y": foot - max(1.0, (log10(value) - low) * scale),
            "width": 0.95 * wide * step,
            "height": max(1.0, (log10(value) - low) * scale),
            "series": k,
            "text": f"{names[i]}, {what}: {value:.3g} {unit}",
        }
        for k, (what, row) in enumerate(series.items())
        for i, value in enumerate(row)
        if value is not None and value > 0
    ]
    every = -(-len(names) // _MOST_LABELS)
    labels = [{"x": _LEFT + (i + 0.5) * step, "text": name[:_LABEL]} for i, name in enumerate(names) if not i % every]
    size = {"width": _WIDTH, "height": _HEIGHT, "left": _LEFT, "foot": _HEIGHT - 10}
    values_of = {"lines": lines, "bars": drawn, "labels": labels, "legend": list(series), "unit": unit, **size}
    return Block("bars", {"heading": heading, **values_of})


_WIDTH, _HEIGHT, _LEFT, _BOTTOM, _TOP = 900, 240, 60, 30, 10
"""Of a chart of bars, in units of its own."""
_MOST_DECADES = 6
_MOST_LABELS, _LABEL = 30, 8
"""Names below the bars, and letters of each, that still stand apart."""
