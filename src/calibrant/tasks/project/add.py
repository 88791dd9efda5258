"""Add a component to a project, or observations: who saw what, from which robot's poses."""

from __future__ import annotations

from dataclasses import MISSING, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from calibrant.errors import InputError
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.fields import spread
from calibrant.tasks.options.option import Option
from calibrant.tasks.options.project import ProjectOptions, command_line
from calibrant.tasks.options.words import pixels, split_names
from calibrant.tasks.outcome import Outcome
from calibrant.tasks.project.add_options import COMPONENTS, KINDS, OPTIONS, ComponentOptions, SeenOptions
from calibrant.tasks.project.shown import changed

if TYPE_CHECKING:
    from calibrant.formats.projects.records import Component, Notation, Project, Recording, Seen, Touched

EXAMPLE = 'cb.project_add("camera", "left", project="cell", model="brown")'


@dataclass(frozen=True, kw_only=True)
class Request:
    """Add a component (camera, rig, projector, robot, tool, target, body, frame) or observations (images, bag,
    captures, points, touches).

    calibrant project add robot ur --accuracy 0.1mm
    calibrant project add target board --spec chessboard:9x6:25mm
    calibrant project add camera wrist --model brown
    calibrant project add images hand --camera wrist --target board --images photos --robot ur --poses poses.csv

    Files stay where they are: the project keeps where, from its own folder.
    """

    kind: Annotated[str, Option("KIND", positional=True, choices=KINDS)]
    """camera, rig, projector, robot, tool, target, body or frame; images, bag, captures, points or touches."""
    name: Annotated[str, Option("NAME", positional=True)]
    """What it is called in the project."""
    place: ProjectOptions = ProjectOptions()
    component: ComponentOptions = ComponentOptions()
    seen: SeenOptions = SeenOptions()


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """The project with it. Raises: InputError for a name that is taken or none, options of another kind, components
    and files that are not there."""
    from calibrant.formats.projects.checks import check_name
    from calibrant.formats.projects.edits import with_component, with_more_seen, with_seen, with_touches
    from calibrant.formats.projects.folder import folder_of, update
    from calibrant.tasks.project.solution.seeing import to_see

    _check_options(request)
    folder = folder_of(request.place.project)

    def edited(project: Project) -> Project:
        if request.kind in COMPONENTS:
            return with_component(project, request.name, _component(folder, request))
        if request.kind == "touches":
            return with_touches(project, request.name, _touched(folder, request, project))
        seen = _seen(folder, request, project)
        out = (with_more_seen if request.seen.more else with_seen)(project, request.name, seen)
        to_see(folder, out, check_name(request.name))  # files that are not there are said now
        return out

    made = update(folder, edited, command=command_line("project add", request))
    return changed(made, f"{'More' if request.seen.more else 'Added'}: {request.kind} {request.name}.")


def _check_options(request: Request) -> None:
    """Raises: InputError for a kind that there is not, and for options that it does not have."""
    if request.kind not in KINDS:
        raise InputError(f"no kind is called {request.kind!r}; choose {', '.join(KINDS)}")
    said = {f.name: f for group in (request.component, request.seen) for f in spread(type(group))}
    values = {**_values(request.component), **_values(request.seen)}
    for name, value in values.items():
        if value != said[name].default and said[name].default is not MISSING and name not in OPTIONS[request.kind]:
            allowed = ", ".join(sorted(said[n].flag for n in OPTIONS[request.kind])) or "no options"
            raise InputError(f"{said[name].flag} is nothing that a {request.kind} has; it takes {allowed}")


def _values(group: object) -> dict[str, object]:
    """The values of a group of options, those of the groups in it among them."""
    out: dict[str, object] = {}
    for name, value in vars(group).items():
        out |= _values(value) if hasattr(value, "__dataclass_fields__") else {name: value}
    return out


