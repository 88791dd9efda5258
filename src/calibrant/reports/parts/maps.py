"""Maps over an image: cells as dark as their value, arrows magnified, drawn without a script."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from calibrant.reports.parts.blocks import Block
from calibrant.reports.parts.numbers import plain

_LONGEST = 0.06
"""Length of the longest arrow, of the image's width, at most."""
_FACTORS = tuple(k * 10**n for n in range(6) for k in (1, 2, 5))


@dataclass(frozen=True)
class ImageMap:
    """values on columns x rows places over an image of (width, height) px, row by row, None where there is none; at the
    middle of each cell an arrow (du, dv) where there are any. title, note: in words, above and below."""

    title: str
    image_size: tuple[int, int]
    columns: int
    rows: int
    values: Sequence[float | None]
    unit: str
    note: str = ""
    arrows: Sequence[tuple[float, float] | None] = field(default=())


def maps_block(heading: str, words: str, maps: Sequence[ImageMap]) -> Block:
    """Maps under a heading, side by side. words: what they show."""
    return Block("maps", {"heading": heading, "words": words, "maps": [_drawn(m) for m in maps]})


def _drawn(m: ImageMap) -> dict[str, object]:
    width, height = m.image_size
    w, h = width / m.columns, height / m.rows
    known = [v for v in m.values if v is not None]
    low, high = min(known, default=0.0), max(known, default=0.0)
    cells = [
        {
            "x": i % m.columns * w,
            "y": i // m.columns * h,
            "darkness": None if v is None else v / high if high > 0 else 0.0,
            "text": "not seen" if v is None else f"{plain(v, digits=3)} {m.unit}",
        }
        for i, v in enumerate(m.values)
    ]
    factor, arrows = _arrows(m, w, h)
    return {
        "title": m.title,
        "width": width,
        "height": height,
        "w": w,
        "h": h,
        "cells": cells,
        "arrows": arrows,
        "factor": factor,
        "low": plain(low, digits=2),
        "high": plain(high, digits=2),
        "unit": m.unit,
        "note": m.note,
        "stroke": width / 500,
    }


def _arrows(m: ImageMap, w: float, h: float) -> tuple[int, list[dict[str, float]]]:
    longest = max(((a[0] ** 2 + a[1] ** 2) ** 0.5 for a in m.arrows if a is not None), default=0.0)
    if longest == 0.0:
        return 1, []
    most = _LONGEST * m.image_size[0]
    factor = max((k for k in _FACTORS if k * longest <= most), default=1)
    places = ((((i % m.columns) + 0.5) * w, (i // m.columns + 0.5) * h) for i in range(len(m.arrows)))
    return factor, [
        {"x1": x, "y1": y, "x2": x + factor * a[0], "y2": y + factor * a[1]}
        for (x, y), a in zip(places, m.arrows)
        if a is not None
    ]
