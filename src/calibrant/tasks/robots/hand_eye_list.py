"""What `hand-eye` and `doctor` both begin with: a list of photos or target poses, paired with poses and examined."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from calibrant.errors import InputError, RefusedError
from calibrant.tasks.inputs import session
from calibrant.tasks.inputs.sources import Source, kept
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.cameras import LensOptions
from calibrant.tasks.options.images import CornerOptions, SearchOptions
from calibrant.tasks.options.poses import PoseOptions, TargetPoseOptions
from calibrant.tasks.options.robots import RobotOptions
from calibrant.tasks.options.words import split_names

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from calibrant.cameras import Camera
    from calibrant.data import Missed, Observations, View
    from calibrant.diagnose.doctor.diagnosis import Diagnosis
    from calibrant.diagnose.doctor.evidence.finding import Finding
    from calibrant.formats.poses.read import PoseNotation, RawPoses


@dataclass(frozen=True, kw_only=True)
class ListRequest:
    """One list of photos, of points found before, or of target poses, and the robot poses that belong to it.

    recorded: the poses themselves, where no file but a recording has them; found: what the photos show, where they were
    searched before; known: the camera, where it is at hand and no file is to be read.
    """

    poses: tuple[str, ...]
    images: tuple[str, ...] = ()
    target: str | None = None
    observations: Path | None = None
    measured: TargetPoseOptions = TargetPoseOptions()
    camera: Path | None = None
    setup: str = "auto"
    form: PoseOptions = PoseOptions()
    arm: RobotOptions = RobotOptions()
    lens: LensOptions = LensOptions()
    search: SearchOptions = SearchOptions()
    corners: CornerOptions = CornerOptions()
    listener: Listener = SILENT
    recorded: RawPoses | None = None
    found: Observations | None = None
    known: Camera | None = None

    @property
    def source(self) -> Source:
        """Where the points come from."""
        return Source(
            images=self.images,
            target=self.target,
            observations=self.observations,
            search=self.search,
            refinement=self.corners.refinement(),
            listener=self.listener,
        )

    @property
    def of_photos(self) -> bool:
        """Whether its points come from photos, searched now or before."""
        return bool(self.images) or self.observations is not None or self.found is not None


@dataclass(frozen=True, eq=False)
class PairedData:
    """Robot poses in every reading, in the order of the photos or target poses they are paired with.

    observations with the camera that was given (or None), or T_camera_target (n, 4, 4); pairing: the rule in words;
    files: everything that was read. raw: the poses as the file has them; pose_index: the row of each that is used.
    target_reading: how the target poses were read, where that is not as their file says or would be taken to mean.
    """

    complete: tuple[PoseNotation, ...]
    pairing: str
    files: tuple[str | Path, ...]
    observations: Observations | None = None
    camera: Camera | None = None
    T_camera_target: NDArray | None = None
    raw: RawPoses | None = None
    pose_index: tuple[int, ...] = ()
    target_reading: Finding | None = None


def named_files(request: ListRequest) -> list[str]:
    """The files and folders named by the request, with what patterns of photos stand for."""
    named = [*request.poses, *request.measured.target_poses, *request.images, *request.arm.files]
    named += [str(p) for p in (request.camera, request.observations) if p is not None]
    return [*named, *(str(f) for f in (request.source.files() if request.images else []))]


def read(request: ListRequest) -> PairedData:
    """Read, detect and pair. Raises: InputError as the parts do."""
    _check_setup(request.setup)
    _check_list(request)
    request.measured.check()
    raw = request.recorded
    if raw is None:
        raw = request.form.read(request.poses, request.arm)
    return _with_images(request, raw) if request.of_photos else _with_target_poses(request, raw)


def diagnose(data: PairedData, request: ListRequest) -> Diagnosis:
    """What the doctor says of the data; where they contradict an option that says how rotations are written, that alone
    is the cause. Raises: RefusedError where the motions or the readings determine nothing."""
    from calibrant.tasks.robots.pose_options import contradicted

    try:
        found = _diagnosed(data, request)
    except RefusedError as error:
        finding = contradicted(data, request, None, _diagnosed)
        if finding is not None:
            raise RefusedError(f"{finding.name}: {finding.message}") from error
        raise
    finding = contradicted(data, request, found, _diagnosed)
    return found if finding is None else found.explained_by(finding)


def _diagnosed(data: PairedData, request: ListRequest) -> Diagnosis:
    from calibrant.diagnose.doctor.diagnosis import diagnose_poses, diagnose_views

    setup = request.setup
    if data.observations is None:
        said = request.measured.target_pose_direction != "auto"
        found = diagnose_poses(
            data.complete,
            data.T_camera_target,  # type: ignore[arg-type]
            setup=setup,  # type: ignore[arg-type]
            direction_said=said,
            free_scale=request.measured.free_scale,
        )
        return found if data.target_reading is None else replace(found, findings=(*found.findings, data.target_reading))
    observations, camera = _seen(data, request)
    given = data.camera is not None
    return diagnose_views(
        data.complete,
        observations,
        camera,
        setup=setup,  # type: ignore[arg-type]
        camera_given=given,
        free_scale=request.measured.free_scale,
    )


def _seen(data: PairedData, request: ListRequest) -> tuple[Observations, Camera]:
    """The observations without points that do not belong, and the camera that saw them."""
    from calibrant.calibrate.cell.problem.views import FEWEST_POINTS, MINIMUM_POINTS
    from calibrant.calibrate.intrinsics.one_model import calibrate_keeping

    observations = data.observations
    least = MINIMUM_POINTS if data.camera is None else FEWEST_POINTS
    if observations is None or not any(len(v) >= least for v in observations.views):
        way_out = "; with the camera known (--camera) the four corners of a tag will do" if data.camera is None else ""
        raise RefusedError(f"no photo shows {least} points of the board or more; nothing to calibrate from{way_out}")
    if data.camera is not None:
        return observations, data.camera
    found = calibrate_keeping(observations, model=request.lens.model, fix=split_names(request.lens.fix))
    return replace(observations, views=found.views), found.result.camera


def _check_setup(setup: str) -> None:
    from calibrant.calibrate.solvers.setup import SETUPS

    if setup not in ("auto", *SETUPS):
        raise InputError(f"unknown setup {setup!r}; choose auto, {' or '.join(SETUPS)}")


def _check_list(request: ListRequest) -> None:
    """Photos or pose pairs, and no option that goes with the other kind. Raises: InputError."""
    if request.of_photos:
        if request.measured.target_poses:
            raise InputError("give photos (--images) or measured target poses (--target-poses), not both")
        if request.measured.scale != 1:
            raise InputError(
                f"--target-scale {request.measured.target_scale}: goes with target poses; a board's real size is given "
                "with --target, and --target-scale free finds it"
            )
        if request.measured.target_pose_direction != "auto":
            raise InputError("--target-pose-direction goes with target poses, not with photos")
        if request.images or request.observations is not None:
            request.source.files()
        return
    if request.target is not None and not request.measured.target_poses:
        raise InputError("--target is given but no photos: name them with --images (or give --observations FILE)")
    for option, given in (
        ("--target", request.target),
        ("--camera", request.camera),
        ("--fix", request.lens.fix),
        ("--mirror-x", request.search.mirror_x),
    ):
        if given:
            raise InputError(f"{option} goes with photos (--images); poses of the target are taken as they are")


def _with_images(request: ListRequest, raw: RawPoses) -> PairedData:
    from calibrant.data.file_names import distinct_names
    from calibrant.formats.cameras.read import read_camera
    from calibrant.formats.poses.pairing import match_kept, match_raw
    from calibrant.formats.poses.read import every_notation

    source = request.source
    searched = bool(request.images) or request.observations is not None
    files = source.files() if searched else []
    # Photos are paired before they are searched: a pose that is missing is said at once.
    every = source.every_file() if files else []
    called = distinct_names([f for f, _ in every])
    early = match_kept(raw, [called[f] for f, _ in every], [k for _, k in every]) if files else None
    observations = request.found if request.found is not None else source.read(files)
    ids = _ids_of(observations, files)
    pairing = early if early is not None else match_raw(raw, ids)
    session.load_solver(request.listener)
    size = next(iter(observations.image_sizes.values()))
    camera = request.known
    if request.camera is not None:
        camera = read_camera(request.camera, image_size=size)
    observations = replace(observations, views=tuple(replace(v, moment=v.id) for v in observations.views))
    names = [ids[v] for v in pairing.view_index]
    inputs: list[str | Path] = [*(source.inputs(files) if searched else ()), *request.poses]
    inputs += [request.camera] if request.camera is not None else []
    complete = tuple(r.take(pairing.pose_index, names) for r in every_notation(raw))
    return PairedData(
        complete, pairing.message, tuple(inputs), observations, camera, raw=raw, pose_index=tuple(pairing.pose_index)
    )


def _ids_of(observations: Observations, files: Sequence[Path]) -> list[str]:
    """Names of all views, found and missed; in the order of the photos, where there are photos."""
    every: list[View | Missed] = [*observations.views, *observations.missed]
    if not files:
        return [v.id for v in every]
    by_file = {v.file: v.id for v in every}
    return [by_file[str(f)] for f in files]


def _with_target_poses(request: ListRequest, raw: RawPoses) -> PairedData:
    from calibrant.diagnose.doctor.target_notation import decide_target_notation
    from calibrant.formats.poses.read import every_notation, read_poses

    measured = request.measured
    if measured.target_poses:
        target = read_poses(list(measured.target_poses), rotation=measured.target_pose_rotation)
        _refuse_pairs_and_more(request, raw, target)
    elif raw.target is not None:
        target = raw.target
    else:
        raise InputError(
            "robot poses alone do not say where the camera is: give photos (--images with --target), or measured "
            "poses of the target (--target-poses)"
        )
    session.load_pose_solver(request.listener)
    names, pose_index, target_index, pairing = _pair(raw, target, split_names(request.search.exclude))
    complete = tuple(r.take(pose_index, names) for r in every_notation(raw))
    target = replace(target, options=replace(target.options, direction="base-gripper"))
    of_target = [r.take(target_index, names) for r in every_notation(target)]
    decided = decide_target_notation(complete, of_target, free_scale=measured.free_scale)
    return PairedData(
        complete,
        pairing,
        (*request.poses, *measured.target_poses),
        T_camera_target=measured.as_camera_target(decided.notation.T_base_gripper),
        raw=raw,
        pose_index=tuple(pose_index),
        target_reading=decided.finding,
    )


def _refuse_pairs_and_more(request: ListRequest, raw: RawPoses, target: RawPoses) -> None:
    """A file of pairs holds both lists: beside a second one the data do not say which is meant. Raises: InputError."""
    for option, files, found in (
        ("--poses", request.poses, raw),
        ("--target-poses", request.measured.target_poses, target),
    ):
        if found.target is not None:
            raise InputError(
                f"{option} {', '.join(files)}: holds pairs, each robot pose with its target pose: give it as --poses "
                "without --target-poses, or give two files with one list each"
            )


def _pair(raw: RawPoses, target: RawPoses, exclude: Sequence[str]) -> tuple[list[str], list[int], list[int], str]:
    """Names, indices of the robot's poses and of the target's, and the words for it. Raises: InputError."""
    from calibrant.formats.poses.pairing import match

    n = len(target)
    if raw.names is not None and target.names is not None:
        found = match(raw.names, target.names)
        names = [target.names[v] for v in found.view_index]
        pose_index, target_index = list(found.pose_index), list(found.view_index)
        message = found.message.replace("images", "target poses").replace("image", "target pose")
    elif len(raw) == n:
        names = list(raw.names or target.names or (str(i) for i in range(n)))
        pose_index = target_index = list(range(n))
        message = f"{n} robot poses and {n} target poses paired by order"
    else:
        raise InputError(
            f"{len(raw)} robot poses and {n} target poses: without names on both sides they are paired by order, and "
            "that needs as many of one as of the other"
        )
    keep = [i for i, k in enumerate(kept(names, exclude, what="pose")) if k]
    return [names[i] for i in keep], [pose_index[i] for i in keep], [target_index[i] for i in keep], message
