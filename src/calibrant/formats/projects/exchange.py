"""A calibrant project, read as cameras and where they are: what `convert` writes into another program's file.

Every camera whose lens is known and every component that a chain of poses joins to the project's world are in it, the
latter as T_world_component.
"""

from __future__ import annotations

from calibrant.data import CalibrationResult
from calibrant.data.results import as_transform
from calibrant.errors import InputError
from calibrant.formats.documents.document import Document
from calibrant.formats.exchange.exchange_format import ExchangeFormat, ReadOptions, read_cameras
from calibrant.formats.projects.folder import PROJECT_FILE, folder_of, placing_results, read_project
from calibrant.formats.projects.frames import ITSELF, Scene, frame_named, world_of
from calibrant.formats.projects.lenses import known_lenses
from calibrant.formats.projects.records import Project
from calibrant.formats.projects.text import is_project
from calibrant.reading.notes import note


def _matches(document: Document) -> bool:
    return PROJECT_FILE in document.names if document.is_folder else is_project(document.mapping)


def _read(document: Document, options: ReadOptions) -> CalibrationResult:
    if not document.is_folder and document.path.name != PROJECT_FILE:
        raise InputError(f"a project's file is called {PROJECT_FILE}, and its results lie in the folder beside it")
    folder = folder_of(document.path)
    return as_cameras(read_project(folder), folder=str(folder))


def as_cameras(project: Project, *, folder: str) -> CalibrationResult:
    """What a project knows of lenses and places, as a result of kind "cameras"; its first transforms' parent is the
    world. Raises: InputError where nothing is known."""
    place = folder_of(folder)
    results = placing_results(place, project)
    lenses = known_lenses(place, project, results)
    world = world_of(project)
    scene = Scene.of(project, results)
    found = [p for p in scene.places(world) if p.T is not None and p.relative_to == world and p.source != ITSELF]
    left = [p.name for p in scene.places(world) if p.T is None or p.relative_to != world]
    if left:
        note(f"{place}: where {', '.join(left)} are in {world} is not known; of these no place is written")
    if not lenses and not found:
        raise InputError(
            "nothing is known of this project yet: no lens and no pose; calibrant project solve finds them"
        )
    transforms = [
        as_transform(world, frame_named(project, p.name), p.T, p.covariance) for p in found if p.T is not None
    ]
    return read_cameras(lenses, transforms=tuple(transforms), created=project.created)


FORMAT = ExchangeFormat(
    name="project",
    title="calibrant project (a folder with calibrant.yaml)",
    suffix="",
    matches=_matches,
    read=_read,
)
