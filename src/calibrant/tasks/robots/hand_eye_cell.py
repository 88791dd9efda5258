"""What `calibrant hand-eye` does with several cameras or robots, or free joints: each list of photos is read, paired
and examined by itself, as that of a single camera is; then all go into one problem.

Names: --images left=DIR, or left@robot=DIR with several robots, left@robot:other=DIR where the other robot carries the
target; --poses robot=FILE; --camera left=FILE;
--setup left=eye-in-hand; --target left=SPEC.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from calibrant.cli import session
from calibrant.errors import InputError
from calibrant.tasks.robots import hand_eye_data
from calibrant.tasks.robots.hand_eye import Request, in_workspace, require_sound

if TYPE_CHECKING:
    from calibrant.calibrate.cell.problem.joint_offsets import JointReadings
    from calibrant.calibrate.cell.problem.layout import Pictures
    from calibrant.cameras import Camera
    from calibrant.data import CalibrationResult, Check, Observations, RobotPoses
    from calibrant.diagnose.doctor.diagnosis import Diagnosis
    from calibrant.formats.poses.read import PoseNotation, RawPoses

_NAMED = re.compile(r"^(?P<name>[A-Za-z][\w-]*)(?:@(?P<robot>[A-Za-z][\w-]*(?::[A-Za-z][\w-]*)?))?=(?P<value>.+)$")
_SAME_METRES = 1e-6
"""Two readings of a file give the same pose, or one that is off by the size of the motion."""


@dataclass(frozen=True)
class SeveralRequest:
    """The command's arguments with their names. images by (camera, robot); robot "" where none was named."""

    common: Request
    images: Mapping[tuple[str, str], tuple[str, ...]]
    poses: Mapping[str, tuple[str, ...]]
    cameras: Mapping[str, Path]
    setups: Mapping[str, str]
    targets: Mapping[str, str]
    identify: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class _List:
    """One list of photos, read and examined: the pictures, how their robot's poses are read, and what was said."""

    pictures: Pictures
    poses: Mapping[str, np.ndarray]
    checks: tuple[Check, ...]
    files: tuple[str | Path, ...]
    camera: Camera | None
    raw: RawPoses | None = None
    reading: str = ""
    other_poses: Mapping[str, np.ndarray] = field(default_factory=dict)

    def poses_of(self, robot: str) -> Mapping[str, np.ndarray]:
        """The list's poses of a robot, by moment."""
        if self.pictures.other == robot:
            return self.other_poses
        return self.poses if self.pictures.robot == robot else {}


@dataclass(frozen=True)
class Named:
    """Values of an option by their name, and those without one."""

    named: Mapping[tuple[str, str], tuple[str, ...]] = field(default_factory=dict)
    plain: tuple[str, ...] = ()


def named(values: Sequence[str], option: str) -> Named:
    """NAME=VALUE apart from plain values; a file that exists under the whole word is meant as such.

    Raises: InputError where some values have a name and others do not.
    """
    found: dict[tuple[str, str], tuple[str, ...]] = {}
    plain: list[str] = []
    for value in values:
        match = _NAMED.match(value)
        if match is None or Path(value).exists():
            plain.append(value)
            continue
        key = (match["name"], match["robot"] or "")
        found[key] = (*found.get(key, ()), match["value"])
    if found and plain and option not in ("--setup", "--target"):
        name = next(iter(found))[0]
        raise InputError(
            f"{option} {plain[0]} has no name, {option} {name}=… has one: with several, each needs its name "
            f"({option} NAME={plain[0]})"
        )
    return Named(found, tuple(plain))


