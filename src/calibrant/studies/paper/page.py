"""The paper's tables beside ours: for the terminal, a page and a picture."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Group, RenderableType
from rich.text import Text

from calibrant.reports.page import render
from calibrant.reports.parts.blocks import Block, Column, Page, TextTable
from calibrant.reports.terminal import text_table
from calibrant.studies.paper import published
from calibrant.studies.paper.run import PlacedPose
from calibrant.studies.paper.tables import PaperTables, as_printed, distances, verdict

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FRAMES = (("camera", published.CAMERA), ("base", published.BASE))
ANGLES = "Turns about x, y, z in this order; the paper names neither order nor axes."


@dataclass(frozen=True)
class RowMedians:
    """Medians over cells of one row in one frame (mm, deg), and how many of `count` are in their predicted 95 % region.

    spread: length of the readings' standard deviations.
    """

    spread_mm: float
    spread_deg: float
    error_mm: float
    predicted_95_mm: float
    error_deg: float
    predicted_95_deg: float
    inside: int
    count: int


def row_medians(poses: Sequence[PlacedPose]) -> RowMedians:
    """Of the poses of one row in one frame."""

    def median(pick: Callable[[PlacedPose], float]) -> float:
        return float(np.median([pick(p) for p in poses]))

    return RowMedians(
        median(lambda p: float(np.linalg.norm(p.spread_mm))),
        median(lambda p: float(np.linalg.norm(p.spread_deg))),
        median(lambda p: p.error_mm),
        median(lambda p: p.predicted_95_mm),
        median(lambda p: p.error_deg),
        median(lambda p: p.predicted_95_deg),
        sum(p.inside for p in poses),
        len(poses),
    )


def study_tables(found: PaperTables) -> list[TextTable]:
    """The paper's tables 1 and 2 beside the first cell's, errors of all cells, and the six distances."""
    out = [_as_in_the_paper(found, frame, table) for frame, table in FRAMES]
    if found.poses:
        out.append(_errors(found))
    out.append(_distances(found))
    return out


def tables(found: PaperTables) -> RenderableType:
    """For a terminal of 80 columns."""
    failed = [Text(f"seed {k}: {v}", style="red") for k, v in found.failures.items()]
    return Group(*map(text_table, study_tables(found)), *failed, Text(verdict(found), style="bold"))


def page(found: PaperTables) -> str:
    """One HTML page: tables and the picture."""
    from markupsafe import Markup

    blocks = [table.block for table in study_tables(found)]
    if found.poses:
        drawn = io.StringIO()
        _figure(found).savefig(drawn, format="svg")
        text = drawn.getvalue()
        curve = {"svg": Markup(text[text.index("<svg") :]), "caption": "A bar ends where 95 % of errors stay below."}
        blocks.append(Block("curves", {"heading": "Errors and distances", "curves": [curve]}))
    return render(Page("The paper's tables", "", "", verdict(found), (), blocks))


def tables_png(found: PaperTables) -> bytes:
    """The picture alone. Needs a cell that was read."""
    drawn = io.BytesIO()
    _figure(found).savefig(drawn, format="png", dpi=110)
    return drawn.getvalue()


def _as_in_the_paper(found: PaperTables, frame: str, table: published.Table) -> TextTable:
    names = ("x mm", "y mm", "z mm", "θ deg", "α deg", "β deg")
    rows: list[tuple[str, ...]] = []
    seed = found.done[0] if found.done else None
    for row in published.ROWS:
        rows.append((row, "paper", *(f"{v:.2f}" for v in table[row])))
        if seed is None:
            continue
        place, angles = as_printed(found.of(seed, frame, row))
        rows.append(("", "here", *(f"{v:.2f}" for v in (*place, *angles))))
    heading = f"The cuboid in the {frame} frame" + ("" if seed is None else f", seed {seed}")
    note = "" if seed is None else f"Means of {found.readings} readings. {ANGLES}"
    columns = (Column("row"), Column(""), *(Column(n, number=True) for n in names))
    return TextTable(heading, columns, tuple(rows), note)


def _errors(found: PaperTables) -> TextTable:
    names = ("spread mm", "spread deg", "error mm", "95 % mm", "error deg", "95 % deg", "inside")
    rows = []
    for frame, _ in FRAMES:
        for row in published.ROWS:
            m = row_medians(found.rows(frame, row))
            numbers = (m.spread_mm, m.spread_deg, m.error_mm, m.predicted_95_mm, m.error_deg, m.predicted_95_deg)
            rows.append((frame, row, *(f"{v:.3f}" for v in numbers), f"{m.inside}/{m.count}"))
    heading = f"Errors against the truth, medians of {len(found.done)} cell{'s' * (len(found.done) > 1)}"
    note = (
        f"spread: standard deviation of {found.readings} readings; 95 %: what is predicted for the error; inside: the "
        "truth in the predicted 95 % region. Turns modulo the cuboid's half turns."
    )
    columns = (Column("frame"), Column("row"), *(Column(n, number=True) for n in names))
    return TextTable(heading, columns, tuple(rows), note)


def _distances(found: PaperTables) -> TextTable:
    apart = distances(found)
    rows = []
    for pair in published.PAIRS:
        paper = [published.distance_mm(table, pair) for _, table in FRAMES]
        mine = [d for d in apart if d.pair == pair]
        here: list[str] = []
        if mine:
            of = (
                [d.camera for d in mine], [d.true_camera for d in mine], [d.base for d in mine],
                [d.true_base for d in mine], [abs(d.base - d.true_base) for d in mine],
            )  # fmt: skip
            here = [f"{np.median(values):.3f}" for values in of]
        rows.append((f"{pair[0]}-{pair[1]}", *(f"{v:.3f}" for v in paper), *here))
    names = ["paper, camera", "base"] + (["here, camera", "true", "base", "true", "off"] if apart else [])
    note = (
        "A camera that stands still sees the same distances as the base has (first three); in the base a cuboid that "
        "stands still is at distance 0 from itself (last three), and the camera's is how far the camera moved."
    )
    columns = (Column("pair"), *(Column(n, number=True) for n in names))
    heading = "Distances between positions, mm" + (", medians of the cells" if apart else "")
    return TextTable(heading, columns, tuple(rows), note)


def _figure(found: PaperTables) -> Figure:
    """Errors of every cell beside the predicted ones; distances in both frames, the paper's and ours."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 6.4), layout="constrained")
    grid = figure.subplots(2, 2)
    _draw_errors(grid[0][0], found, "mm")
    _draw_errors(grid[0][1], found, "deg")
    apart = distances(found)
    off = [
        (published.STILL_PAIRS, "fixed camera: camera less base, mm", lambda d: abs(d.camera - d.base),
         lambda p: abs(published.distance_mm(published.CAMERA, p) - published.distance_mm(published.BASE, p))),
        (published.SAME_PAIRS, "moved camera: still cuboid apart, mm", lambda d: d.base,
         lambda p: published.distance_mm(published.BASE, p)),
    ]  # fmt: skip
    for axes, (pairs, title, ours, theirs) in zip(grid[1], off):
        _draw_distances(
            axes, pairs, title, [[ours(d) for d in apart if d.pair == p] for p in pairs], map(theirs, pairs)
        )
    return figure


