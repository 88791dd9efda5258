"""Find where the camera is: every list read, paired and examined by the doctor, then all calibrated as one cell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated

from calibrant.errors import InputError
from calibrant.tasks.inputs import session
from calibrant.tasks.inputs.bags.topics import cameras_of_bag
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.bags import PosedBagOptions
from calibrant.tasks.options.cameras import LensOptions
from calibrant.tasks.options.choices import METHODS, SETUPS
from calibrant.tasks.options.images import CornerOptions, PointsOptions, SearchOptions
from calibrant.tasks.options.option import Option
from calibrant.tasks.options.poses import PoseOptions, TargetPoseOptions
from calibrant.tasks.options.robots import RobotOptions
from calibrant.tasks.options.words import split_names
from calibrant.tasks.options.workspace import WorkspaceOptions
from calibrant.tasks.outcome import Outcome
from calibrant.tasks.robots.hand_eye_alone import calibrated_alone
from calibrant.tasks.robots.hand_eye_bag import BagLists, poses_named, read_bag, require_one_source, with_offset_error
from calibrant.tasks.robots.hand_eye_list import ListRequest
from calibrant.tasks.robots.hand_eye_names import ONLY_CAMERA, Names, names_of
from calibrant.tasks.robots.hand_eye_pictures import ReadList, files_of, joints_of, poses_of, read_lists

if TYPE_CHECKING:
    from calibrant.data import CalibrationResult
    from calibrant.formats.poses.read import RawPoses

EXAMPLE = 'cb.hand_eye(images="photos/*.png", poses="poses.csv", target="chessboard:9x6:25mm")'


@dataclass(frozen=True, kw_only=True)
class Request:
    """Find where the camera is: on the gripper or beside the robot.

    calibrant hand-eye --images photos/*.png --poses poses.csv --target chessboard:9x6:25mm --out result.json

    Reads the poses as they are written (units, rotation, direction are found from the data and said), calibrates
    camera, robot and target in one problem, and refuses what the motions cannot determine.

    Several cameras: --images left=photos/left --images right=photos/right. Several robots: --poses a=a.csv --poses
    b=b.csv --images top@a=photos/a --images top@b=photos/b. A recording of ROS has both: --bag run.mcap --image-topic
    /camera/image_raw --tf base_link:tool0.
    """

    poses: Annotated[tuple[str, ...], Option("FILES")] = ()
    """File of robot poses, or one file a pose; of several robots: NAME=FILE for each."""
    images: Annotated[tuple[str, ...], Option("IMAGES", "-i")] = ()
    """Photos, folders or patterns; of several cameras: NAME=IMAGES for each, NAME@ROBOT=IMAGES with several robots."""
    target: Annotated[tuple[str, ...], Option("SPEC", "-t")] = ()
    """The board: chessboard:9x6:25mm (inner corners), charuco:5x7:36mm:18mm:DICT_6X6_250 (squares), or a file; of one
    of several cameras: NAME=SPEC."""
    recording: PosedBagOptions = PosedBagOptions()
    points: PointsOptions = PointsOptions()
    measured: TargetPoseOptions = TargetPoseOptions()
    camera: Annotated[tuple[str, ...], Option("FILE")] = ()
    """Known camera (any format), of several NAME=FILE; without it the photos calibrate it."""
    setup: Annotated[tuple[str, ...], Option("SETUP", choices=SETUPS)] = ()
    """auto (the default), eye-in-hand or eye-to-hand; of one of several cameras: NAME=SETUP, or NAME=standing for a
    camera and a board that both stand beside the robot."""
    form: PoseOptions = PoseOptions()
    arm: RobotOptions = RobotOptions()
    identify: Annotated[tuple[str, ...], Option("GROUPS")] = ()
    """With --robot and joint values: find the robot's own errors too: offsets, gear, coupling, geometry."""
    robot_accuracy: Annotated[tuple[str, ...], Option("LENGTH[,ANGLE]")] = ()
    """How far the flange is off, rms, as measured or by its maker: 0.3mm, or 0.3mm,0.02deg; of several robots:
    NAME=0.3mm. What errors of the robot's geometry do is then in every sigma."""
    method: Annotated[str, Option("NAME", choices=METHODS)] = "joint"
    """joint (weighs pixels and robot, states its uncertainty), or a closed form: tsai, park, horaud, …"""
    name: Annotated[str, Option("NAME")] = "camera"
    """What the camera is called: its key under `cameras` and its frame in the result; of several, --images NAME=…."""
    volume: WorkspaceOptions = WorkspaceOptions()
    lens: LensOptions = LensOptions()
    search: SearchOptions = SearchOptions()
    corners: CornerOptions = CornerOptions()


def reads(request: Request) -> list[str]:
    """Every file that is named, and the photos that patterns stand for."""
    if request.recording.bag is not None:
        named = [*poses_named(request.recording, ()), *(str(f) for f in _names(request).cameras.values())]
        return [*named, *request.arm.files]
    return files_of(_names(request), _common(request, SILENT))


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """The calibrated cell, reviewed.

    Raises: InputError; RefusedError where the data determine nothing or contradict it, with the result where it got
    that far.
    """
    from calibrant.data import verdict_of
    from calibrant.data.renamed import with_camera_name
    from calibrant.data.verdicts import refuse_if_failed

    request, bag = _with_bag(request, listener)
    names, common = _names(request), _common(request, listener, None if bag is None else bag.raw)
    _check_options(request, names)
    identify = split_names(request.identify)
    joined = not names.plain or bool(identify)
    lists = read_lists(names, common, joined=joined)
    with listener.status("Calibrating …"):
        result = _calibrated(lists, names, common, identify, request.method, _accuracies(request, names))
    if bag is not None and bag.later is not None:
        moved = replace(common, recorded=bag.later)
        with listener.status("Calibrating …"):
            later = read_lists(names, moved, joined=joined)
            shifted = _calibrated(later, names, moved, identify, request.method, _accuracies(request, names))
        result = with_offset_error(result, shifted)
    said = () if bag is None else bag.checks
    checks = (*(c for p in lists for c in p.checks(result.checks, alone=names.plain)), *said, *result.checks)
    done = replace(
        result,
        checks=checks,
        verdict=verdict_of(checks),
        options=_asked(result, names, request),
        decided={**_setups(result), **result.decided, **_notations(lists, names)},
        inputs=session.file_records(f for p in lists for f in p.files),
    )
    reviewed = request.volume.applied(with_camera_name(session.with_misses(done), request.name))
    refuse_if_failed(reviewed)
    return Outcome(result=reviewed)


def _with_bag(request: Request, listener: Listener) -> tuple[Request, BagLists | None]:
    """The request with the bag's pictures for photos, and what the bag says of poses. Raises: InputError."""
    asked = request.recording
    points = request.points.observations is not None or bool(request.measured.target_poses)
    require_one_source(asked, images=request.images, poses=request.poses, points=points)
    if asked.bag is None:
        return request, None
    request = replace(request, camera=cameras_of_bag(asked.bag, request.camera))
    names = _names(request)
    camera = next(iter(names.images))[0]
    bag = read_bag(asked, _common(request, listener), names.target_of(camera), names.cameras, names.setup_of(camera))
    return replace(request, images=bag.images, poses=poses_named(asked, ())), bag


def _names(request: Request) -> Names:
    return names_of(
        images=request.images or request.recording.image_topic,
        poses=request.poses,
        cameras=request.camera,
        setups=request.setup,
        targets=request.target,
        beside_photos=request.points.observations is not None or bool(request.measured.target_poses),
    )


def _common(request: Request, listener: Listener, recorded: RawPoses | None = None) -> ListRequest:
    """What all lists have in common."""
    return ListRequest(
        poses=(),
        observations=request.points.observations,
        measured=request.measured,
        form=request.form,
        arm=request.arm,
        lens=request.lens,
        search=request.search,
        corners=request.corners,
        listener=listener,
        recorded=recorded,
    )


def _check_options(request: Request, names: Names) -> None:
    """Options that do not go together. Raises: InputError."""
    from calibrant.calibrate.solvers.registry import JOINT, require_method
    from calibrant.data.renamed import check_camera_name

    if check_camera_name(request.name) != ONLY_CAMERA and next(iter(names.images))[0] != ONLY_CAMERA:
        raise InputError(f"--name {request.name}: the photos have names already, by --images NAME=…")
    if request.name != ONLY_CAMERA and request.measured.target_poses:
        raise InputError(f"--name {request.name} names the camera of photos or points; target poses have none")
    request.volume.check()
    closed_form = require_method(request.method) != JOINT
    if closed_form and request.volume.workspace is not None:
        raise InputError(f"--workspace needs an uncertainty, which {request.method} does not state; leave --method out")
    if closed_form and (not names.plain or request.identify):
        raise InputError(
            f"--method {request.method}: a closed form knows one camera on one robot; the report lists all of them"
        )
    if request.robot_accuracy and (closed_form or request.measured.free_scale):
        raise InputError("--robot-accuracy serves the joint refinement at the size given: leave --method out, and free")
    if request.measured.free_scale and (not names.plain or request.identify):
        raise InputError("--target-scale free knows one camera on one robot; calibrate each by itself first")
    if not request.identify:
        return
    if request.points.observations is not None or request.measured.target_poses:
        raise InputError("several cameras or robots, and free joints, are calibrated from photos: give --images")
    if request.volume.workspace is not None:
        raise InputError(
            "--workspace is not available with --identify: the result file does not hold what the offsets add to it; "
            "calibrate once more with the corrected robot, without --identify"
        )
    if request.arm.robot is None:
        raise InputError("--identify needs the joints: --robot FILE, and --poses with joint values")


def _calibrated(
    lists: Sequence[ReadList],
    names: Names,
    common: ListRequest,
    identify: tuple[str, ...],
    method: str,
    accuracies: Mapping[str, str],
) -> CalibrationResult:
    """All lists in one problem."""
    from calibrant.calibrate.cell.calibrate import calibrate_cell
    from calibrant.calibrate.cell.problem.layout import ONLY_ROBOT

    if names.plain and not identify and lists[0].camera == ONLY_CAMERA and lists[0].diagnosis is not None:
        return calibrated_alone(
            lists[0],
            model=common.lens.model,
            fix=split_names(common.lens.fix),
            method=method,
            accuracy=next(iter(accuracies.values()), None),
            free_scale=common.measured.free_scale,
        )
    robots = {name or ONLY_ROBOT: poses_of(lists, name or ONLY_ROBOT) for name in names.poses}
    joints = {name: joints_of(lists, name, robots[name], common) for name in robots} if identify else None
    return calibrate_cell(
        robots,
        [p.pictures for p in lists if p.pictures is not None],
        cameras={p.camera: p.lens for p in lists if p.lens is not None},
        joints=joints,
        identify=identify or ("offsets",),
        model=common.lens.model,
        fix=split_names(common.lens.fix),
        robot_accuracy=accuracies,
    )


def _accuracies(request: Request, names: Names) -> dict[str, str]:
    """The accuracies that are told, by robot. Raises: InputError for a robot that is not there."""
    from calibrant.calibrate.cell.certainty.accuracy import robot_accuracy
    from calibrant.calibrate.cell.problem.layout import ONLY_ROBOT

    robots = [name or ONLY_ROBOT for name in names.poses]
    out: dict[str, str] = {}
    for text in request.robot_accuracy:
        name, named, value = text.rpartition("=")
        robot = name if named else ONLY_ROBOT
        if robot not in robots:
            raise InputError(
                f"--robot-accuracy {text}: say of which robot, as NAME=0.3mm; there are {', '.join(robots)}"
            )
        out[robot] = robot_accuracy(value).text
    return out


def _asked(result: CalibrationResult, names: Names, request: Request) -> dict[str, object]:
    """The options as the command has them: a setup that the data decided was not asked."""
    alone = not isinstance(result.options.get("setup"), Mapping)
    setup = names.setup if alone else {camera: names.setup_of(camera) for camera, _ in names.images}
    scale = request.measured.target_scale
    return {
        **result.options,
        "setup": setup,
        **({"mirror_x": True} if request.search.mirror_x else {}),
        **({"target_scale": scale} if scale != "1" else {}),
    }


def _setups(result: CalibrationResult) -> dict[str, str]:
    """The setup that was calibrated, of each camera where they are named."""
    setup = result.options["setup"]
    return {f"setup {name}": s for name, s in setup.items()} if isinstance(setup, Mapping) else {"setup": setup}


def _notations(lists: Sequence[ReadList], names: Names) -> dict[str, str]:
    """How the poses of every list are read."""
    named = {p.camera: p.notation for p in lists if p.notation}
    return {f"pose_reading{'' if names.plain else ' ' + camera}": notation for camera, notation in named.items()}
