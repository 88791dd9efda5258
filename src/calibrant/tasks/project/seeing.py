"""What a project's cameras saw: files found and hashed, boards looked for, as results of kind "observations"."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from calibrant.errors import InputError
from calibrant.tasks.inputs import session
from calibrant.tasks.inputs.sources import Source
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.images import SearchOptions
from calibrant.tasks.options.patterns import PatternOptions
from calibrant.version import __version__

if TYPE_CHECKING:
    from calibrant.data import CalibrationResult, Observations
    from calibrant.formats.projects.records import Component, Project, Seen
    from calibrant.tasks.projector.calibrate import Request as Captures

PROJECTOR = "projector"
Records = tuple[Mapping[str, str], ...]
"""Files by name, from the project's folder, and their sha256."""


@dataclass(frozen=True, eq=False)
class ToSee:
    """Observations to be made: the files that they are made from, and a hash of all that they depend on."""

    name: str
    seen: Seen
    files: tuple[Path, ...]
    records: Records
    key: str


def to_see(folder: Path, project: Project, name: str) -> ToSee:
    """What the observations of that name are made from. Raises: InputError naming them, where their files are gone."""
    seen = project.observations[name]
    try:
        files = _files(folder, project, seen)
        pose_files(folder, seen)
        records = records_of(folder, files)
    except InputError as error:
        raise InputError(f"observations {name}: {error}") from error
    asked: list[object] = [seen.mirror_x, bool(seen.captures)]
    if seen.captures:
        projector = project.components[seen.projector]
        asked += [projector.size, projector.code, projector.period_px, projector.shifts]
    names = [[Path(r["file"]).name, r["sha256"]] for r in records]
    key = hash_of([__version__, "seen", _spec(folder, project, seen, hashed=True), asked, names])
    return ToSee(name, seen, tuple(files), records, key)


def seen_now(folder: Path, project: Project, what: ToSee, listener: Listener = SILENT) -> CalibrationResult:
    """The observations, found. Cameras in it are called "camera" and "projector", whatever the project calls them.

    Raises: InputError, DetectionError, RefusedError naming the observations.
    """
    from calibrant.data import CalibrationResult
    from calibrant.errors import CalibrantError

    try:
        found = _look(folder, project, what, listener)
    except CalibrantError as error:
        error.args = (f"observations {what.name}: {error}",)
        raise
    here = partial(_from_folder, folder)
    views = tuple(replace(v, file=here(v.file)) for v in found.views)
    missed = tuple(replace(m, file=here(m.file)) for m in found.missed)
    found = replace(found, views=views, missed=missed)
    return CalibrationResult("observations", "ok", observations=found, inputs=what.records)


def records_of(folder: Path, files: Sequence[Path]) -> Records:
    """Names from the project's folder, and hashes. Raises: InputError for a file that is not there."""
    from calibrant.detection.images.files import frame_of

    sources = dict.fromkeys(place[0] if (place := frame_of(f)) else f for f in files)
    gone = [f for f in sources if not f.is_file()]
    if gone:
        raise InputError(f"{'1 file is' if len(gone) == 1 else f'{len(gone)} files are'} gone: {gone[0]}")
    found = session.file_records(sources)
    return tuple({"file": _from_folder(folder, r["file"]) or "", "sha256": r["sha256"]} for r in found)


def pose_files(folder: Path, seen: Seen) -> list[Path]:
    """The files of the robot's poses: those named, in a folder, or that a pattern matches. Raises: InputError."""
    from calibrant.formats.poses.read import files_of

    return files_of([folder / p for p in seen.poses]) if seen.poses else []


def hash_of(value: object) -> str:
    """A hash of plain values."""
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()


def target_spec(folder: Path, component: Component) -> str:
    """A target's spec, its file where it is one as it is called from here."""
    head, colon, file = component.spec.partition(":")
    if colon and head == "points" and (folder / file).is_file():
        return f"{head}:{folder / file}"
    return str(folder / component.spec) if (folder / component.spec).is_file() else component.spec


def _spec(folder: Path, project: Project, seen: Seen, *, hashed: bool = False) -> str:
    if not seen.target:
        return ""
    spec = target_spec(folder, project.components[seen.target])
    file = Path(spec.removeprefix("points:"))
    if hashed and file.is_file():
        return session.file_records([file])[0]["sha256"]
    return spec


def _files(folder: Path, project: Project, seen: Seen) -> list[Path]:
    if seen.points:
        return [folder / seen.points]
    if seen.captures:
        from calibrant.tasks.projector.calibrate import reads

        return reads(_captures(folder, project, seen))
    source = _source(folder, project, seen, SILENT)
    return source.inputs(source.files())


def _look(folder: Path, project: Project, what: ToSee, listener: Listener) -> Observations:
    seen = what.seen
    if seen.captures:
        from calibrant.tasks.projector.calibrate import seen_of

        return seen_of(_captures(folder, project, seen), listener)
    source = _source(folder, project, seen, listener)
    found = source.read(source.files())
    expected = 2 if seen.projector else 1
    if len(found.image_sizes) != expected:
        raise InputError(
            f"{seen.points} holds points of {', '.join(found.image_sizes)}; expected those of one camera"
            + (" and its projector" if seen.projector else "")
        )
    return _called_as_here(found, seen)


def _called_as_here(found: Observations, seen: Seen) -> Observations:
    """The views under the names that all observations of projects have."""
    from calibrant.data import DEFAULT_CAMERA, CalibrationResult
    from calibrant.data.renamed import with_names

    lit = {v.camera for v in found.views if v.carried is not None}
    if bool(seen.projector) != (len(lit) == 1):
        raise InputError(f"{seen.points} {'holds no' if seen.projector else 'holds a'} projector's points (`carried`)")
    names = {name: PROJECTOR if name in lit else DEFAULT_CAMERA for name in found.image_sizes}
    renamed = with_names(CalibrationResult("observations", "ok", observations=found), names).observations
    return found if renamed is None else renamed


def _source(folder: Path, project: Project, seen: Seen, listener: Listener) -> Source:
    return Source(
        images=tuple(str(folder / i) for i in seen.images),
        target=_spec(folder, project, seen) if seen.images else None,
        observations=folder / seen.points if seen.points else None,
        search=SearchOptions(mirror_x=seen.mirror_x, exclude=seen.exclude),
        listener=listener,
    )


def _captures(folder: Path, project: Project, seen: Seen) -> Captures:
    from calibrant.tasks.projector.calibrate import Request

    projector = project.components[seen.projector]
    size = "x".join(map(str, projector.size))
    return Request(
        captures=tuple(str(folder / c) for c in seen.captures),
        target=_spec(folder, project, seen),
        patterns=PatternOptions(
            projector_size=size, code=projector.code, period=f"{projector.period_px}px", shifts=projector.shifts
        ),
        mirror_x=seen.mirror_x,
        exclude=seen.exclude,
    )


def _from_folder(folder: Path, file: str | None) -> str | None:
    from calibrant.formats.projects.folder import inside

    return None if file is None else inside(folder, file)