def _component(folder: Path, request: Request) -> Component:
    from calibrant.formats.projects.folder import inside
    from calibrant.formats.projects.records import Component

    said, kind = request.component, request.kind
    if said.start and said.file is None:
        raise InputError("--start begins with the lens of a file: name it with --file")
    if kind == "robot":
        return _robot(folder, said)
    if kind == "rig":
        return Component(
            kind=kind, cameras=split_names(said.cameras), time_offsets=said.time_offsets, readout=said.readout,
            fps=said.fps or 0.0, times="" if said.times is None else inside(folder, said.times),
        )  # fmt: skip
    if kind == "body":
        return Component(kind=kind, targets=split_names(said.targets))
    if kind == "target":
        return Component(kind=kind, spec=_spec(folder, said.spec))
    if kind not in ("camera", "projector"):
        return Component(kind=kind, robot=request.seen.robot)
    file, name = _file(folder, request)
    lens = Component(
        kind=kind, model=_model(said.model), fix=split_names(said.fix), start=said.start, file=file, name_in_file=name
    )
    if kind == "camera":
        return lens
    period = int(pixels(said.patterns.period, option="--period") or 0)
    return replace(
        lens, camera=request.seen.camera, size=said.patterns.sequence().projector_size, code=said.patterns.code,
        period_px=period, shifts=said.patterns.shifts,
    )  # fmt: skip


def _robot(folder: Path, said: ComponentOptions) -> Component:
    """Raises: InputError for an accuracy that is none, a chain that is none, errors of joints that there are not."""
    from calibrant.calibrate.cell.certainty.accuracy import robot_accuracy
    from calibrant.calibrate.cell.problem.joint_offsets import KINDS as GROUPS
    from calibrant.formats.projects.folder import inside
    from calibrant.formats.projects.records import Component
    from calibrant.tasks.options.robots import RobotOptions

    identify = split_names(said.identify)
    wrong = next((g for g in identify if g not in GROUPS), None)
    if wrong is not None:
        raise InputError(f"--identify {wrong}: choose {', '.join(GROUPS)}")
    link, base = said.chain_link or None, said.chain_base or None
    if said.chain:
        RobotOptions(robot=said.chain, robot_link=link, robot_base=base, joint_angle=said.joint_angle).chain()
    return Component(
        kind="robot",
        accuracy=robot_accuracy(said.accuracy).text if said.accuracy else "",
        chain=inside(folder, said.chain) if Path(said.chain).is_file() else said.chain,
        chain_link=said.chain_link,
        chain_base=said.chain_base,
        joint_angle=said.joint_angle,
        identify=identify,
    )


def _model(name: str) -> str:
    """Raises: InputError for a model that there is not."""
    from calibrant.cameras import MODELS as KNOWN

    if name and name.partition(":")[0] not in (*KNOWN, "splined"):
        raise InputError(f"no camera model is called {name!r}; models: {', '.join(KNOWN)}")
    return name


def _file(folder: Path, request: Request) -> tuple[str, str]:
    """The file of a lens, and what it is called there. Raises: InputError for one that is not in it."""
    from calibrant.formats.exchange.exchange_format import ReadOptions
    from calibrant.formats.exchange.read import read_any
    from calibrant.formats.projects.folder import inside

    file = request.component.file
    if file is None:
        return "", ""
    cameras = read_any(file, ReadOptions(places=False)).cameras
    if len(cameras) != 1 and request.name not in cameras:
        raise InputError(
            f"{file} holds the cameras {', '.join(cameras) or 'none'}, none of them {request.name!r}; call the "
            "component as the file does, and rename it after"
        )
    name = request.name if request.name in cameras else next(iter(cameras))
    return inside(folder, file), name


def _spec(folder: Path, spec: str) -> str:
    """A target's spec; of a file where it is, from the project's folder. Raises: InputError for what is no target."""
    from calibrant.formats.projects.folder import inside
    from calibrant.targets.registry import parse_target

    if not spec:
        raise InputError("a target needs its --spec, such as chessboard:9x6:25mm, or a file")
    parse_target(spec)
    file = spec.removeprefix("points:")
    if not Path(file).is_file():
        return spec
    return f"points:{inside(folder, file)}" if spec != file else inside(folder, file)


