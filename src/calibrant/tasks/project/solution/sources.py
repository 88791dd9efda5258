"""What a project's observations are found in: images by camera, the board's spec, files as the project calls them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from calibrant.tasks.inputs import session
from calibrant.tasks.inputs.sources import Source, kept
from calibrant.tasks.options.images import SearchOptions
from calibrant.tasks.project.solution.handheld import mates_of

if TYPE_CHECKING:
    from calibrant.data import Observations
    from calibrant.formats.projects.records import Component, Project, Seen


def target_spec(folder: Path, component: Component) -> str:
    """A target's spec, its file where it is one as it is called from here."""
    head, colon, file = component.spec.partition(":")
    if colon and head == "points" and (folder / file).is_file():
        return f"{head}:{folder / file}"
    return str(folder / component.spec) if (folder / component.spec).is_file() else component.spec


def spec_of(folder: Path, project: Project, seen: Seen, *, hashed: bool = False) -> str:
    """The spec of the target that was seen, empty for none; hashed: of a file its checksum."""
    if not seen.target:
        return ""
    spec = target_spec(folder, project.components[seen.target])
    file = Path(spec.removeprefix("points:"))
    if hashed and file.is_file():
        return session.file_records([file])[0]["sha256"]
    return spec


def source_of(folder: Path, project: Project, name: str) -> Source:
    """How the images or the points of observations are read."""
    seen = project.observations[name]
    others = [project.observations[n] for n in mates_of(project, name) if n != name]
    beside = {spec_of(folder, project, o) for o in others if o.camera == seen.camera and o.images}
    return Source(
        images=tuple(str(folder / i) for i in seen.images),
        target=spec_of(folder, project, seen) if not seen.points else None,
        observations=folder / seen.points if seen.points else None,
        search=SearchOptions(mirror_x=seen.mirror_x, exclude=seen.exclude),
        beside=tuple(sorted(beside - {spec_of(folder, project, seen)})),
    )


def frame_place(file: Path) -> bool:
    """Whether a file is a frame of a recording."""
    from calibrant.detection.images.files import frame_of

    return frame_of(file) is not None


def image_files(folder: Path, project: Project, name: str) -> list[Path]:
    """The images that observations are found in; of the videos of a rig the frames of the same numbers, as `rig` takes
    them. Raises: InputError."""
    source = source_of(folder, project, name)
    mates = [n for n in mates_of(project, name) if project.observations[n].images]
    files = source.files()
    if len(mates) < 2 or not all(map(frame_place, files)):
        return files
    from calibrant.detection.images.files import expand_together

    lists = images_by_camera(folder, project, mates)
    together = dict(zip(lists, expand_together(list(lists.values()))))[project.observations[name].camera]
    names = [f.name for f in together]
    return [f for f, k in zip(together, kept(names, source.exclude, what="image")) if k]


def images_by_camera(folder: Path, project: Project, names: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """All images of the cameras of some observations, as they are named."""
    out: dict[str, tuple[str, ...]] = {}
    for name in names:
        seen = project.observations[name]
        mine = [*out.get(seen.camera, ()), *(str(folder / i) for i in seen.images)]
        out[seen.camera] = tuple(dict.fromkeys(mine))
    return out


def from_folder(folder: Path, file: str | None) -> str | None:
    """A file as the project's folder calls it."""
    from calibrant.formats.projects.folder import inside

    return None if file is None else inside(folder, file)


def from_here(folder: Path, found: Observations) -> Observations:
    """The observations with their files as they are called from here."""
    views = tuple(v if v.file is None else replace(v, file=str(folder / v.file)) for v in found.views)
    missed = tuple(m if m.file is None else replace(m, file=str(folder / m.file)) for m in found.missed)
    return replace(found, views=views, missed=missed)
