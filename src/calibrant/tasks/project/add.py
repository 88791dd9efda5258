"""Add a component to a project, or observations: who saw what, from which robot's poses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from calibrant.errors import InputError
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.choices import MODELS
from calibrant.tasks.options.fields import spread
from calibrant.tasks.options.option import Option
from calibrant.tasks.options.patterns import PatternOptions
from calibrant.tasks.options.poses import PoseOptions
from calibrant.tasks.options.project import ProjectOptions, command_line
from calibrant.tasks.options.words import pixels, split_names
from calibrant.tasks.outcome import Outcome
from calibrant.tasks.project.shown import changed

if TYPE_CHECKING:
    from calibrant.formats.projects.records import Component, Project, Seen

EXAMPLE = 'cb.project_add("camera", "left", project="cell", model="brown")'
COMPONENTS = ("camera", "rig", "projector", "robot", "tool", "target", "frame")
OBSERVATIONS = ("images", "captures", "points")
KINDS = (*COMPONENTS, *OBSERVATIONS)

_LENS = frozenset({"file", "start", "model", "fix"})
_PATTERNS = frozenset({"projector_size", "code", "period", "shifts"})
_POSES = frozenset({"pose_units", "pose_rotation", "pose_angle", "pose_direction", "robot_format"})
_SEEN = frozenset({"camera", "target", "setup", "robot", "poses", "mirror_x", "exclude", "more"}) | _POSES
OPTIONS: Mapping[str, frozenset[str]] = {
    "camera": _LENS,
    "rig": frozenset({"cameras"}),
    "projector": _LENS | _PATTERNS | {"camera"},
    "robot": frozenset({"accuracy"}),
    "tool": frozenset({"robot"}),
    "target": frozenset({"spec"}),
    "frame": frozenset(),
    "images": _SEEN | {"images"},
    "captures": _SEEN | {"captures", "projector"},
    "points": (_SEEN - {"mirror_x"}) | {"points", "projector"},
}
"""The options of each kind."""


@dataclass(frozen=True, kw_only=True)
class ComponentOptions:
    """What components say."""

    file: Annotated[Path | None, Option("FILE")] = None
    """Of a camera or projector: its lens, where it is known (any format), held within its uncertainty."""
    start: bool = False
    """Calibrate the lens all the same, beginning with that of --file."""
    model: Annotated[str, Option("NAME", choices=MODELS)] = ""
    """Of a camera or projector: its model; brown unless given."""
    fix: Annotated[tuple[str, ...], Option("NAMES", names=True)] = ()
    """Of a camera or projector: hold these, e.g. k3, aspect, tangential."""
    cameras: Annotated[tuple[str, ...], Option("NAMES")] = ()
    """Of a rig: the cameras that are fixed to each other; the first one's frame is the rig's."""
    accuracy: Annotated[str, Option("LENGTH,ANGLE")] = ""
    """Of a robot: how far its flange is off, rms: 0.3mm or 0.3mm,0.02deg."""
    spec: Annotated[str, Option("SPEC")] = ""
    """Of a target: the board, such as chessboard:9x6:25mm, or a file."""
    patterns: PatternOptions = PatternOptions()


@dataclass(frozen=True, kw_only=True)
class SeenOptions:
    """What observations say. camera, robot and projector are names in the project."""

    camera: Annotated[str, Option("NAME")] = ""
    """Of observations: the camera; of a projector: the camera that sees its light."""
    target: Annotated[str, Option("NAME")] = ""
    """Of observations: the target that was seen."""
    projector: Annotated[str, Option("NAME")] = ""
    """Of captures: the projector that shone."""
    robot: Annotated[str, Option("NAME")] = ""
    """Of observations: the robot at whose poses they were made; of a tool: the one that holds it."""
    setup: Annotated[str, Option("NAME", choices=("auto", "eye-in-hand", "eye-to-hand", "standing", "handheld"))] = ""
    """Of observations: eye-in-hand, eye-to-hand, or auto (with a robot, the default), standing, handheld (without)."""
    images: Annotated[tuple[str, ...], Option("IMAGES", "-i")] = ()
    """Photos, folders, patterns in quotes, or videos; a folder's new photos are noticed by solve."""
    captures: Annotated[tuple[str, ...], Option("DIRS")] = ()
    """A folder of photos of all patterns for each pose, or one that holds these folders."""
    points: Annotated[Path | None, Option("FILE")] = None
    """Points found before (calibrant detect --out)."""
    poses: Annotated[tuple[str, ...], Option("FILES")] = ()
    """The robot's poses: a file, or one file a pose."""
    robot_format: Annotated[str, Option("MAKER")] = ""
    """How poses are written: ur, franka, kuka, fanuc, abb, yaskawa, staubli, kawasaki."""
    mirror_x: bool = False
    """The camera delivers mirror images: flip them left to right."""
    exclude: Annotated[tuple[str, ...], Option("NAMES")] = ()
    """Images or captures to leave out, by name."""
    more: bool = False
    """Add to the observations of that name: more images, captures, poses, names to leave out."""
    form: PoseOptions = PoseOptions()


