"""Results of `calibrant compare`: how far two calibrations are apart, and whether their uncertainties explain it."""

from __future__ import annotations

from math import hypot, sqrt
from typing import TYPE_CHECKING

from calibrant.data import CalibrationResult
from calibrant.data.details import Comparison
from calibrant.data.details_comparison import CameraComparison, ParameterDifference, TransformComparison, Triple
from calibrant.reports.parts.blocks import Block, Column, TextTable
from calibrant.reports.parts.figures import Fact
from calibrant.reports.parts.kind import Kind
from calibrant.reports.parts.maps import ImageMap, maps_block
from calibrant.reports.parts.numbers import plain, with_sigma

if TYPE_CHECKING:
    from calibrant.diagnose.look import Look

_NOTHING = 1e-6
"""Pixels: what numbers in files are rounded to."""
_MOST_PARAMETERS = 24
"""A splined model has hundreds: those that differ most are listed."""


def _headline(result: CalibrationResult) -> list[Fact]:
    found = result.detail(Comparison)
    if found is None:
        return []
    facts = []
    for c in found.cameras:
        tail = f", {c.first}" if len(found.cameras) > 1 else ""
        facts.append(Fact(f"over the image{tail}", _px(c.rms_px), f"RMS, {_px(c.most_px)} at most"))
        facts.append(Fact(f"without the rotation{tail}", _px(c.rotated_rms_px), _after(c)))
        facts.append(Fact(f"implied rotation{tail}", f"{plain(_length(c.rotation_mrad), digits=3)} mrad", _axes(c)))
    for t in found.transforms:
        text = f"{plain(_length(t.mm), digits=3)} mm, {plain(_length(t.deg), digits=3)} deg"
        facts.append(Fact(f"{t.parent} → {t.child}", text, "apart"))
    return facts


def _px(value: float) -> str:
    return f"{plain(value if value > _NOTHING else 0.0, digits=3)} px"


def _length(value: Triple) -> float:
    return sqrt(sum(v * v for v in value))


def _after(c: CameraComparison) -> str:
    made = "" if c.expected_px is None else f"; the uncertainties make {_px(c.expected_px)}"
    return f"RMS, {_px(c.rotated_most_px)} at most{made}"


def _axes(c: CameraComparison) -> str:
    sigma = c.rotation_sigma_mrad or (None, None, None)
    return "x, y, z: " + ", ".join(with_sigma(v, s) for v, s in zip(c.rotation_mrad, sigma)) + " mrad"


def _answer(result: CalibrationResult) -> str:
    found = result.detail(Comparison)
    if found is None:
        return ""
    parts = [f"{_px(c.rotated_rms_px)} RMS apart over the image of {c.first}" for c in found.cameras]
    parts += [f"{t.parent} → {t.child} {plain(_length(t.mm), digits=3)} mm" for t in found.transforms]
    return f"{found.second} and {found.first}: {', '.join(parts)}."


def comparison_tables(found: Comparison) -> list[TextTable]:
    """Parameters and transforms beside each other, for a terminal and a page."""
    several = len(found.cameras) > 1
    tables = [_parameters(found, c, f" of {c.first}" if several else "") for c in found.cameras]
    if found.transforms:
        tables.append(_moved(found))
    rest = [(name, side) for name, side in ((found.first, found.only_first), (found.second, found.only_second)) if side]
    if rest:
        rows = tuple((name, ", ".join(side)) for name, side in rest)
        tables.append(TextTable("In one of them alone", (Column("file"), Column("what")), rows))
    return tables


def _parameters(found: Comparison, c: CameraComparison, tail: str) -> TextTable:
    columns = (
        Column("parameter"),
        Column(found.first, True),
        Column(found.second, True),
        Column("difference", True),
        Column("sigmas", True),
    )
    order = sorted(c.parameters, key=lambda p: -(p.sigmas or 0.0))[:_MOST_PARAMETERS]
    shown = [p for p in c.parameters if p in order] if len(c.parameters) > _MOST_PARAMETERS else c.parameters
    note = (
        f"The second less the first, pictures of {_size(c.first_size)} and {_size(c.second_size)} px; ± 1σ, both taken "
        "as independent."
    )
    if all(p.difference is None for p in c.parameters):
        note = f"Terms of a {c.first_model} and a {c.second_model} camera of these sizes do not mean the same: " + (
            "what they see is compared above."
        )
    if len(shown) < len(c.parameters):
        note += f" {len(c.parameters) - len(shown)} more, which differ less, are in the result file."
    return TextTable(f"Parameters{tail}", columns, tuple(_row(p) for p in shown), note)


