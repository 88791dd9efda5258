"""A part of a project as one problem: its observations under the names of its components, with the robots' poses."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from calibrant.errors import CalibrantError, InputError
from calibrant.tasks.inputs.image_moments import images_by_moment, matched_images
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.cameras import LensOptions
from calibrant.tasks.options.poses import PoseOptions
from calibrant.tasks.options.robots import RobotOptions
from calibrant.tasks.robots import hand_eye_list
from calibrant.tasks.robots.hand_eye_list import ListRequest, PairedData
from calibrant.tasks.robots.hand_eye_pictures import ReadList, moments_of, poses_of, require_sound

if TYPE_CHECKING:
    from calibrant.calibrate.cell.problem.layout import Pictures
    from calibrant.cameras import Camera
    from calibrant.data import CalibrationResult, Missed, Observations, RobotPoses, View
    from calibrant.formats.projects.records import Project, Seen
    from calibrant.tasks.project.parts import Part

V = TypeVar("V")
_OWN = ("camera", "projector")
"""What observations of a project call their cameras."""


@dataclass(frozen=True, eq=False)
class CellInput:
    """The arguments of `calibrate_cell` for a part of a project.

    decided: how the poses of each list were read, in words.
    """

    robots: Mapping[str, RobotPoses]
    pictures: tuple[Pictures, ...]
    cameras: Mapping[str, Camera]
    initial: Mapping[str, Camera]
    model: str | Mapping[str, str]
    fix: tuple[str, ...] | Mapping[str, tuple[str, ...]]
    robot_accuracy: Mapping[str, str]
    decided: Mapping[str, str]


def cell_input(
    folder: Path, project: Project, part: Part, seen: Mapping[str, Observations], listener: Listener = SILENT
) -> CellInput:
    """The problem of a part. seen: by the observations' name. Raises: InputError, RefusedError naming them."""
    lenses = _lenses(folder, project, part, seen)
    held = {n: lens for n, lens in lenses.items() if not project.components[n].start}
    read: dict[str, ReadList] = {}
    for name in part.observations:
        if project.observations[name].robot:
            read[name] = _at_robot(folder, project, name, seen[name], held, listener)
    moments = _handheld_moments(folder, project, part, seen)
    order = sorted(part.observations, key=lambda n: part.cameras.index(project.observations[n].camera))
    pictures = [p for name in order for p in _pictures(project, part, name, seen[name], read.get(name), moments)]
    optics = [*part.cameras, *part.projectors]
    return CellInput(
        {robot: poses_of(_of_robot(project, read, robot), robot) for robot in part.robots},
        tuple(pictures),
        held,
        {n: lens for n, lens in lenses.items() if n not in held},
        _one_or_each({n: project.components[n].model or project.options.model for n in optics}),
        _one_or_each({n: project.components[n].fix or project.options.fix for n in optics}),
        {n: c.accuracy for n in part.robots if (c := project.components[n]).accuracy},
        {f"pose_reading {name}": r.notation for name, r in read.items()},
    )


def calibrated(problem: CellInput) -> CalibrationResult:
    """The part's calibration: `calibrate_cell`, or for one camera that handheld boards alone tell, its lens.

    Raises: InputError; RefusedError with the result that failed its checks.
    """
    names = dict.fromkeys(p.camera for p in problem.pictures)
    if len(names) == 1 and not problem.robots and all(p.handheld for p in problem.pictures):
        return _lens_alone(problem, next(iter(names)))
    from calibrant.calibrate.cell.calibrate import calibrate_cell

    result = calibrate_cell(
        problem.robots,
        list(problem.pictures),
        cameras=problem.cameras,
        initial=problem.initial,
        model=problem.model,
        fix=problem.fix,
        robot_accuracy=problem.robot_accuracy,
    )
    return replace(result, decided={**result.decided, **problem.decided})


