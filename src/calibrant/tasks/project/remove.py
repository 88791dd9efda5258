"""Remove a component or observations from a project."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Annotated

from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.option import Option
from calibrant.tasks.options.project import ProjectOptions, command_line
from calibrant.tasks.outcome import Outcome
from calibrant.tasks.project.shown import changed

EXAMPLE = 'cb.project_remove("table", project="cell")'


@dataclass(frozen=True, kw_only=True)
class Request:
    """Remove a component, or observations; what others need is not removed, and they are named.

    calibrant project remove table

    Photos, poses and other files that the project names stay where they are.
    """

    name: Annotated[str, Option("NAME", positional=True)]
    """The component, or the observations."""
    place: ProjectOptions = ProjectOptions()


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """The project without it. Raises: InputError for a name that is not there, or that others need."""
    from calibrant.formats.projects.edits import without
    from calibrant.formats.projects.folder import update

    made = update(
        request.place.project, partial(without, name=request.name), command=command_line("project remove", request)
    )
    return changed(made, f"Removed: {request.name}.")
