"""Set where a component is, in which frame it is shown, or which component is the world."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Annotated

import numpy as np

from calibrant.errors import InputError
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.option import Option
from calibrant.tasks.options.project import ProjectOptions, command_line
from calibrant.tasks.outcome import Answer, Outcome
from calibrant.tasks.project.list import listed
from calibrant.tasks.project.shown import places_table, project_json

if TYPE_CHECKING:
    from pathlib import Path

    from calibrant.formats.projects.records import Placement, Project

EXAMPLE = 'cb.project_set("top", project="cell", relative_to="base", xyz="0mm,0mm,900mm", ypr="0deg,0deg,180deg")'


@dataclass(frozen=True, kw_only=True)
class Request:
    """Type in where a component is, show it in another frame, or make it the world.

    calibrant project set top --relative-to base --xyz 0mm,-20mm,900mm --ypr 0deg,0deg,180deg
    calibrant project set top --relative-to board
    calibrant project set left --world

    A pose that is typed in is marked so, has no sigma, and holds until solve finds the component, or --forget. Without
    --xyz and --ypr the component stays where it is, and is shown in the other frame from now on.
    """

    name: Annotated[str, Option("NAME", positional=True)]
    """The component."""
    place: ProjectOptions = ProjectOptions()
    relative_to: Annotated[str | None, Option("NAME")] = None
    """The component in whose frame the pose is; base and gripper are those of the only robot."""
    xyz: Annotated[str | None, Option("X,Y,Z")] = None
    """Its origin there, with units: 10mm,-0.2m,900mm."""
    ypr: Annotated[str | None, Option("YAW,PITCH,ROLL")] = None
    """Yaw, pitch, roll (z-y'-x'') with units: 90deg,0deg,180deg. Without it: not turned."""
    forget: bool = False
    """Forget the pose that was typed in: where the results have it again."""
    world: bool = False
    """Make it the world: all others are shown in its frame."""


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """The project with it. Raises: InputError for components that are not there, values without units, poses that turn
    in a circle."""
    from calibrant.formats.projects.folder import folder_of, update

    asked = [request.xyz is not None or request.relative_to is not None, request.forget, request.world]
    if sum(asked) != 1 or (request.ypr is not None and request.xyz is None):
        raise InputError(
            "say one thing: --relative-to NAME with --xyz X,Y,Z (and --ypr), --relative-to NAME alone, --forget or "
            "--world"
        )
    if request.xyz is not None and request.relative_to is None:
        raise InputError("--xyz is a place in some frame: name it with --relative-to")
    folder = folder_of(request.place.project)
    made = update(folder, partial(_edited, folder, request), command=command_line("project set", request))
    found = listed(folder, made)
    mine = found.places if request.world else tuple(p for p in found.places if p.name == request.name)
    return Outcome(
        answer=Answer(made, partial(project_json, made)), summary=partial(places_table, mine), warnings=found.troubles
    )


def _edited(folder: Path, request: Request, project: Project) -> Project:
    from calibrant.formats.projects.edits import placed, shown_in, with_world

    if request.world:
        return with_world(project, request.name)
    if request.forget:
        return placed(project, request.name, None)
    frame = request.relative_to or ""
    if request.xyz is not None:
        return shown_in(placed(project, request.name, _typed(request)), request.name, frame)
    moved = _same_place(folder, project, request.name, frame)
    return shown_in(project if moved is None else placed(project, request.name, moved), request.name, frame)


def _typed(request: Request) -> Placement:
    from calibrant.diagnose.budget.volume import parse_coordinate
    from calibrant.formats.projects.records import TYPED, Placement
    from calibrant.tasks.inputs.placement import parse_angle

    xyz, ypr = ((t or "0deg,0deg,0deg").split(",") for t in (request.xyz, request.ypr))
    for option, parts in (("--xyz", xyz), ("--ypr", ypr)):
        if len(parts) != 3:
            raise InputError(f"{option} takes three values with commas between, got {len(parts)}")
    return Placement(
        relative_to=request.relative_to or "",
        xyz_mm=tuple(_rounded(1e3 * parse_coordinate(p, what="--xyz")) for p in xyz),
        ypr_deg=tuple(_rounded(float(np.rad2deg(parse_angle(p, what="--ypr")))) for p in ypr),
        source=TYPED,
    )


def _rounded(value: float) -> float:
    """Without what metres and radians on the way leave behind the fifteenth digit: what was typed is kept."""
    return float(f"{value:.14g}")


def _same_place(folder: Path, project: Project, name: str, frame: str) -> Placement | None:
    """A pose that was given, in another frame; None for a component whose place is the results'.

    Raises: InputError where nothing leads to that frame.
    """
    from calibrant.formats.projects.folder import placing_results
    from calibrant.formats.projects.frames import Scene, frame_named

    if project.component(name).pose is None:
        return None
    at = Scene.of(project, placing_results(folder, project)).place(name, frame)
    if at.T is None or at.relative_to != frame_named(project, frame):
        raise InputError(f"nothing leads from {name} to {frame}: its pose there has to be typed in (--xyz, --ypr)")
    pose = project.component(name).pose
    if pose is None:
        return None
    return replace(
        pose,
        relative_to=frame,
        xyz_mm=tuple((1e3 * at.T[:3, 3]).tolist()),
        ypr_deg=(),
        rotation=tuple(at.T[:3, :3].ravel().tolist()),
    )
