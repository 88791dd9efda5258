"""A part of a project solved as the command for it does: `intrinsics` for a camera alone, `rig` for cameras of a rig,
`hand-eye` for a camera at a robot, and the whole cell where several of these are tied together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from calibrant.errors import InputError
from calibrant.tasks.cameras.rig_pictures import RigPictures
from calibrant.tasks.cameras.rig_solving import RigAsked, Sizes, require_times, solved_rig
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.images import CornerOptions, RigSearchOptions
from calibrant.tasks.project.solution.cell import CellInput, calibrated_cell, cell_input, lenses_of
from calibrant.tasks.project.solution.handheld import group_of, refuse_twice, rigid_groups
from calibrant.tasks.project.solution.recordings import together
from calibrant.tasks.project.solution.sources import from_here, images_by_camera, source_of
from calibrant.tasks.robots.hand_eye_alone import calibrated_alone
from calibrant.tasks.robots.hand_eye_bag import with_offset_error

if TYPE_CHECKING:
    from calibrant.data import CalibrationResult, Observations
    from calibrant.formats.projects.records import Project
    from calibrant.tasks.project.solution.cell import Lenses
    from calibrant.tasks.project.solution.parts import Part
    from calibrant.tasks.robots.hand_eye_pictures import ReadList


def solved_part(
    folder: Path, project: Project, part: Part, seen: Mapping[str, Observations], listener: Listener = SILENT
) -> CalibrationResult:
    """The calibration of a part. seen: by the observations' name. Raises: InputError, RefusedError as the commands."""
    handheld = all(project.observations[n].setup == "handheld" for n in part.observations)
    alone = handheld and not part.robots and not part.projectors
    if alone and len(part.cameras) == 1 and not rigid_groups(project, part):
        return _lens(folder, project, part, seen, listener)
    if alone and _of_a_rig(project, part):
        return _rig(folder, project, part, seen, listener)
    _refuse_clocks(project, part)
    problem = cell_input(folder, project, part, seen, listener)
    with listener.status(f"Calibrating {part.words} …"):
        one = _only_list(problem)
        result = calibrated_cell(problem) if one is None else _hand_eye(project, part, problem, one)
    named = {f"pose_reading {name}": r.notation for name, r in problem.read.items()}
    single = len(problem.read) == 1 and len(problem.pictures) == 1
    checks = (*(c for r in problem.read.values() for c in r.checks(result.checks, alone=single)), *problem.said)
    return replace(result, checks=(*checks, *result.checks), decided={**result.decided, **named})


def _only_list(problem: CellInput) -> ReadList | None:
    """The list of pictures that is the whole problem, at one robot, as `hand-eye` has it; None where there is more."""
    more = problem.touches or problem.joints or problem.rigid or problem.lenses.initial
    lists = list(problem.read.values())
    return lists[0] if len(lists) == len(problem.pictures) == 1 and not more else None


def _hand_eye(project: Project, part: Part, problem: CellInput, one: ReadList) -> CalibrationResult:
    """One camera at one robot, under the names of its components."""
    from calibrant.calibrate.cell.problem.layout import ONLY_ROBOT, TARGET
    from calibrant.data import DEFAULT_CAMERA
    from calibrant.data.renamed import with_names

    name, accuracy = part.cameras[0], next(iter(problem.robot_accuracy.values()), None)
    lens = {"model": problem.lenses.model_of(name), "fix": problem.lenses.fix_of(name)}
    found = calibrated_alone(one, accuracy=accuracy, **lens)  # type: ignore[arg-type]
    if problem.later is not None:
        later = calibrated_alone(problem.later, accuracy=accuracy, **lens)  # type: ignore[arg-type]
        found = with_offset_error(found, later)
    target = part.targets[0] if part.targets else TARGET
    return with_names(found, {DEFAULT_CAMERA: name, TARGET: target, ONLY_ROBOT: part.robots[0]})


def _of_a_rig(project: Project, part: Part) -> bool:
    """Whether all was taken at once, with images at hand: then it is what `rig` calibrates."""
    lists = [project.observations[n] for n in part.observations]
    return len({group_of(project, n) for n in part.observations}) == 1 and all(s.images or s.recording for s in lists)


def _rig(
    folder: Path, project: Project, part: Part, seen: Mapping[str, Observations], listener: Listener
) -> CalibrationResult:
    refuse_twice(project, part.observations)
    rig = project.components.get(project.rig_of(part.cameras[0]))
    offsets, readout = (rig.time_offsets, rig.readout) if rig is not None else (False, False)
    pictures = _rig_pictures(folder, project, part, seen, listener)
    words = [f"rig {project.rig_of(part.cameras[0])}: the cameras' clocks"] if offsets or readout else []
    cure = "videos, images with time stamps in their names, a table (--times FILE), or numbered images and --fps RATE"
    require_times(pictures, words, cure)
    lenses = lenses_of(folder, project, part, seen)

    def asked(sizes: Sizes) -> RigAsked:
        rigid = rigid_groups(project, part)
        return RigAsked(
            lenses.held, lenses.initial, lenses.model, lenses.fix, None, time_offsets=offsets, readout=readout,
            rigid=rigid,
        )  # fmt: skip

    return solved_rig(pictures, asked, listener)


