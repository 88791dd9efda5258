"""Rename a component or observations of a project, in its results too."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated

from calibrant.errors import InputError
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.option import Option
from calibrant.tasks.options.project import ProjectOptions, command_line
from calibrant.tasks.outcome import Outcome
from calibrant.tasks.project.shown import changed

if TYPE_CHECKING:
    from calibrant.formats.projects.folder import Held
    from calibrant.formats.projects.records import Kept

EXAMPLE = 'cb.project_rename("camera", "wrist", project="cell")'


@dataclass(frozen=True, kw_only=True)
class Request:
    """Give a component, or observations, another name, wherever it stands. Nothing becomes stale by it.

    calibrant project rename camera wrist
    """

    name: Annotated[str, Option("NAME", positional=True)]
    """What it is called."""
    to: Annotated[str, Option("NEW", positional=True)]
    """What it shall be called."""
    place: ProjectOptions = ProjectOptions()


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """The project with it. Raises: InputError for a name that is not there, or one that is taken."""
    from calibrant.formats.projects.edits import renamed
    from calibrant.formats.projects.folder import writing

    with writing(request.place.project) as held:
        after = renamed(held.project, request.name, request.to)
        texts: dict[str, str] = {}
        if request.name in held.project.components:
            again = [_again(held, kept, request) for kept in after.results]
            texts = dict(pair for _, pair in again if pair is not None)
            moved = {old.file: new.file for old, (new, _) in zip(after.results, again)}
            components = {
                n: replace(
                    c, file=moved.get(c.file, c.file), name_in_file=_in_file(c.name_in_file, request, c.file in moved)
                )
                for n, c in after.components.items()
            }
            after = replace(after, results=tuple(new for new, _ in again), components=components)
        made = held.write(after, command=command_line("project rename", request), results=texts)
    return changed(made, f"{request.name} is called {request.to} now.")


def _in_file(name: str, request: Request, of_project: bool) -> str:
    """What a lens is called in its file: a file of the project's own is written again, others stay as they are."""
    return request.to if of_project and name == request.name else name


def _again(held: Held, kept: Kept, request: Request) -> tuple[Kept, tuple[str, str] | None]:
    """A result under the new name, and its file's text; itself where its file is gone or does not name it."""
    from calibrant.data.renamed import with_names
    from calibrant.formats.projects.edits import names_in_result
    from calibrant.formats.projects.folder import kept_result, read_kept

    if kept.of == "seen":  # they know no names of the project
        return kept, None
    try:
        result = read_kept(held.folder, kept)
    except InputError:
        return kept, None
    named = with_names(result, names_in_result(kept, request.name, request.to))
    robots = tuple(request.to if r == request.name else r for r in kept.robots)
    new, text = kept_result(named, of=kept.of, name=kept.name, key=kept.key, robots=robots)
    return replace(new, made=kept.made), (new.file, text)
