"""List a project: its components, and where each is in the frame of any other."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Annotated

from calibrant.errors import InputError
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.option import Option
from calibrant.tasks.options.project import ProjectOptions
from calibrant.tasks.outcome import Answer, Outcome
from calibrant.tasks.project.shown import lens_lines, lines, places_as_json, places_table, project_json

if TYPE_CHECKING:
    from rich.console import RenderableType

    from calibrant.cameras import Camera
    from calibrant.formats.projects.frames import Place
    from calibrant.formats.projects.records import Project

EXAMPLE = 'cb.project_list(project="cell", relative_to="board")'


@dataclass(frozen=True, eq=False)
class Listed:
    """A project, what is known of its lenses, and where its components are."""

    project: Project
    lenses: dict[str, Camera]
    places: tuple[Place, ...]
    troubles: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Request:
    """Where every component is, in mm and yaw, pitch, roll (z-y'-x'') in degrees, and what is known of lenses.

    calibrant project list
    calibrant project list --relative-to board

    Poses that were typed in are marked so and have no sigma. What nothing fixes to the frame asked for, such as a
    camera on a robot's gripper in the robot's base, is shown in what it is fixed to.
    """

    place: ProjectOptions = ProjectOptions()
    relative_to: Annotated[str | None, Option("NAME")] = None
    """The component in whose frame all is shown; the project's world unless given."""


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """The list. Raises: InputError for a component that is not there."""
    from calibrant.formats.projects.folder import folder_of, read_project

    folder = folder_of(request.place.project)
    found = listed(folder, read_project(folder), request.relative_to or "")
    return Outcome(answer=Answer(found, partial(_text, found)), summary=partial(_shown, found), warnings=found.troubles)


def listed(folder: object, project: Project, relative_to: str = "") -> Listed:
    """What is known of a project in a folder; a result that cannot be read is a trouble, and what it knows is left out.

    Raises: InputError for a component that is not there.
    """
    from calibrant.formats.projects.folder import folder_of, read_kept
    from calibrant.formats.projects.frames import Scene, frame_named
    from calibrant.formats.projects.lenses import known_lenses

    here = folder_of(str(folder))
    if relative_to:
        frame_named(project, relative_to)
    results, troubles = [], []
    for kept in project.results:
        if kept.of == "seen":
            continue
        try:
            results.append((kept, read_kept(here, kept)))
        except InputError as error:
            troubles.append(str(error))
    lenses: dict[str, Camera] = {}
    try:
        lenses = known_lenses(here, project, results)
    except InputError as error:
        troubles.append(str(error))
    return Listed(project, lenses, Scene.of(project, results).places(relative_to), tuple(troubles))


def _text(found: Listed) -> str:
    lenses = {
        n: {"model": c.model.name, "image_size": list(c.image_size), **c.parameters} for n, c in found.lenses.items()
    }
    whole = {**json.loads(project_json(found.project)), "lenses": lenses, "places": places_as_json(found.places)}
    return json.dumps(whole, ensure_ascii=False, indent=1)


def _shown(found: Listed) -> tuple[RenderableType, ...]:
    seen = [_seen_line(name, found.project) for name in found.project.observations]
    seen += [
        f"touches {name}: {t.tool} of {t.robot} on {t.target or 'a point'}: {', '.join(t.poses)}"
        for name, t in found.project.touches.items()
    ]
    none = "No components yet: calibrant project add camera NAME …"
    return (
        places_table(found.places) if found.places else lines(none),
        lines("", *lens_lines(found.lenses)) if found.lenses else lines(),
        lines("", *seen) if seen else lines(),
    )


def _seen_line(name: str, project: Project) -> str:
    s = project.observations[name]
    bag = () if s.recording is None else (f"{s.recording.bag}{f' {t}' if (t := s.recording.topic) else ''}",)
    what = ", ".join((*s.images, *s.captures, *bag, *((s.points,) if s.points else ())))
    with_ = f" at poses of {s.robot}" if s.robot else ""
    light = f" in the light of {s.projector}" if s.projector else ""
    return f"observations {name}: {s.camera} saw {s.target or 'points'}{light}, {s.setup}{with_}: {what}"