def _rig_pictures(
    folder: Path, project: Project, part: Part, seen: Mapping[str, Observations], listener: Listener
) -> RigPictures:
    """The images of the part's cameras as `rig` has them, with what was found in them."""
    lists = {name: project.observations[name] for name in part.observations}
    rig = project.components.get(project.rig_of(part.cameras[0]))
    by_camera, recorded = images_by_camera(folder, project, part.observations), None
    if any(s.recording is not None for s in lists.values()):
        taken = together(folder, project, part.observations)
        by_camera, recorded = dict(taken.files), taken.times
    specs: dict[str, dict[str, str]] = {camera: {} for camera in part.cameras}
    known: dict[str, dict[str, Observations]] = {}
    for name in sorted(lists, key=lambda n: part.cameras.index(lists[n].camera)):
        camera, target = lists[name].camera, lists[name].target
        specs[camera][target] = source_of(folder, project, name).target or ""
        known.setdefault(target, {})[camera] = from_here(folder, seen[name])
    mirrored = tuple(dict.fromkeys(s.camera for s in lists.values() if s.mirror_x))
    return RigPictures(
        images={camera: by_camera[camera] for camera in part.cameras},
        specs=specs,
        observations=None,
        rule="auto" if recorded is None else "time",
        fps=rig.fps or None if rig is not None else None,
        table=folder / rig.times if rig is not None and rig.times else None,
        search=RigSearchOptions(mirror=mirrored, exclude=_excluded(part, lists)),
        corners=CornerOptions(),
        listener=listener,
        recorded=recorded,
        known=known,
    )


def _excluded(part: Part, lists: Mapping[str, object]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(x for s in lists.values() for x in s.exclude))  # type: ignore[attr-defined]


def _refuse_clocks(project: Project, part: Part) -> None:
    """Raises: InputError where clocks are asked for that this problem does not find."""
    for rig in dict.fromkeys(project.rig_of(c) for c in part.cameras):
        if rig and (project.components[rig].time_offsets or project.components[rig].readout):
            raise InputError(
                f"rig {rig}: the clocks of its cameras are found from images that they took at once, by themselves; "
                f"here they are in one problem with {part.words}. Calibrate the rig in a project of its own first"
            )


def _lens(
    folder: Path, project: Project, part: Part, seen: Mapping[str, Observations], listener: Listener
) -> CalibrationResult:
    """One camera before targets that somebody moves: as `intrinsics`, with its second look."""
    name, lenses = part.cameras[0], lenses_of(folder, project, part, seen)
    if name in lenses.held:
        raise InputError(
            f"the lens of {name} is given and held, and nothing else is to be found from its pictures; to calibrate it "
            "from there, set it to start there (calibrant project add camera … --start)"
        )
    lists = {n: from_here(folder, seen[n]) for n in part.observations}
    with listener.status(f"Calibrating {part.words} …"):
        result = _of_lens(list(lists.values()), name, lenses)
    sources = {n: replace(source_of(folder, project, n), listener=listener) for n in lists}
    more = {n: sources[n].look_again(found, result.cameras[name]) for n, found in lists.items()}
    if all(more[n] is lists[n] for n in lists):
        return result
    with listener.status(f"Calibrating {part.words} …"):
        return _of_lens(list(more.values()), name, lenses)


def _of_lens(lists: Sequence[Observations], name: str, lenses: Lenses) -> CalibrationResult:
    from calibrant.calibrate.intrinsics.calibrate import calibrate_intrinsics
    from calibrant.data import DEFAULT_CAMERA
    from calibrant.data.renamed import with_names

    found = calibrate_intrinsics(
        lists[0] if len(lists) == 1 else _apart(lists),
        model=lenses.model_of(name),
        fix=lenses.fix_of(name),
        initial=lenses.initial.get(name),
    )
    return with_names(found, {DEFAULT_CAMERA: name})


def _apart(lists: Sequence[Observations]) -> Observations:
    """Several lists of one camera, views of one name told apart by their list's number."""
    return replace(
        lists[0],
        views=tuple(replace(v, id=f"{k} {v.id}", moment="") for k, seen in enumerate(lists, 1) for v in seen.views),
        missed=tuple(replace(m, id=f"{k} {m.id}") for k, seen in enumerate(lists, 1) for m in seen.missed),
        target=lists[0].target if len({seen.target for seen in lists}) == 1 else None,
    )
