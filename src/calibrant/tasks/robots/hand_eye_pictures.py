"""The lists of hand-eye read one by one: each paired and examined by itself, its moments called as the others call
them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from calibrant.errors import InputError, RefusedError, causes
from calibrant.tasks.inputs import session
from calibrant.tasks.inputs.shared_photos import refuse_shared_photos
from calibrant.tasks.robots import hand_eye_list
from calibrant.tasks.robots.hand_eye_list import ListRequest, PairedData
from calibrant.tasks.robots.hand_eye_names import Names

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from calibrant.calibrate.cell.problem.joint_offsets import JointReadings
    from calibrant.calibrate.cell.problem.layout import Pictures
    from calibrant.cameras import Camera
    from calibrant.data import Check, Observations, RobotPoses
    from calibrant.diagnose.doctor.diagnosis import Diagnosis
    from calibrant.diagnose.doctor.evidence.finding import Finding
    from calibrant.formats.poses.read import PoseNotation, RawPoses

LEAST_VIEWS = 3
"""Fewer determine no camera by themselves, and tell nothing of how poses are written."""
_SAME_METRES = 1e-6
"""Two notations of a file give the same pose, or one that is off by the size of the motion."""


@dataclass(frozen=True, eq=False)
class ReadList:
    """One list, read and examined.

    pictures: what its camera saw, None for target poses measured elsewhere; poses: T_base_gripper by moment;
    diagnosis: what the doctor says, None where it has no say (a standing camera, two robots that both move); pairings:
    in words, by robot; notation: how the poses are read; other_poses: of the robot that carries the target.
    """

    words: str
    camera: str
    pictures: Pictures | None
    files: tuple[str | Path, ...]
    lens: Camera | None
    poses: Mapping[str, NDArray] = field(default_factory=dict)
    data: PairedData | None = None
    diagnosis: Diagnosis | None = None
    pairings: Mapping[str, str] = field(default_factory=dict)
    raw: RawPoses | None = None
    notation: str = ""
    other_poses: Mapping[str, NDArray] = field(default_factory=dict)

    @classmethod
    def examined(
        cls,
        words: str,
        camera: str,
        pictures: Pictures | None,
        data: PairedData,
        diagnosis: Diagnosis,
        moments: Mapping[str, str],
    ) -> ReadList:
        """A list that the doctor has examined; moments: of each of its rows, by id."""
        said = diagnosis.poses.notation
        return cls(
            words,
            camera,
            pictures,
            data.files,
            data.camera,
            poses={moments[i]: T for i, T in zip(said.ids, said.T_base_gripper)},
            data=data,
            diagnosis=diagnosis,
            pairings={"": data.pairing},
            raw=data.raw,
            notation=diagnosis.poses.decision.notation.description,
        )

    @property
    def few(self) -> bool:
        """Whether it waits for what other lists say of its poses."""
        return self.data is not None and self.diagnosis is None

    def poses_of(self, robot: str) -> Mapping[str, NDArray]:
        """The list's poses of a robot, by moment."""
        if self.pictures is not None and self.pictures.other == robot:
            return self.other_poses
        return self.poses if self.pictures is None or self.pictures.robot == robot else {}

    def checks(self, answered: Sequence[Check], *, alone: bool) -> tuple[Check, ...]:
        """What was decided on the way, but for questions that the calibration has answered itself, and better.

        Args: answered: the calibration's checks; alone: it is the only list, whose checks need no names.
        """
        from calibrant.data import Check

        known = {c.name for c in answered}
        suffix, head = ("", "") if alone else (f"-{self.camera}", f"{self.words}: ")
        out: list[Check] = []
        if self.diagnosis is not None:
            decision = self.diagnosis.poses.decision
            out.append(Check(f"pose-reading{suffix}", "ok", f"{head}{decision.message}", decision.confidence))
            labels = ("", suffix, f"-{self.words.replace(' ', '-')}")
            findings = [
                f.check for f in self.diagnosis.findings if not known & {f"{f.name}{label}" for label in labels}
            ]
            out += [replace(c, message=f"{head}{c.message}") for c in findings]
        for robot, words in self.pairings.items():
            out.append(Check(f"pairing{suffix}{'-' + robot if robot else ''}", "ok", f"{head}{words}"))
        return tuple(out)