def _size(size: tuple[int, int]) -> str:
    return f"{size[0]}x{size[1]}"


def _row(p: ParameterDifference) -> tuple[str, ...]:
    beside = (_beside(p.first, p.first_sigma), _beside(p.second, p.second_sigma))
    difference = "" if p.difference is None else with_sigma(p.difference, p.sigma)
    sigmas = "" if p.sigmas is None else plain(p.sigmas, digits=2)
    return (p.name if p.unit == "1" else f"{p.name} {p.unit}", *beside, difference, sigmas)


def _beside(value: float | None, sigma: float | None) -> str:
    return "–" if value is None else with_sigma(value, sigma)


def _moved(found: Comparison) -> TextTable:
    columns = (
        Column("transform"),
        Column("along"),
        Column("shift mm", True),
        Column("sigmas", True),
        Column("turn deg", True),
        Column("sigmas", True),
    )
    rows = tuple(row for t in found.transforms for row in _axes_of(t))
    note = f"Of {found.second} against {found.first}, along the axes of the first frame, ± 1σ of the difference."
    return TextTable("Transforms", columns, rows, note)


def _axes_of(t: TransformComparison) -> list[tuple[str, ...]]:
    none = (None, None, None)
    axes = zip("xyz", t.mm, t.mm_sigma or none, t.deg, t.deg_sigma or none)
    return [
        (
            f"{t.parent} → {t.child}" if axis == "x" else "",
            axis,
            with_sigma(mm, s),
            _sigmas(mm, s),
            with_sigma(deg, d),
            _sigmas(deg, d),
        )
        for axis, mm, s, deg, d in axes
    ]


def _sigmas(value: float, sigma: float | None) -> str:
    return plain(abs(value) / sigma, digits=2) if sigma else ""


def comparison_blocks(found: Comparison) -> list[Block]:
    """The maps of the differences."""
    if not found.cameras:
        return []
    words = (
        f"How far from a pixel of {found.first} the camera of {found.second} sees the same ray, after the rotation "
        "that both calibrations may differ by without seeing differently was removed."
    )
    maps = [m for c in found.cameras for m in _maps(c, several=len(found.cameras) > 1)]
    return [maps_block(f"Difference from {found.second} over the image", words, maps)]


def compared_blocks(result: CalibrationResult) -> list[Block]:
    """A comparison on the page of the first of the two."""
    found = result.detail(Comparison)
    if found is None:
        return []
    rows = tuple((fact.name, fact.text, fact.note) for fact in _headline(result))
    said = "; ".join(c.message for c in result.checks)
    table = TextTable(f"Compared with {found.second}", (Column(""), Column(""), Column("")), rows, f"{said}.")
    return [table.block, *(t.block for t in comparison_tables(found)), *comparison_blocks(found)]


def _maps(c: CameraComparison, *, several: bool) -> list[ImageMap]:
    tail = f", {c.first}" if several else ""
    arrows = [None if x is None or y is None else (x, y) for x, y in zip(c.map.du, c.map.dv)]
    sizes = [None if a is None else hypot(*a) for a in arrows]
    grid = (c.first_size, c.map.columns, c.map.rows)
    maps = [ImageMap(f"Difference{tail}", *grid, sizes, "px", arrows=arrows)]
    if any(s is not None for s in c.map.sigma):
        maps.append(ImageMap(f"1σ of it{tail}", *grid, c.map.sigma, "px", "By both uncertainties, worst axis."))
    return maps


def _facts(result: CalibrationResult) -> list[Fact]:
    return _headline(result)


def _tables(result: CalibrationResult) -> list[TextTable]:
    found = result.detail(Comparison)
    return [] if found is None else comparison_tables(found)


def _blocks(look: Look) -> list[Block]:
    found = look.result.detail(Comparison)
    return [] if found is None else comparison_blocks(found)


KIND = Kind(
    "Two calibrations compared",
    _headline,
    _answer,
    _facts,
    tables=_tables,
    blocks=_blocks,
    said=("lens-", "models-", "size-"),
    verdicts={"ok": "ALIKE", "warn": "DIFFERENT", "refused": "NOT COMPARED"},
)
