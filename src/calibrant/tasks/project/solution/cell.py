"""A part of a project as one problem: its observations under the names of its components, with the robots' poses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.project.solution.at_robot import list_request, of_robot, read_at_robot
from calibrant.tasks.project.solution.handheld import handheld_moments, own_target, rigid_groups
from calibrant.tasks.project.solution.recordings import posed_lists
from calibrant.tasks.project.solution.sources import from_here, source_of
from calibrant.tasks.project.solution.touches import touches_of
from calibrant.tasks.robots.hand_eye_pictures import ReadList, joints_of, moments_of, poses_of

if TYPE_CHECKING:
    from calibrant.calibrate.cell.problem.joint_offsets import JointReadings
    from calibrant.calibrate.cell.problem.layout import Pictures
    from calibrant.calibrate.cell.problem.touches import Touches
    from calibrant.cameras import Camera
    from calibrant.data import CalibrationResult, Check, Observations, RobotPoses
    from calibrant.formats.poses.read import RawPoses
    from calibrant.formats.projects.records import Project
    from calibrant.tasks.project.solution.parts import Part

V = TypeVar("V")
_OWN = ("camera", "projector")
"""What observations of a project call their cameras."""


@dataclass(frozen=True, eq=False)
class CellInput:
    """The arguments of `calibrate_cell` for a part of a project.

    read: by observations, those at a robot's poses, paired and examined; later: the same list at the offset of a bag's
    clocks that is larger by its sigma, and said: what the bag says of its moments.
    """

    robots: Mapping[str, RobotPoses]
    pictures: tuple[Pictures, ...]
    lenses: Lenses
    robot_accuracy: Mapping[str, str]
    read: Mapping[str, ReadList]
    rigid: tuple[tuple[str, ...], ...] = ()
    touches: tuple[Touches, ...] = ()
    joints: Mapping[str, JointReadings] | None = None
    identify: tuple[str, ...] = ()
    later: ReadList | None = None
    said: tuple[Check, ...] = ()


@dataclass(frozen=True, eq=False)
class Lenses:
    """held, initial: lenses that files give, to be held or to begin with; model and fix of the others: one for all, or
    by name."""

    held: Mapping[str, Camera]
    initial: Mapping[str, Camera]
    model: str | Mapping[str, str]
    fix: tuple[str, ...] | Mapping[str, tuple[str, ...]]

    def model_of(self, name: str) -> str:
        """The model of a camera."""
        return self.model if isinstance(self.model, str) else self.model[name]

    def fix_of(self, name: str) -> tuple[str, ...]:
        """What is held of a camera."""
        return self.fix if isinstance(self.fix, tuple) else self.fix[name]


def cell_input(
    folder: Path, project: Project, part: Part, seen: Mapping[str, Observations], listener: Listener = SILENT
) -> CellInput:
    """The problem of a part. seen: by the observations' name. Raises: InputError, RefusedError naming them."""
    lenses = lenses_of(folder, project, part, seen)
    read: dict[str, ReadList] = {}
    later: ReadList | None = None
    said: tuple[Check, ...] = ()
    for name in part.observations:
        if not project.observations[name].robot:
            continue
        recorded: RawPoses | None = None
        if project.observations[name].recording is not None:
            bag = posed_lists(folder, project, name, listener)
            recorded, said = bag.raw, (*said, *bag.checks)
            if bag.later is not None:
                later = _at_robot(folder, project, name, seen[name], lenses, bag.later, listener)
        read[name] = _at_robot(folder, project, name, seen[name], lenses, recorded, listener)
    moments = handheld_moments(project, part, seen)
    order = sorted(part.observations, key=lambda n: part.cameras.index(project.observations[n].camera))
    pictures = [p for name in order for p in _pictures(project, part, name, seen[name], read.get(name), moments)]
    robots = {robot: poses_of(of_robot(project, read, robot), robot) for robot in part.robots}
    joints = _joints(folder, project, part, read, robots)
    robots, touches = touches_of(folder, project, part, robots, read)
    return CellInput(
        robots,
        tuple(pictures),
        lenses,
        {n: c.accuracy for n in part.robots if (c := project.components[n]).accuracy},
        read,
        rigid_groups(project, part),
        touches,
        joints or None,
        tuple(dict.fromkeys(group for n in joints for group in project.components[n].identify)),
        later,
        said,
    )


def calibrated_cell(problem: CellInput) -> CalibrationResult:
    """The part's calibration by `calibrate_cell`. Raises: InputError; RefusedError with the result that failed."""
    from calibrant.calibrate.cell.calibrate import calibrate_cell

    lenses = problem.lenses
    return calibrate_cell(
        problem.robots,
        list(problem.pictures),
        cameras=lenses.held,
        initial=lenses.initial,
        model=lenses.model,
        fix=lenses.fix,
        robot_accuracy=problem.robot_accuracy,
        rigid=problem.rigid,
        touches=problem.touches,
        joints=problem.joints,
        identify=problem.identify or ("offsets",),
    )


def lenses_of(folder: Path, project: Project, part: Part, seen: Mapping[str, Observations]) -> Lenses:
    """What is known and asked of the part's lenses."""
    from calibrant.formats.projects.lenses import lens_in_file

    told: dict[str, Camera] = {}
    for name in part.observations:
        s = project.observations[name]
        for component, own in ((s.camera, _OWN[0]), (s.projector, _OWN[1])):
            if component and component not in told and project.components[component].file:
                size = seen[name].image_sizes[own]
                told[component] = lens_in_file(folder, component, project.components[component], size)
    optics = [*part.cameras, *part.projectors]
    held = {n: lens for n, lens in told.items() if not project.components[n].start}
    return Lenses(
        held,
        {n: lens for n, lens in told.items() if n not in held},
        _one_or_each({n: project.components[n].model or project.options.model for n in optics}),
        _one_or_each({n: project.components[n].fix or project.options.fix for n in optics}),
    )


def _at_robot(
    folder: Path,
    project: Project,
    name: str,
    found: Observations,
    lenses: Lenses,
    recorded: RawPoses | None,
    listener: Listener,
) -> ReadList:
    """Observations paired with the robot's poses, and examined as `hand-eye` does."""
    seen = project.observations[name]
    mine = from_here(folder, found.of_camera(_OWN[0]))
    request = replace(
        list_request(folder, project, seen, listener),
        found=mine,
        known=lenses.held.get(seen.camera),
        recorded=recorded,
    )
    source = source_of(folder, project, name)
    if seen.images:
        request = replace(request, images=source.images, target=source.target, search=source.search)
    return read_at_robot(request, name, seen.camera)


def _joints(
    folder: Path, project: Project, part: Part, read: Mapping[str, ReadList], robots: Mapping[str, RobotPoses]
) -> dict[str, JointReadings]:
    """What the joints of robots read whose errors are asked for. Raises: InputError for poses without joint values."""
    out: dict[str, JointReadings] = {}
    for robot in part.robots:
        if not project.components[robot].identify:
            continue
        lists = of_robot(project, read, robot)
        seen = next(s for n in part.observations if (s := project.observations[n]).robot == robot)
        out[robot] = joints_of(lists, robot, robots[robot], list_request(folder, project, seen, SILENT))
    return out


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
        target = own_target(project, part, name)
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


def _one_or_each(values: Mapping[str, V]) -> V | Mapping[str, V]:
    """One value where all have it."""
    each = list(values.values())
    return each[0] if all(v == each[0] for v in each) else dict(values)
