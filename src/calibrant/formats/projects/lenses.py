"""The lenses that a project knows: found by its results, or read from the files that its components name."""

from __future__ import annotations

from pathlib import Path

from calibrant.cameras import Camera
from calibrant.errors import InputError
from calibrant.formats.projects.folder import outside
from calibrant.formats.projects.frames import Results
from calibrant.formats.projects.records import Component, Project

Size = tuple[int, int]


def known_lenses(folder: Path, project: Project, results: Results) -> dict[str, Camera]:
    """By name, the lens of every camera and projector that has one: of the last result, else of its file.

    Raises: InputError for a file that cannot be read.
    """
    out: dict[str, Camera] = {}
    for name, c in project.components.items():
        if c.kind not in ("camera", "projector"):
            continue
        solved = [result.cameras[name] for kept, result in results if kept.of == "cell" and name in result.cameras]
        if solved:
            out[name] = solved[-1]
        elif c.file:
            out[name] = lens_in_file(folder, name, c)
    return out


def lens_in_file(folder: Path, name: str, component: Component, image_size: Size | None = None) -> Camera:
    """The lens that a component's file holds. Raises: InputError naming the component, and what the file lacks."""
    from calibrant.formats.cameras.read import read_camera

    try:
        return read_camera(outside(folder, component.file), image_size=image_size, name=component.name_in_file or name)
    except InputError as error:
        raise InputError(f"{component.kind} {name}: {error}") from error