def several_request(
    common: Request,
    *,
    images: Sequence[str],
    poses: Sequence[str],
    cameras: Sequence[str],
    setups: Sequence[str],
    targets: Sequence[str],
    identify: Sequence[str],
) -> SeveralRequest | None:
    """The request of several cameras or robots; None where nothing is named and no joint is free.

    Raises: InputError for names that contradict each other.
    """
    seen, robots = named(images, "--images"), named(poses, "--poses")
    known, setup, target = named(cameras, "--camera"), named(setups, "--setup"), named(targets, "--target")
    every = {"--camera": known, "--setup": setup, "--target": target}
    if not seen.named and not robots.named and not identify:
        stray = next((option for option, n in every.items() if n.named), None)
        if stray is not None:
            raise InputError(
                f"{stray} names a camera, but the photos have no names: --images NAME=IMAGES for each camera"
            )
        return None
    if common.observations is not None or common.target_poses:
        raise InputError("several cameras or robots, and free joints, are calibrated from photos: give --images")
    lists = dict(seen.named) or {("camera", ""): seen.plain}
    names = {camera for camera, _ in lists}
    for option, n in every.items():
        for name, robot in n.named:
            if robot or name not in names:
                asked = f"{name}@{robot}" if robot else name
                raise InputError(
                    f"{option} {asked}=…: there is no camera of that name; --images names {', '.join(names)}"
                )
    if known.plain and len(names) > 1:
        raise InputError(f"--camera {known.plain[0]}: which of {', '.join(sorted(names))}? Write --camera NAME=FILE")
    one = next(iter(names))
    files = {one: Path(known.plain[0])} if known.plain else {}
    return SeveralRequest(
        replace(common, setup=setup.plain[-1] if setup.plain else "auto"),
        lists,
        {robot: f for (robot, _), f in robots.named.items()} or {"": robots.plain},
        files | {name: Path(values[-1]) for (name, _), values in known.named.items()},
        {name: values[-1] for (name, _), values in setup.named.items()},
        {name: values[-1] for (name, _), values in target.named.items()},
        tuple(identify),
    )


def named_files(request: SeveralRequest) -> list[str]:
    """Every file that the command reads."""
    out = [str(f) for f in request.cameras.values()]
    for (camera, robot), images in request.images.items():
        poses = [f for r in robot.split(":") for f in request.poses.get(r, ())]
        out += hand_eye_data.named_files(_alone(request, camera, tuple(images), tuple(poses)))
    return out


def calibrate(request: SeveralRequest) -> CalibrationResult:
    """Run the whole command. Raises: InputError, RefusedError as the parts do."""
    from calibrant.calibrate.cell.by_method import JOINT, require_method
    from calibrant.calibrate.cell.calibrate import calibrate_several
    from calibrant.calibrate.cell.problem.layout import ONLY_ROBOT
    from calibrant.data import verdict_of
    from calibrant.diagnose.budget.volume import check_request
    from calibrant.diagnose.review import review

    common = request.common
    check_request(common.workspace, common.tolerance, common.target_sigma)
    if require_method(common.method) != JOINT:
        raise InputError(
            f"--method {common.method}: a closed form knows one camera on one robot; the report lists all of them"
        )
    if request.identify and common.workspace is not None:
        raise InputError(
            "--workspace is not available with --identify: the result file does not hold what the offsets add to it; "
            "calibrate once more with the corrected robot, without --identify"
        )
    if request.identify and common.arm.robot is None:
        raise InputError("--identify needs the joints: --robot FILE, and --poses with joint values")
    lists: list[_List] = []
    # Where both robots move the doctor has no say: how their poses are read may follow from their other lists.
    for (camera, robot), images in sorted(request.images.items(), key=lambda item: ":" in item[0][1]):
        if ":" in robot:
            lists.append(_read_between(request, camera, robot, images, lists))
        else:
            lists.append(_read(request, camera, robot, images))
    robots = {name or ONLY_ROBOT: _poses_of(lists, name or ONLY_ROBOT) for name in request.poses}
    joints = {name: _joints(request, lists, name, robots[name]) for name in robots} if request.identify else None
    with session.status("Calibrating …", quiet=request.common.quiet):
        result = calibrate_several(
            robots,
            [part.pictures for part in lists],
            cameras={part.pictures.camera: part.camera for part in lists if part.camera is not None},
            joints=joints,
            identify=request.identify or ("offsets",),
            model=request.common.model,
            fix=request.common.fix,
        )
    checks = (*(c for part in lists for c in part.checks), *result.checks)
    readings = {f"pose_reading {part.pictures.camera}": part.reading for part in lists if part.reading}
    files = [f for part in lists for f in part.files]
    done = replace(
        result,
        checks=checks,
        verdict=verdict_of(checks),
        options={**result.options, **({"mirror_x": True} if common.mirror_x else {})},
        decided={**result.decided, **readings},
        inputs=session.file_records(files),
    )
    reviewed = review(session.with_misses(done))
    return in_workspace(reviewed, common.workspace, common.tolerance, common.target_sigma)