def read_lists(names: Names, common: ListRequest, *, joined: bool) -> list[ReadList]:
    """Every list, read.

    Args: common: what all have in common; joined: the poses' own names tie moments of several lists (or joint values)
    together, else a moment is called as its photo.
    Raises: InputError, RefusedError as the parts do.
    """
    _refuse_shared_photos(names, common)
    lists: list[ReadList] = []
    # Where both robots move the doctor has no say: how their poses are read may follow from their other lists.
    for camera, robot in sorted(names.images, key=lambda item: ":" in item[1]):
        if ":" in robot:
            lists.append(_read_between(names, common, camera, robot, lists))
        else:
            lists.append(_read_one(names, common, camera, robot, joined=joined))
    return [_read_as_others(part, lists) if part.few else part for part in lists]


def _refuse_shared_photos(names: Names, common: ListRequest) -> None:
    """A photo under two cameras' names is one measurement that would count twice, a copy of it too. Raises: InputError
    before anything is searched."""
    if len({camera for camera, _ in names.images}) < 2:
        return
    files: dict[str, list[Path]] = {}
    for (camera, _), given in names.images.items():
        source = replace(common, images=tuple(given), target=names.target_of(camera)).source
        files[camera] = [*files.get(camera, []), *source.files()]
    refuse_shared_photos(files, option=lambda camera: "--images")


def alone_request(names: Names, common: ListRequest, camera: str, robot: str, poses_of: str) -> ListRequest:
    """The request of one list as if it were alone."""
    return replace(
        common,
        images=tuple(names.images[camera, robot]),
        poses=tuple(names.poses[poses_of]),
        target=names.target_of(camera),
        camera=names.cameras.get(camera),
        setup=names.setup_of(camera),
    )


def files_of(names: Names, common: ListRequest) -> list[str]:
    """Every file and folder that is named, and what patterns of photos stand for."""
    out = [str(f) for f in names.cameras.values()]
    for camera, robot in names.images:
        for name in [r for r in robot.split(":") if r in names.poses] or [next(iter(names.poses))]:
            out += hand_eye_list.named_files(alone_request(names, common, camera, robot, name))
    return out


def require_sound(diagnosis: Diagnosis) -> None:
    """Raises: RefusedError naming what failed, and the command that repairs what can be repaired."""
    failed: list[Finding] = [f for f in diagnosis.findings if f.status == "fail"]
    if not failed:
        return
    words = causes(f"{f.name}: {f.check.message}" for f in failed)
    if all(f.proposal for f in failed):
        words += "\ncalibrant doctor with the same arguments and --apply calibrates from repaired data"
    from calibrant.data.verdicts import stamp
    from calibrant.diagnose.doctor.diagnosis import as_result

    error = RefusedError(words)
    error.result = stamp(as_result(diagnosis))
    raise error