@dataclass(frozen=True, kw_only=True)
class Request:
    """Add a component (camera, rig, projector, robot, tool, target, frame) or observations (images, captures, points).

    calibrant project add robot ur --accuracy 0.1mm
    calibrant project add target board --spec chessboard:9x6:25mm
    calibrant project add camera wrist --model brown
    calibrant project add images hand --camera wrist --target board --images photos --robot ur --poses poses.csv

    Files stay where they are: the project keeps where, from its own folder.
    """

    kind: Annotated[str, Option("KIND", positional=True, choices=KINDS)]
    """camera, rig, projector, robot, tool, target or frame; images, captures or points."""
    name: Annotated[str, Option("NAME", positional=True)]
    """What it is called in the project."""
    place: ProjectOptions = ProjectOptions()
    component: ComponentOptions = ComponentOptions()
    seen: SeenOptions = SeenOptions()


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """The project with it. Raises: InputError for a name that is taken or none, options of another kind, components
    and files that are not there."""
    from calibrant.formats.projects.checks import check_name
    from calibrant.formats.projects.edits import with_component, with_more_seen, with_seen
    from calibrant.formats.projects.folder import folder_of, update
    from calibrant.tasks.project.seeing import to_see

    _check_options(request)
    folder = folder_of(request.place.project)

    def edited(project: Project) -> Project:
        if request.kind in COMPONENTS:
            return with_component(project, request.name, _component(folder, request))
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
    from calibrant.formats.projects.records import Component

    said, kind = request.component, request.kind
    if said.start and said.file is None:
        raise InputError("--start begins with the lens of a file: name it with --file")
    if kind == "robot" and said.accuracy:
        from calibrant.calibrate.cell.certainty.accuracy import robot_accuracy

        return Component(kind=kind, accuracy=robot_accuracy(said.accuracy).text)
    if kind == "target":
        return Component(kind=kind, spec=_spec(folder, said.spec))
    if kind not in ("camera", "projector"):
        return Component(kind=kind, cameras=split_names(said.cameras), robot=request.seen.robot)
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


def _seen(folder: Path, request: Request, project: Project) -> Seen:
    from calibrant.formats.projects.edits import observations_named
    from calibrant.formats.projects.folder import inside
    from calibrant.formats.projects.records import Notation, Seen

    s, form = request.seen, request.seen.form
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
    notation = Notation(
        units=form.pose_units, rotation=form.pose_rotation, angle=form.pose_angle, direction=form.pose_direction,
        maker=s.robot_format,
    )  # fmt: skip
    return Seen(
        camera=s.camera, target=s.target, projector=s.projector, robot=s.robot,
        setup=s.setup or ("auto" if s.robot else "handheld"),
        points="" if s.points is None else inside(folder, s.points),
        notation=notation, mirror_x=s.mirror_x, images=images, captures=captures, poses=poses, exclude=exclude,
    )  # fmt: skip