def _alone(request: SeveralRequest, camera: str, images: tuple[str, ...], poses: tuple[str, ...]) -> Request:
    """The request of one list of photos, as if it were alone."""
    return replace(
        request.common,
        images=images,
        poses=poses,
        target=request.targets.get(camera, request.common.target),
        camera=request.cameras.get(camera),
        setup=request.setups.get(camera, request.common.setup),
    )


def _read_between(
    request: SeveralRequest, camera: str, robots: str, images: tuple[str, ...], known: Sequence[_List]
) -> _List:
    """Photos by a camera on one robot of a target on another: paired with the poses of both."""
    from calibrant.calibrate.cell.problem.layout import HAND_TO_HAND, Pictures
    from calibrant.data import Check

    robot, other = robots.split(":")
    for name in (robot, other):
        if name not in request.poses:
            raise InputError(f"--images {camera}@{robots}=…: robot {name!r} has no poses; --poses names the others")
    data = [hand_eye_data.read(_alone(request, camera, images, request.poses[name])) for name in (robot, other)]
    own, others = data
    observations = own.observations
    if observations is None or others.observations is None:
        raise InputError(f"--images {camera}@{robots}=…: no photos were read")
    first, second = (_only_reading(name, d, known) for name, d in zip((robot, other), data))
    names = [_moments(d) for d in data]
    # One word for a moment of both robots: the poses' common name, else the photo's.
    moments = {i: n if names[1].get(i) == n else f"{camera} {i}" for i, n in names[0].items()}
    views = tuple(replace(v, moment=moments[v.id]) for v in observations.views if v.id in moments)
    label = request.targets.get(camera, request.common.target) or "target"
    pictures = Pictures(
        camera, HAND_TO_HAND, replace(observations, views=views), robot, _target_name(request, label), other
    )
    poses, other_poses = (
        {moments[i]: T for i, T in zip(r.ids, r.T_base_gripper) if i in moments} for r in (first.poses, second.poses)
    )
    words = f"{camera} on {robot}, target on {other}"
    checks = tuple(Check(f"pairing-{camera}-{n}", "ok", f"{words}: {d.pairing}") for n, d in zip((robot, other), data))
    files = (*own.files, *others.files)
    return _List(pictures, poses, checks, files, own.camera, own.raw, first.description, other_poses)


def _only_reading(robot: str, data: hand_eye_data.PairedData, known: Sequence[_List]) -> PoseNotation:
    """How a robot's poses are read: as its other photos say, or the only way there is. Raises: InputError."""
    said = {part.reading for part in known if part.pictures.robot == robot and part.reading}
    possible = [r for r in data.complete if not said or r.description in said]
    if len(possible) != 1:
        raise InputError(
            f"the poses of {robot} can be read in {len(data.complete)} ways, and photos in which both robots move do "
            "not tell which: say it with --pose-units, --pose-rotation, --pose-angle and --pose-direction"
        )
    return possible[0]


def _read(request: SeveralRequest, camera: str, robot: str, images: tuple[str, ...]) -> _List:
    """One list of photos: paired, examined, its moments called as the poses are."""
    from calibrant.calibrate.cell.boards.turned import NAME
    from calibrant.calibrate.cell.problem.layout import ONLY_ROBOT, STANDING, Pictures
    from calibrant.data import Check

    if robot not in request.poses:
        if robot or request.setups.get(camera) != STANDING:
            known = ", ".join(request.poses)
            asked = f"robot {robot!r}, which has no poses" if robot else "no robot"
            raise InputError(f"--images {camera}{'@' + robot if robot else ''}=…: {asked}; --poses names {known}")
        robot = next(iter(request.poses))
    alone = _alone(request, camera, images, request.poses[robot])
    name = robot or ONLY_ROBOT
    label = alone.target or "target"
    words = camera if len(request.poses) == 1 else f"{camera} at {name}"
    if alone.setup == STANDING:
        still, lens, files = _standing(alone)
        return _List(Pictures(camera, STANDING, still, name, _target_name(request, label)), {}, (), files, lens)
    data = hand_eye_data.read(alone)
    with session.status(f"Examining the data of {words} …", quiet=alone.quiet):
        diagnosis = hand_eye_data.diagnose(data, alone)
    require_sound(diagnosis)
    observations, moments = data.observations, _moments(data)
    if observations is None:
        raise InputError(f"--images {camera}=…: no photos were read")
    seen = replace(observations, views=tuple(replace(v, moment=moments[v.id]) for v in observations.views))
    decision = diagnosis.poses.decision
    checks = (
        Check(f"pose-reading-{camera}", "ok", f"{words}: {decision.message}", decision.confidence),
        *(replace(f.check, message=f"{words}: {f.check.message}") for f in diagnosis.findings if f.name != NAME),
        Check(f"pairing-{camera}", "ok", f"{words}: {data.pairing}"),
    )
    pictures = Pictures(camera, diagnosis.poses.setup, seen, name, _target_name(request, label))
    poses = _read_as(diagnosis, data, moments)
    return _List(pictures, poses, checks, data.files, data.camera, data.raw, decision.notation.description)