def _read_one(names: Names, common: ListRequest, camera: str, robot: str, *, joined: bool) -> ReadList:
    """One list: paired, examined."""
    from calibrant.calibrate.cell.problem.layout import ONLY_ROBOT, STANDING, Pictures

    robot = _robot_of(names, camera, robot)
    asked = (camera, robot) if (camera, robot) in names.images else (camera, "")
    alone = alone_request(names, common, *asked, robot)
    name = robot or ONLY_ROBOT
    words = camera if len(names.poses) == 1 else f"{camera} at {name}"
    if names.setups.get(camera) == STANDING:
        still, lens, files = _standing(alone)
        return ReadList(words, camera, Pictures(camera, STANDING, still, name, names.target_name(camera)), files, lens)
    data = hand_eye_list.read(alone)
    if len(names.images) > 1 and data.observations is not None and 0 < len(data.observations.views) < LEAST_VIEWS:
        seen = _few_at_moments(words, camera, data, data.observations, alone.setup)
        found = Pictures(camera, alone.setup, seen, name, names.target_name(camera))
        pairings = {"": data.pairing}
        return ReadList(words, camera, found, data.files, data.camera, data=data, pairings=pairings, raw=data.raw)
    with common.listener.status("Examining the data …" if names.plain else f"Examining the data of {words} …"):
        diagnosis = hand_eye_list.diagnose(data, alone)
    require_sound(diagnosis)
    moments = moments_of(data) if joined else {i: i for i in data.complete[0].ids}
    pictures = None
    if data.observations is not None:
        # A cell of several lists numbers its boards by what all of them say.
        numbered = diagnosis.numbered(data.observations) if names.plain else data.observations
        seen = replace(numbered, views=tuple(replace(v, moment=moments[v.id]) for v in numbered.views))
        pictures = Pictures(camera, diagnosis.poses.setup, seen, name, names.target_name(camera))
    return ReadList.examined(words, camera, pictures, data, diagnosis, moments)


def _few_at_moments(words: str, camera: str, data: PairedData, seen: Observations, setup: str) -> Observations:
    """Too few photos to be examined by themselves: the cell finds their camera through what others have found.

    Raises: RefusedError where nobody says what carries the camera.
    """
    if setup == "auto":
        photos = "1 photo shows" if len(seen.views) == 1 else f"{len(seen.views)} photos show"
        raise RefusedError(
            f"{words}: {photos} the target, which is not enough to tell whether the robot carries the camera or the "
            f"target: say it with --setup {camera}=eye-in-hand or {camera}=eye-to-hand, and other cameras of the cell "
            "tell where the target is; or add photos at other poses, 10 to 20"
        )
    moments = moments_of(data)
    return replace(seen, views=tuple(replace(v, moment=moments[v.id]) for v in seen.views))


def _read_as_others(part: ReadList, lists: Sequence[ReadList]) -> ReadList:
    """The list with its poses read as other lists of its robot have them. Raises: InputError where none says how."""
    if part.data is None or part.pictures is None:
        return part
    notation = _only_notation(part.pictures.robot, part.data, lists, why="so few photos")
    moments, poses = moments_of(part.data), notation.poses
    at = {moments[i]: T for i, T in zip(poses.ids, poses.T_base_gripper)}
    return replace(part, poses=at, notation=notation.description)


def _robot_of(names: Names, camera: str, robot: str) -> str:
    """The robot of a list; a standing camera needs none. Raises: InputError for one without poses."""
    from calibrant.calibrate.cell.problem.layout import STANDING

    if robot in names.poses:
        return robot
    if robot or names.setups.get(camera) != STANDING:
        known = f"--poses names {', '.join(names.poses)}" if any(names.poses) else "--poses names none"
        asked = f"robot {robot!r}, which has no poses" if robot else "no robot"
        raise InputError(f"--images {camera}{'@' + robot if robot else ''}=…: {asked}; {known}")
    return next(iter(names.poses))


def _read_between(names: Names, common: ListRequest, camera: str, robots: str, known: Sequence[ReadList]) -> ReadList:
    """Photos by a camera on one robot of a target on another: paired with the poses of both."""
    from calibrant.calibrate.cell.problem.layout import HAND_TO_HAND, Pictures

    robot, other = robots.split(":")
    for name in (robot, other):
        if name not in names.poses:
            raise InputError(f"--images {camera}@{robots}=…: robot {name!r} has no poses; --poses names the others")
    own, others = (hand_eye_list.read(alone_request(names, common, camera, robots, name)) for name in (robot, other))
    if own.observations is None or others.observations is None:
        raise InputError(f"--images {camera}@{robots}=…: no photos were read")
    first, second = (_only_notation(name, d, known) for name, d in ((robot, own), (other, others)))
    ids, other_ids = moments_of(own), moments_of(others)
    # One word for a moment of both robots: the poses' common name, else the photo's.
    moments = {i: n if other_ids.get(i) == n else f"{camera} {i}" for i, n in ids.items()}
    views = tuple(replace(v, moment=moments[v.id]) for v in own.observations.views if v.id in moments)
    seen = replace(own.observations, views=views)
    poses, other_poses = (
        {moments[i]: T for i, T in zip(r.ids, r.T_base_gripper) if i in moments} for r in (first.poses, second.poses)
    )
    return ReadList(
        f"{camera} on {robot}, target on {other}",
        camera,
        Pictures(camera, HAND_TO_HAND, seen, robot, names.target_name(camera), other),
        (*own.files, *others.files),
        own.camera,
        poses=poses,
        pairings={robot: own.pairing, other: others.pairing},
        raw=own.raw,
        notation=first.description,
        other_poses=other_poses,
    )


