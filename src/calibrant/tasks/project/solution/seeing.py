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
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.patterns import PatternOptions
from calibrant.tasks.project.solution.handheld import mates_of
from calibrant.tasks.project.solution.recordings import pictures_of_bag
from calibrant.tasks.project.solution.sources import frame_place, from_folder, image_files, source_of, spec_of
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
        files = _files(folder, project, name)
        pose_files(folder, seen)
        records = records_of(folder, files)
    except InputError as error:
        raise InputError(f"observations {name}: {error}") from error
    asked: list[object] = [seen.mirror_x, bool(seen.captures), *_also_asked(folder, project, name)]
    if seen.captures:
        projector = project.components[seen.projector]
        asked += [projector.size, projector.code, projector.period_px, projector.shifts]
    names = [[Path(r["file"]).name, r["sha256"]] for r in records]
    key = hash_of([__version__, "seen", spec_of(folder, project, seen, hashed=True), asked, names])
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
    here = partial(from_folder, folder)
    views = tuple(replace(v, file=here(v.file)) for v in found.views)
    missed = tuple(replace(m, file=here(m.file)) for m in found.missed)
    found = replace(found, views=views, missed=missed)
    return CalibrationResult("observations", "ok", observations=found, inputs=what.records)


def records_of(folder: Path, files: Sequence[Path]) -> Records:
    """Names from the project's folder, and hashes. Raises: InputError for a file that is not there."""
    from calibrant.detection.images.files import frame_of
    from calibrant.formats.bags.kinds import is_bag

    sources = dict.fromkeys(place[0] if (place := frame_of(f)) else f for f in files)
    gone = [f for f in sources if not (f.is_file() or is_bag(f))]
    if gone:
        raise InputError(f"{'1 file is' if len(gone) == 1 else f'{len(gone)} files are'} gone: {gone[0]}")
    found = session.file_records(sources)
    return tuple({"file": from_folder(folder, r["file"]) or "", "sha256": r["sha256"]} for r in found)


def pose_files(folder: Path, seen: Seen) -> list[Path]:
    """The files of the robot's poses: those named, in a folder, or that a pattern matches. Raises: InputError."""
    from calibrant.formats.poses.read import files_of

    return files_of([folder / p for p in seen.poses]) if seen.poses else []


def hash_of(value: object) -> str:
    """A hash of plain values."""
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()


def _files(folder: Path, project: Project, name: str) -> list[Path]:
    seen = project.observations[name]
    if seen.points:
        return [folder / seen.points]
    if seen.captures:
        from calibrant.tasks.projector.calibrate import reads

        return reads(_captures(folder, project, seen))
    if seen.recording is not None:
        return [folder / seen.recording.bag]
    return source_of(folder, project, name).inputs(image_files(folder, project, name))


def _also_asked(folder: Path, project: Project, name: str) -> list[object]:
    """What pictures are chosen by, beside the files: of a bag its options, of a rig's videos the other videos."""
    seen = project.observations[name]
    if seen.recording is not None:
        others = [o.recording for n in mates_of(project, name) if (o := project.observations[n]).recording is not None]
        arm = robot_asked(folder, project.components[seen.robot]) if seen.robot else []
        return [arm, *([v for k, v in vars(r).items() if k != "bag"] for r in (seen.recording, *others))]
    if (
        seen.images
        and len(mates_of(project, name)) > 1
        and any(frame_place(f) for f in image_files(folder, project, name))
    ):
        return [[f.name for f in image_files(folder, project, name)]]
    return []


def robot_asked(folder: Path, robot: Component) -> list[object]:
    """What a robot's poses from joint values depend on; nothing where its poses are poses."""
    if not robot.chain:
        return []
    file = folder / robot.chain
    chain = records_of(folder, [file])[0]["sha256"] if file.is_file() else robot.chain
    return [chain, robot.chain_link, robot.chain_base, robot.joint_angle, list(robot.identify)]


def _look(folder: Path, project: Project, what: ToSee, listener: Listener) -> Observations:
    seen = what.seen
    if seen.captures:
        from calibrant.tasks.projector.calibrate import seen_of

        return seen_of(_captures(folder, project, seen), listener)
    source = replace(source_of(folder, project, what.name), listener=listener)
    if seen.recording is not None:
        return source.read(pictures_of_bag(folder, project, what.name, listener))
    found = source.read(image_files(folder, project, what.name) if seen.images else [])
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


def _captures(folder: Path, project: Project, seen: Seen) -> Captures:
    from calibrant.tasks.projector.calibrate import Request

    projector = project.components[seen.projector]
    size = "x".join(map(str, projector.size))
    return Request(
        captures=tuple(str(folder / c) for c in seen.captures),
        target=spec_of(folder, project, seen),
        patterns=PatternOptions(
            projector_size=size, code=projector.code, period=f"{projector.period_px}px", shifts=projector.shifts
        ),
        mirror_x=seen.mirror_x,
        exclude=seen.exclude,
    )
