"""Make a project in a folder, empty or from another program's file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.option import Option
from calibrant.tasks.options.project import command_line
from calibrant.tasks.outcome import Outcome
from calibrant.tasks.project.shown import changed

if TYPE_CHECKING:
    from calibrant.data import CalibrationResult

EXAMPLE = 'cb.project_new("cell", from_="project.yml")'


@dataclass(frozen=True, kw_only=True)
class Request:
    """Make a project: a folder whose calibrant.yaml holds a cell's components, observations, options and results.

    calibrant project new cell
    calibrant project new cell --from project.yml --answer index=1

    --from takes what any program wrote that calibrant convert reads, a 3D-EasyCalib project among them, or a result.
    """

    folder: Annotated[Path, Option("DIR", positional=True)] = Path()
    """The folder, made where it is not there; this one unless given."""
    from_: Annotated[Path | None, Option("FILE")] = None
    """Begin with the cameras, lenses, frames and poses of this file."""
    read_as: Annotated[str | None, Option("FORMAT")] = None
    """The format of --from, where the content alone is not to decide."""
    image_size: Annotated[str | None, Option("WxH")] = None
    """Size of the images, e.g. 1280x960, where --from does not hold it."""
    answer: Annotated[tuple[str, ...], Option("NAME=VALUE...")] = ()
    """What the format of --from asks beside these, e.g. index=1; its message names them."""


def reads(request: Request) -> list[Path]:
    """The file to begin with."""
    return [] if request.from_ is None or request.from_.is_dir() else [request.from_]


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """The project. Raises: InputError where there is one already, and for a file that cannot be read."""
    from calibrant.formats.projects.folder import create
    from calibrant.formats.projects.imported import imported
    from calibrant.formats.projects.records import Project

    project = Project()
    results: dict[str, str] = {}
    if request.from_ is not None:
        project, results = imported(project, _read(request, request.from_), source=request.from_.name)
    made = create(request.folder, project, command=command_line("project new", request), results=results)
    there = f" with {', '.join(made.components)}" if made.components else ""
    return changed(made, f"A project in {request.folder.resolve()}{there}.")


def _read(request: Request, file: Path) -> CalibrationResult:
    from calibrant.formats.exchange.exchange_format import ReadOptions
    from calibrant.formats.exchange.read import read_any
    from calibrant.tasks.options.words import by_name
    from calibrant.tasks.pictures import size_of

    size = None if request.image_size is None else size_of(request.image_size)
    options = ReadOptions(image_size=size, answers=by_name("--answer", request.answer))
    return read_any(file, options, form=request.read_as)
