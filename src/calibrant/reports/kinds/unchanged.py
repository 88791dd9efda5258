"""Results of `calibrant verify unchanged`: whether a calibration still holds, what moved, and how to bring it back."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from calibrant.data import CalibrationResult
from calibrant.data.details import Changes, PhotoShift
from calibrant.percent import percent
from calibrant.reports.parts.blocks import Block, Column, TextTable
from calibrant.reports.parts.figures import Fact
from calibrant.reports.parts.kind import Kind
from calibrant.reports.parts.numbers import with_sigma

if TYPE_CHECKING:
    from rich.console import RenderableType

    from calibrant.diagnose.look import Look

VERDICTS = {"ok": "UNCHANGED", "warn": "UNCHANGED, with a remark", "refused": "CHANGED"}
FIRST = ("at the workpiece", "in the picture", "focal length")
"""The figures that answer "by how much"."""
_SHOWN_PX = 12.0
"""Shortest arrow, in pixels of a picture 1000 wide, that an eye follows."""
_FACTORS = (1, 2, 5, 10, 20, 50, 100)
_PICTURES = 3_000_000
"""Bytes of all pictures of a page."""


def _headline(result: CalibrationResult) -> list[Fact]:
    names = [name for name in FIRST if name in result.figures]
    return [Fact(name, _text(result, name), _note(result, name)) for name in names]


def _text(result: CalibrationResult, name: str) -> str:
    figure = result.figures[name]
    return with_sigma(figure.value, figure.sigma, unit=figure.unit)


def _note(result: CalibrationResult, name: str) -> str:
    if name != "in the picture":
        return "off by" if name == "at the workpiece" else "changed by"
    sides = (("to the right", "right", "left"), ("down", "down", "up"))
    return ", ".join(
        f"{with_sigma(abs(f.value), f.sigma, unit=f.unit)} {back if f.value < 0 else forth}"
        for f, forth, back in ((result.figures[name], forth, back) for name, forth, back in sides)
    )


def _facts(result: CalibrationResult) -> list[Fact]:
    return [Fact(name, _text(result, name)) for name in result.figures]


def _answer(result: CalibrationResult) -> str:
    changes = result.detail(Changes)
    return "" if changes is None else _capital(changes.answer)


def _capital(text: str) -> str:
    text = f"{text[:1].upper()}{text[1:]}"
    return text if text.endswith(".") else f"{text}."


def chance_text(value: float) -> str:
    """A chance in words that is never rounded to nothing."""
    if value < 1e-6:
        return "below 1 in a million"
    return percent(value)


def _table(result: CalibrationResult) -> TextTable | None:
    changes = result.detail(Changes)
    if changes is None or not changes.possible:
        return None
    columns = (Column("If this changed"), Column("By how much"), Column("Explains the photos", True))
    rows = tuple(
        (p.what, p.words or "–", "yes" if p.explains else f"no ({chance_text(p.fits)})") for p in changes.possible
    )
    changed = result.check("unchanged").status == "fail"
    note = (
        "No: photos that differ as much from the explanation are that rare."
        if changed
        else "Nothing has to have changed; these are the changes that would fit best, with what they are known to."
    )
    return TextTable("What may have changed", columns, rows, note)


def _tables(result: CalibrationResult) -> list[TextTable]:
    table = _table(result)
    return [] if table is None else [table]


def _terminal(result: CalibrationResult) -> list[RenderableType]:
    """The answer first, then what to do, what may have changed, and what these photos cannot tell."""
    from rich.text import Text

    changes = result.detail(Changes)
    if changes is None:
        return [Text("The result holds no comparison.")]
    style = "bold red" if result.verdict == "refused" else "bold green"
    parts: list[RenderableType] = [Text(_capital(changes.answer), style=style)]
    if changes.advice:
        parts += [Text(), Text(changes.advice)]
    parts += [Text(f"Note: {_capital(c.message)}", style="yellow") for c in result.checks if c.status == "warn"]
    if result.verdict == "refused" and changes.possible:
        parts += [Text(), Text("What may have changed", style="bold")]
        for p in changes.possible:
            mark = "explains it" if p.explains else "does not explain it"
            parts.append(Text(f"  {p.what} ({mark}): {p.words or '–'}"))
    return parts


def _page(look: Look) -> list[Block]:
    result = look.result
    changes = result.detail(Changes)
    if changes is None:
        return []
    blocks: list[Block] = []
    if changes.advice:
        blocks.append(Block("advice", {"advice": changes.advice}))
    blocks += [Block("shifts", _drawn(p, uri)) for p, uri in zip(changes.photos, _pictures(result, changes.photos))]
    blocks += [table.block for table in _tables(result)]
    if result.checks:
        blocks.append(Block("checks", {"checks": list(result.checks)}))
    return blocks


def _pictures(result: CalibrationResult, photos: tuple[PhotoShift, ...]) -> list[str]:
    """The photos as data URIs, empty for one that is no longer where it was."""
    from calibrant.reports.parts.pictures import data_uris

    files = [(p.id, Path(p.file)) for p in photos if p.file]
    mirrored = [name for name, _ in files] if result.options.get("mirror_x", False) else []
    found, _ = data_uris(files, budget=_PICTURES, mirrored=mirrored)
    return [found.get(p.id, "") for p in photos]


def _drawn(photo: PhotoShift, picture: str) -> dict[str, Any]:
    """Arrows from where points are to where they should be, in the photo's pixels."""
    found, expected = (np.array(v, dtype=np.float64).reshape(-1, 2) for v in (photo.found_px, photo.expected_px))
    step = expected - found
    width, height = photo.image_size
    unit = max(width, height) / 1000
    typical = float(np.median(np.linalg.norm(step, axis=1))) if len(step) else 0.0
    factor = next((k for k in _FACTORS if k * typical >= _SHOWN_PX * unit), _FACTORS[-1])
    arrows = [
        {"x1": float(a[0]), "y1": float(a[1]), "x2": float(a[0] + factor * d[0]), "y2": float(a[1] + factor * d[1])}
        for a, d in zip(found, step)
    ]
    mean = step.mean(axis=0) if len(step) else np.zeros(2)
    return {
        "name": photo.id,
        "picture": picture,
        "width": width,
        "height": height,
        "arrows": arrows,
        "factor": factor,
        "unit": unit,
        "sides": f"{abs(mean[0]):.1f} px {'right' if mean[0] > 0 else 'left'}, "
        f"{abs(mean[1]):.1f} px {'down' if mean[1] > 0 else 'up'}",
    }


KIND = Kind(
    "Is the calibration unchanged?",
    _headline,
    _answer,
    _facts,
    "photos",
    _tables,
    page=_page,
    terminal=_terminal,
    verdicts=VERDICTS,
)