def _lens_alone(problem: CellInput, name: str) -> CalibrationResult:
    from calibrant.calibrate.intrinsics.calibrate import calibrate_intrinsics
    from calibrant.data import DEFAULT_CAMERA
    from calibrant.data.renamed import with_names

    if name in problem.cameras:
        raise InputError(
            f"the lens of {name} is given and held, and nothing else is to be found from its pictures; to calibrate it "
            "from there, set it to start there (calibrant project add camera … --start)"
        )
    lists = [p.seen for p in problem.pictures if p.seen is not None]
    seen = lists[0] if len(lists) == 1 else _apart(lists)
    seen = replace(
        seen,
        views=tuple(replace(v, camera=DEFAULT_CAMERA) for v in seen.views),
        missed=tuple(replace(m, camera=DEFAULT_CAMERA) for m in seen.missed),
        image_sizes={DEFAULT_CAMERA: next(iter(seen.image_sizes.values()))},
    )
    model = problem.model if isinstance(problem.model, str) else problem.model[name]
    fix = problem.fix if isinstance(problem.fix, tuple) else problem.fix[name]
    found = calibrate_intrinsics(seen, model=model, fix=fix, initial=problem.initial.get(name))
    return with_names(found, {DEFAULT_CAMERA: name})


def _apart(lists: list[Observations]) -> Observations:
    """Several lists of one camera, views of one name told apart by their list's number."""
    return replace(
        lists[0],
        views=tuple(replace(v, id=f"{k} {v.id}", moment="") for k, seen in enumerate(lists, 1) for v in seen.views),
        missed=tuple(replace(m, id=f"{k} {m.id}") for k, seen in enumerate(lists, 1) for m in seen.missed),
        target=lists[0].target if len({seen.target for seen in lists}) == 1 else None,
    )


def _lenses(folder: Path, project: Project, part: Part, seen: Mapping[str, Observations]) -> dict[str, Camera]:
    """The lenses that files give, by component."""
    from calibrant.formats.projects.lenses import lens_in_file

    out: dict[str, Camera] = {}
    for name in part.observations:
        s = project.observations[name]
        for component, own in ((s.camera, _OWN[0]), (s.projector, _OWN[1])):
            if component and component not in out and project.components[component].file:
                size = seen[name].image_sizes[own]
                out[component] = lens_in_file(folder, component, project.components[component], size)
    return out


def _at_robot(
    folder: Path,
    project: Project,
    name: str,
    found: Observations,
    lenses: Mapping[str, Camera],
    listener: Listener,
) -> ReadList:
    """Observations paired with the robot's poses, and examined as `hand-eye` does."""
    seen = project.observations[name]
    request = _list_request(folder, project, seen, listener)
    try:
        data = _paired(request, found.of_camera(_OWN[0]), lenses.get(seen.camera))
        with listener.status(f"Examining the data of {name} …"):
            diagnosis = hand_eye_list.diagnose(data, request)
        require_sound(diagnosis)
    except CalibrantError as error:
        error.args = (f"observations {name}: {error}",)
        raise
    return ReadList.examined(name, seen.camera, None, data, diagnosis, moments_of(data))


def _list_request(folder: Path, project: Project, seen: Seen, listener: Listener) -> ListRequest:
    """The options of `hand-eye` for these observations."""
    component, said = project.components[seen.camera], seen.notation
    return ListRequest(
        poses=tuple(str(folder / p) for p in seen.poses),
        setup=seen.setup,
        form=PoseOptions(
            pose_units=said.units, pose_rotation=said.rotation, pose_angle=said.angle, pose_direction=said.direction
        ),
        arm=RobotOptions(robot_format=said.maker or None),
        lens=LensOptions(model=component.model or project.options.model, fix=component.fix or project.options.fix),
        listener=listener,
    )


def _paired(request: ListRequest, mine: Observations, lens: Camera | None) -> PairedData:
    """Views and poses that belong together, by name or by order. Raises: InputError."""
    from calibrant.formats.poses.pairing import match_raw
    from calibrant.formats.poses.read import every_notation

    raw = request.form.read(request.poses, request.arm)
    every: list[View | Missed] = [*mine.views, *mine.missed]
    ids = [v.id for v in every]
    pairing = match_raw(raw, ids)
    mine = replace(mine, views=tuple(replace(v, moment=v.id) for v in mine.views))
    names = [ids[v] for v in pairing.view_index]
    complete = tuple(r.take(pairing.pose_index, names) for r in every_notation(raw))
    index = tuple(pairing.pose_index)
    return PairedData(complete, pairing.message, request.poses, mine, lens, raw=raw, pose_index=index)


def _of_robot(project: Project, read: Mapping[str, ReadList], robot: str) -> list[ReadList]:
    return [r for name, r in read.items() if project.observations[name].robot == robot]