def _touched(folder: Path, request: Request, project: Project) -> Touched:
    """Raises: InputError for a tool, a robot or poses that are not named, and corners that are no numbers."""
    from calibrant.formats.poses.read import files_of
    from calibrant.formats.projects.folder import inside
    from calibrant.formats.projects.records import Touched

    s = request.seen
    for option, kind, name in (("--tool", "tool", s.tool), ("--robot", "robot", s.robot)):
        if not name:
            raise InputError(f"touches need their {option}, by its name in the project")
        project.component(name, kind=kind)
    corners = split_names(s.corners)
    if not all(c.isdecimal() for c in corners):
        raise InputError(f"--corners are numbers of the target's points, from 0: 0,8,45,53; got {', '.join(corners)}")
    files_of([Path(p) for p in s.poses])
    return Touched(
        tool=s.tool, robot=s.robot, target=s.target, corners=tuple(map(int, corners)), notation=_notation(s),
        poses=tuple(inside(folder, p) for p in s.poses),
    )  # fmt: skip


def _recording(folder: Path, s: SeenOptions) -> Recording | None:
    """The bag, and what of it is meant. Raises: InputError for options that contradict each other, and what is no
    bag."""
    from calibrant.formats.bags.kinds import check_bag
    from calibrant.formats.projects.folder import inside
    from calibrant.formats.projects.records import Recording
    from calibrant.tasks.inputs.bags.motion import robot_motion
    from calibrant.tasks.inputs.bags.topics import check_topics
    from calibrant.tasks.options.robots import RobotOptions

    said = s.recording
    said.check()
    if said.bag is None:
        return None
    check_bag(said.bag.expanduser())
    topics = [t for given in said.image_topic for t in (given.partition("=")[2] or given,)]
    if len(topics) > 1:
        raise InputError("observations are of one camera: give one --image-topic, and the others as theirs")
    if not s.robot and (said.tf or said.joint_topic or said.moments != "still" or said.clock_offset):
        raise InputError(
            "--tf, --joint-topic, --moments and --clock-offset are about a robot's poses: give the --robot"
        )
    check_topics(said)
    if said.tf:
        robot_motion(said, RobotOptions())
    return Recording(
        bag=inside(folder, said.bag), topic=topics[0] if topics else "", stamps=said.stamps, tf=said.tf or "",
        joint_topic=said.joint_topic or "", moments=said.moments, clock_offset=said.clock_offset or "",
    )  # fmt: skip


def _notation(s: SeenOptions) -> Notation:
    from calibrant.formats.projects.records import Notation

    form = s.form
    return Notation(
        units=form.pose_units, rotation=form.pose_rotation, angle=form.pose_angle, direction=form.pose_direction,
        maker=s.robot_format,
    )  # fmt: skip


def _seen(folder: Path, request: Request, project: Project) -> Seen:
    from calibrant.formats.projects.edits import observations_named
    from calibrant.formats.projects.folder import inside
    from calibrant.formats.projects.records import Seen

    s = request.seen
    images, captures, poses = (tuple(inside(folder, p) for p in given) for given in (s.images, s.captures, s.poses))
    exclude = split_names(s.exclude)
    if s.more:
        before = observations_named(project, request.name)
        more = (images, captures, poses, exclude)
        if any((s.camera, s.target, s.projector, s.robot, s.setup, s.points)) or not any(more):
            raise InputError("--more takes --images, --captures, --poses or --exclude, and nothing else")
        if (images and not before.images) or (captures and not before.captures):
            raise InputError(f"the observations {request.name} are of another kind: add them under another name")
        return replace(
            before,
            images=images or before.images,
            captures=captures or before.captures,
            poses=poses or before.poses,
            exclude=exclude or before.exclude,
        )
    if not s.camera:
        raise InputError("observations need their --camera, by its name in the project")
    project.component(s.camera, kind="camera")
    if s.target:
        project.component(s.target, kind="target")
    if request.kind == "bag" and s.recording.bag is None:
        raise InputError("a recording is named by --bag FILE")
    return Seen(
        camera=s.camera, target=s.target, projector=s.projector, robot=s.robot,
        setup=s.setup or ("auto" if s.robot else "handheld"),
        points="" if s.points is None else inside(folder, s.points),
        recording=_recording(folder, s), notation=_notation(s), mirror_x=s.mirror_x, images=images, captures=captures,
        poses=poses, exclude=exclude,
    )  # fmt: skip
