"""Results of `calibrant rectify`: pictures of two cameras that look the same way."""

from __future__ import annotations

from calibrant.data import CalibrationResult
from calibrant.data.details import RectifiedPair
from calibrant.reports.parts.figures import Fact
from calibrant.reports.parts.kind import Kind
from calibrant.reports.parts.numbers import plain


def _rows(result: CalibrationResult) -> list[Fact]:
    pair, error = result.detail(RectifiedPair), result.figures.get("row_error")
    if error is None or pair is None:
        return []
    line = "row" if pair.axis == "x" else "column"
    return [Fact(f"{line} error, RMS", f"{plain(error.value, digits=3)} px", "of corners that both cameras see")]


def _facts(result: CalibrationResult) -> list[Fact]:
    pair = result.detail(RectifiedPair)
    if pair is None:
        return _rows(result)
    (ax, ay), (bx, by) = pair.centres_px
    size = f"{pair.image_size[0]} × {pair.image_size[1]} px"
    return [
        *_rows(result),
        Fact("rectified pictures", f"{pair.projection}, {size}", f"baseline along {pair.axis}"),
        Fact("focal length", f"{plain(pair.focal_px, digits=6)} px", "of both"),
        Fact("principal points", f"({ax:.2f}, {ay:.2f}), ({bx:.2f}, {by:.2f}) px", "left, right"),
        Fact("baseline", f"{1e3 * abs(pair.baseline_m):.3f} mm", ""),
    ]


def _answer(result: CalibrationResult) -> str:
    facts = _rows(result)
    return f"Matches share a {facts[0].name.split()[0]} to {facts[0].text} (RMS)." if facts else ""


KIND = Kind("Rectified pictures", _facts, _answer, facts=_facts, said=("rows", "sides"))