def _only_notation(
    robot: str, data: PairedData, known: Sequence[ReadList], why: str = "photos in which both robots move"
) -> PoseNotation:
    """How a robot's poses are read: as its other photos say, or the only way there is. Raises: InputError."""
    said = {p.notation for p in known if p.pictures is not None and p.pictures.robot == robot and p.notation}
    possible = [n for n in data.complete if not said or n.description in said]
    if len(possible) != 1:
        raise InputError(
            f"the poses of {robot} can be read in {len(data.complete)} ways, and {why} do not tell which: "
            "say it with --pose-units, --pose-rotation, --pose-angle and --pose-direction"
        )
    return possible[0]


def _standing(alone: ListRequest) -> tuple[Observations, Camera | None, tuple[str | Path, ...]]:
    """Photos of a camera and a board that both stand still: no pose belongs to them."""
    from calibrant.formats.cameras.read import read_camera

    source = alone.source
    files = source.files()
    observations = source.read(files)
    size = next(iter(observations.image_sizes.values()))
    camera = None if alone.camera is None else read_camera(alone.camera, image_size=size)
    session.load_solver(alone.listener)
    return observations, camera, tuple(source.inputs(files))


def moments_of(data: PairedData) -> dict[str, str]:
    """The pose file's own name (or number) of each photo's pose: the same for all cameras."""
    raw = data.raw
    names = raw.names if raw is not None and raw.names is not None else None
    ids = data.complete[0].ids
    return {i: names[k] if names is not None else str(k) for i, k in zip(ids, data.pose_index)}


def poses_of(lists: Sequence[ReadList], robot: str) -> RobotPoses:
    """All poses of a robot that its cameras' photos need. Raises: InputError where they are read in two ways."""
    import numpy as np

    from calibrant.data import RobotPoses

    found: dict[str, NDArray] = {}
    first: ReadList | None = None
    for part in lists:
        poses = part.poses_of(robot)
        if not poses:
            continue
        for moment, T in poses.items():
            if moment in found and first is not None and np.abs(found[moment] - T).max() > _SAME_METRES:
                raise InputError(
                    f"the photos of {first.camera} and of {part.camera} ask for two readings of the same poses: "
                    f"{first.notation}; {part.notation}. Say how they are meant: --pose-units, --pose-rotation, "
                    "--pose-direction, and --setup NAME=… of each camera"
                )
            found.setdefault(moment, T)
        first = first or part
    if not found:
        raise InputError(f"no photo belongs to a pose of {robot}; name some: --images NAME@{robot}=IMAGES")
    return RobotPoses(tuple(found), np.stack(list(found.values())), first.notation if first else "")


def joints_of(lists: Sequence[ReadList], robot: str, poses: RobotPoses, common: ListRequest) -> JointReadings:
    """What the robot's joints read at its poses. Raises: InputError where its file has poses alone."""
    from calibrant.calibrate.cell.problem.joint_offsets import JointReadings

    raw = next(p.raw for p in lists if (p.pictures is None or p.pictures.robot == robot) and p.raw is not None)
    chain = common.arm.chain()
    if raw.joints is None or chain is None:
        raise InputError(f"--identify needs joint values of {robot}; its file has poses")
    names = raw.names if raw.names is not None else tuple(str(i) for i in range(len(raw)))
    return JointReadings(names, raw.joints, chain).only(poses.ids)