def _pictures(
    project: Project,
    part: Part,
    name: str,
    found: Observations,
    read: ReadList | None,
    handheld: Mapping[str, Mapping[str, str]],
) -> list[Pictures]:
    """The lists of a camera, and of the projector whose light it saw."""
    from calibrant.calibrate.cell.problem.layout import ONLY_ROBOT, Pictures

    seen = project.observations[name]
    setup, target = seen.setup, seen.target or "target"
    if read is not None and read.data is not None and read.diagnosis is not None:
        setup, moments = read.diagnosis.poses.setup, moments_of(read.data)
    else:
        moments = dict(handheld.get(name, {}))
        target = _own_target(project, part, name)
    out = []
    for component, own in ((seen.camera, _OWN[0]), (seen.projector, _OWN[1])):
        if not component:
            continue
        mine = _called(found.of_camera(own), own, component, seen.camera)
        views = tuple(replace(v, moment=moments.get(v.id, v.id)) for v in mine.views if read is None or v.id in moments)
        robot = seen.robot if read is not None else next(iter(part.robots), ONLY_ROBOT)
        if setup == "handheld":
            robot = ""
        out.append(Pictures(component, setup, replace(mine, views=views), robot, target))
    return out


def _called(found: Observations, own: str, component: str, camera: str) -> Observations:
    """One camera's views under its component's name; those of a projector are carried from a camera."""
    carried = [None if v.carried is None else replace(v.carried, camera=camera) for v in found.views]
    return replace(
        found,
        views=tuple(replace(v, camera=component, carried=c) for v, c in zip(found.views, carried)),
        missed=tuple(replace(m, camera=component) for m in found.missed),
        image_sizes={component: found.image_sizes[own]},
    )


def _own_target(project: Project, part: Part, name: str) -> str:
    """What a target is called where somebody moves it: cameras of a rig see the same, others see it at other times, and
    then it is another thing for the problem."""
    seen = project.observations[name]
    if seen.setup != "handheld":
        return seen.target or "target"
    group = _group(project, name)
    others = {
        _group(project, n)
        for n in part.observations
        if project.observations[n].setup == "handheld" and project.observations[n].target == seen.target
    }
    target = seen.target or "target"
    return target if others == {group} else f"{target} of {group}"


def _group(project: Project, name: str) -> str:
    """Whose pictures were taken at once: a rig's, or of one list alone."""
    seen = project.observations[name]
    return name if seen.captures else project.rig_of(seen.camera) or name


def _handheld_moments(
    folder: Path, project: Project, part: Part, seen: Mapping[str, Observations]
) -> dict[str, dict[str, str]]:
    """By observations, the moment of every view of a target that somebody moves, by its id."""
    groups: dict[tuple[str, str], list[str]] = {}
    for name in part.observations:
        s = project.observations[name]
        if s.setup == "handheld":
            groups.setdefault((_group(project, name), s.target), []).append(name)
    out: dict[str, dict[str, str]] = {}
    for names in groups.values():
        if len(names) == 1 or any(project.observations[n].points for n in names):
            out |= {n: {v.id: v.moment for v in seen[n].views} for n in names}
            continue
        twice = Counter(project.observations[n].camera for n in names).most_common(1)[0]
        if twice[1] > 1:
            raise InputError(
                f"observations {', '.join(names)}: camera {twice[0]} has two lists of the same handheld target in one "
                "rig; put them into one (calibrant project add images NAME --more)"
            )
        out |= _at_once({name: seen[name] for name in names})
    return out


def _at_once(seen: Mapping[str, Observations]) -> dict[str, dict[str, str]]:
    """The moments of the images of several cameras, matched by their names."""
    from calibrant.detection.images.files import natural_key

    files: dict[str, list[Path]] = {}
    for name, found in seen.items():
        every: list[View | Missed] = [*found.views, *found.missed]
        files[name] = sorted((Path(v.file or v.id) for v in every), key=natural_key)
    keep = {file.name: True for listed in files.values() for file in listed}
    by_file = images_by_moment(files, matched_images(files), keep)
    return {name: {v.id: by_file[name][Path(v.file or v.id)] for v in found.views} for name, found in seen.items()}


def _one_or_each(values: Mapping[str, V]) -> V | Mapping[str, V]:
    """One value where all have it."""
    each = list(values.values())
    return each[0] if all(v == each[0] for v in each) else dict(values)
