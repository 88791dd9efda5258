"""The paper's experiment again: a cuboid's pose by colour and depth, in the camera and in the base."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from calibrant.errors import InputError
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.cell import CellOptions
from calibrant.tasks.options.option import Option
from calibrant.tasks.outcome import Answer, Document, Outcome

if TYPE_CHECKING:
    from collections.abc import Iterator

    from calibrant.studies.paper.tables import PaperTables

EXAMPLE = "cb.study_paper_tables(cell=True, seeds=1)"
MOST_READINGS = 1000


@dataclass(frozen=True, kw_only=True)
class Request:
    """The cuboid of 54x37x5 mm at A, B, C seen from P, then at A seen from P, Q, R: both tables, and what is true.

    calibrant study paper-tables
    calibrant study paper-tables --cell --seeds 20 --json
    calibrant study paper-tables --cell --seeds 5 --plot paper.png

    Without --cell: the paper's two tables and the distances that contradict each other. With it, in simulated cells
    whose wrist camera is calibrated from its own pictures and moved by the arm: both tables from means of six readings,
    the same distances, true errors, spread, and errors beside what was predicted for them.
    """

    cells: CellOptions = CellOptions()
    readings: Annotated[int, Option("N")] = 6
    """Pictures a position, of which the mean is taken."""
    plot: Annotated[Path | None, Option("FILE.png", output="file")] = None
    """Draw errors beside the predicted ones, and the distances."""


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """The study. Raises: InputError for numbers out of range; MissingExtraError without the extra sim."""
    from calibrant.studies.paper import page, tables

    _check(request)
    found = _read(request, listener) if request.cells.cell else tables.PaperTables()
    return Outcome(
        answer=Answer(found, partial(tables.tables_text, found)),
        documents=_plots(request, found),
        summary=partial(page.tables, found),
        page=partial(page.page, found),
    )


def _check(request: Request) -> None:
    request.cells.check()
    if request.cells.view != "wrist":
        raise InputError(f"--view {request.cells.view}: the study moves its camera from P to Q and R, which wrist can")
    if not 1 <= request.readings <= MOST_READINGS:
        raise InputError(f"--readings {request.readings}: 1 to {MOST_READINGS} pictures a position")
    if request.plot is not None and not request.cells.cell:
        raise InputError("--plot draws what simulated cells give: give --cell too")


def _read(request: Request, listener: Listener) -> PaperTables:
    from calibrant.studies.paper.tables import run_tables

    with listener.progress("Reading") as step:
        return run_tables(request.cells.runs, request.cells.opened, readings=request.readings, step=step)


def _plots(request: Request, found: PaperTables) -> Iterator[Document]:
    if request.plot is not None and found.poses:
        from calibrant.studies.paper.page import tables_png

        yield Document(request.plot, partial(tables_png, found))