def _draw_errors(axes: Any, found: PaperTables, unit: str) -> None:
    for k, (frame, _) in enumerate(FRAMES):
        for i, row in enumerate(published.ROWS):
            poses = found.rows(frame, row)
            at = i + (k - 0.5) * 0.36
            errors = [p.error_mm if unit == "mm" else p.error_deg for p in poses]
            m = row_medians(poses)
            axes.bar(
                at, m.predicted_95_mm if unit == "mm" else m.predicted_95_deg, width=0.32, color=f"C{k}", alpha=0.25
            )
            label = f"in the {frame}" if i == 0 else None
            axes.plot(np.full(len(errors), at), errors, ".", color=f"C{k}", label=label, markersize=5)
    axes.set_xticks(range(len(published.ROWS)), published.ROWS)
    axes.set_ylabel(f"error, {unit}; bar: predicted 95 %")
    axes.set_ylim(0, 1.2 * axes.get_ylim()[1])
    axes.grid(axis="y", alpha=0.3)
    axes.legend(fontsize=8, loc="upper left", ncols=2)


def _draw_distances(axes: Any, pairs: Any, title: str, ours: Sequence[list[float]], theirs: Any) -> None:
    for i, (mine, paper) in enumerate(zip(ours, theirs)):
        axes.plot(i, max(paper, 1e-3), "kx", label="the paper" if i == 0 else None)
        axes.plot(np.full(len(mine), i), np.maximum(mine, 1e-3), ".", color="C1", label="here" if i == 0 else None)
    axes.set_xticks(range(len(pairs)), ["-".join(p) for p in pairs])
    axes.set_yscale("log")
    axes.set_ylim(7e-4, 20)
    axes.set_title(f"{title} (cut at 0.001)", fontsize=9)
    axes.grid(axis="y", alpha=0.3)
    axes.legend(fontsize=8, loc="lower left")