def _target_name(request: SeveralRequest, spec: str) -> str:
    """ "target" where all cameras see one kind of board, else its spec."""
    kinds = {request.targets.get(camera, request.common.target) for camera, _ in request.images}
    return "target" if len(kinds) == 1 else spec


def _standing(alone: Request) -> tuple[Observations, Camera | None, tuple[str | Path, ...]]:
    """Photos of a camera and a board that both stand still: no pose belongs to them."""
    from calibrant.formats.cameras.read import read_camera

    source = alone.source
    files = source.files()
    observations = source.read(files)
    size = next(iter(observations.image_sizes.values()))
    camera = None if alone.camera is None else read_camera(alone.camera, image_size=size)
    session.load_solver(quiet=alone.quiet)
    return observations, camera, tuple(source.inputs(files))


def _moments(data: hand_eye_data.PairedData) -> dict[str, str]:
    """The pose file's own name (or number) of each photo's pose: the same for all cameras."""
    raw = data.raw
    names = raw.names if raw is not None and raw.names is not None else None
    ids = data.complete[0].ids
    return {i: names[k] if names is not None else str(k) for i, k in zip(ids, data.pose_index)}


def _read_as(diagnosis: Diagnosis, data: hand_eye_data.PairedData, moments: Mapping[str, str]) -> dict[str, np.ndarray]:
    """T_base_gripper by moment, in the reading that the doctor chose."""
    reading = diagnosis.poses.notation
    return {moments[i]: T for i, T in zip(reading.ids, reading.T_base_gripper)}


def _poses_of(lists: Sequence[_List], robot: str) -> RobotPoses:
    """All poses of a robot that its cameras' photos need. Raises: InputError where they are read in two ways."""
    from calibrant.data import RobotPoses

    found: dict[str, np.ndarray] = {}
    first: _List | None = None
    for part in lists:
        poses = part.poses_of(robot)
        if not poses:
            continue
        for moment, T in poses.items():
            if moment in found and first is not None and np.abs(found[moment] - T).max() > _SAME_METRES:
                raise InputError(
                    f"the photos of {first.pictures.camera} and of {part.pictures.camera} ask for two readings of the "
                    f"same poses: {first.reading}; {part.reading}. Say how they are meant: --pose-units, "
                    "--pose-rotation, --pose-direction, and --setup NAME=… of each camera"
                )
            found.setdefault(moment, T)
        first = first or part
    if not found:
        raise InputError(f"no photo belongs to a pose of {robot}; name some: --images NAME@{robot}=IMAGES")
    return RobotPoses(tuple(found), np.stack(list(found.values())), first.reading if first else "")


def _joints(request: SeveralRequest, lists: Sequence[_List], robot: str, poses: RobotPoses) -> JointReadings:
    """What the robot's joints read at its poses."""
    from calibrant.calibrate.cell.problem.joint_offsets import JointReadings

    raw = next(part.raw for part in lists if part.pictures.robot == robot and part.raw is not None)
    chain = request.common.arm.chain()
    if raw.joints is None or chain is None:
        raise InputError(f"--identify needs joint values of {robot}; its file has poses")
    names = raw.names if raw.names is not None else tuple(str(i) for i in range(len(raw)))
    return JointReadings(names, raw.joints, chain).only(poses.ids)
