"""What `calibrant hand-eye` does: read, pair, decide how the poses are written, calibrate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from calibrant.cli import session
from calibrant.cli.sources import Source, kept
from calibrant.errors import InputError, RefusedError

if TYPE_CHECKING:
    from calibrant.cameras import Camera
    from calibrant.data import CalibrationResult, Check, Missed, Observations, View
    from calibrant.diagnose.conventions import ConventionDecision
    from calibrant.formats.poses import PoseReading, RawPoses

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Request:
    """The command's arguments, as given."""

    poses: tuple[str, ...]
    images: tuple[str, ...] = ()
    target: str | None = None
    observations: Path | None = None
    target_poses: tuple[str, ...] = ()
    camera: Path | None = None
    setup: str = "auto"
    units: str = "auto"
    rotation: str = "auto"
    angle: str = "auto"
    direction: str = "auto"
    model: str = "brown"
    fix: tuple[str, ...] = ()
    mirror_x: bool = False
    exclude: tuple[str, ...] = ()
    workers: int | None = None
    quiet: bool = False

    @property
    def source(self) -> Source:
        """Where the points come from."""
        return Source(
            self.images, self.target, self.observations, self.exclude, self.mirror_x, self.workers, self.quiet
        )


def named_files(request: Request) -> list[str]:
    """The files and folders named by the request, with what patterns of photos stand for."""
    named = [*request.poses, *request.target_poses, *request.images]
    named += [str(p) for p in (request.camera, request.observations) if p is not None]
    return [*named, *(str(f) for f in (request.source.files() if request.images else []))]


def calibrate(request: Request) -> CalibrationResult:
    """Run the whole command. Raises: InputError, RefusedError as the parts do."""
    from calibrant.formats.poses import read_poses

    _check_setup(request.setup)
    _check_inputs(request)
    raw = read_poses(
        list(request.poses),
        units=request.units,
        rotation=request.rotation,
        angle=request.angle,
        direction=request.direction,
    )
    if request.images or request.observations is not None:
        return _from_images(request, raw)
    return _from_pose_pairs(request, raw)


def _check_setup(setup: str) -> None:
    from calibrant.calibrate.hand_eye.setup import SETUPS

    if setup not in ("auto", *SETUPS):
        raise InputError(f"unknown setup {setup!r}; choose auto, {' or '.join(SETUPS)}")


def _check_inputs(request: Request) -> None:
    """Photos or pose pairs, and no option that goes with the other kind. Raises: InputError."""
    if request.images or request.observations is not None:
        if request.target_poses:
            raise InputError("give photos (--images) or measured target poses (--target-poses), not both")
        request.source.files()
        return
    if request.target is not None and not request.target_poses:
        raise InputError("--target is given but no photos: name them with --images (or give --observations FILE)")
    for option, given in (
        ("--target", request.target),
        ("--camera", request.camera),
        ("--fix", request.fix),
        ("--mirror-x", request.mirror_x),
    ):
        if given:
            raise InputError(f"{option} goes with photos (--images); poses of the target are taken as they are")


def _from_images(request: Request, raw: RawPoses) -> CalibrationResult:
    from calibrant.calibrate.hand_eye.calibrate import calibrate_hand_eye
    from calibrant.formats.camera_files import read_camera
    from calibrant.formats.pairing import match_raw

    source = request.source
    files = source.files()
    # Photos are paired before they are searched: a pose that is missing is said at once.
    early = match_raw(raw, [f.name for f in files]) if files else None
    observations = source.read(files)
    ids = _ids_of(observations, files)
    pairing = early if early is not None else match_raw(raw, ids)
    row = dict(zip([ids[v] for v in pairing.view_index], pairing.pose_index))
    session.load_solver(quiet=request.quiet)
    size = next(iter(observations.image_sizes.values()))
    camera = None if request.camera is None else read_camera(request.camera, image_size=size)
    observations = replace(observations, views=tuple(replace(v, moment=v.id) for v in observations.views))
    seen, B = _target_poses(observations, camera, request)
    decision, reading = _decide(raw, [row[i] for i in seen], B, request)
    poses = reading.take(list(row.values()), list(row)).poses
    with session.status("Calibrating …", quiet=request.quiet):
        result = calibrate_hand_eye(
            poses, observations, setup=decision.setup, camera=camera, model=request.model, fix=request.fix
        )
    inputs: list[str | Path] = [*source.inputs(files), *request.poses, *([request.camera] if request.camera else [])]
    return _complete(session.with_misses(result), decision, pairing.message, inputs, request)


def _ids_of(observations: Observations, files: Sequence[Path]) -> list[str]:
    """Names of all views, found and missed; in the order of the photos, where there are photos."""
    every: list[View | Missed] = [*observations.views, *observations.missed]
    if not files:
        return [v.id for v in every]
    by_file = {v.file: v.id for v in every}
    return [by_file[str(f)] for f in files]


def _from_pose_pairs(request: Request, raw: RawPoses) -> CalibrationResult:
    from calibrant.calibrate.hand_eye.calibrate import calibrate_hand_eye
    from calibrant.formats.poses import read_poses, readings

    if request.target_poses:
        target = read_poses(list(request.target_poses), units=request.units, angle=request.angle)
    elif raw.target is not None:
        target = raw.target
    else:
        raise InputError(
            "robot poses alone do not say where the camera is: give photos (--images with --target), or measured "
            "poses of the target (--target-poses)"
        )
    names, pose_index, target_index, pairing = _pair(raw, target, request.exclude)
    B = np.asarray(readings(target, direction="base-gripper")[0].T_base_gripper)[target_index]
    session.load_solver(quiet=request.quiet)
    decision, reading = _decide(raw, pose_index, B, request)
    poses = reading.take(pose_index, names).poses
    with session.status("Calibrating …", quiet=request.quiet):
        result = calibrate_hand_eye(poses, B, setup=decision.setup)
    return _complete(result, decision, pairing, [*request.poses, *request.target_poses], request)


def _pair(raw: RawPoses, target: RawPoses, exclude: Sequence[str]) -> tuple[list[str], list[int], list[int], str]:
    """Names, indices of the robot's poses and of the target's, and the words for it. Raises: InputError."""
    from calibrant.formats.pairing import match

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


def _target_poses(observations: Observations, camera: Camera | None, request: Request) -> tuple[list[str], Array]:
    """Ids and T_camera_target of the views that have one, for deciding how the robot's poses are written."""
    from calibrant.calibrate.hand_eye.views import MINIMUM_POINTS
    from calibrant.calibrate.intrinsics import calibrate_keeping
    from calibrant.calibrate.target_poses import target_poses

    views = [v for v in observations.views if len(v) >= MINIMUM_POINTS]
    if camera is None:
        kept = calibrate_keeping(observations, model=request.model, fix=request.fix)
        camera = kept.result.camera
        views = [v for v in kept.views if len(v) >= MINIMUM_POINTS]
    if not views:
        raise RefusedError(f"no photo shows {MINIMUM_POINTS} points of the board or more; nothing to calibrate from")
    return [v.id for v in views], target_poses(camera, views).T_camera_target


def _decide(raw: RawPoses, rows: Sequence[int], B: Array, request: Request) -> tuple[ConventionDecision, PoseReading]:
    """How the poses are written and where the camera is, and that reading of all poses; a contradiction is refused."""
    from calibrant.diagnose.conventions import decide
    from calibrant.formats.poses import readings

    complete = readings(raw)
    paired = [r.take(rows) for r in complete]
    decision = decide(paired, B, setup=request.setup)  # type: ignore[arg-type]
    failed = [f for f in decision.findings if f.status == "fail"]
    if failed:
        raise RefusedError("; ".join(f"{f.name}: {f.message}" for f in failed))
    return decision, next(full for full, part in zip(complete, paired) if part is decision.reading)


def _complete(
    result: CalibrationResult,
    decision: ConventionDecision,
    pairing: str,
    files: Sequence[str | Path],
    request: Request,
) -> CalibrationResult:
    """The result with what was decided on the way, as checks, and the files it was made from."""
    from calibrant.data import Check, verdict_of
    from calibrant.diagnose.review import review

    decided: tuple[Check, ...] = (
        Check("pose-reading", "ok", decision.message, decision.confidence),
        *(f for f in decision.findings),
        Check("pairing", "ok", pairing),
    )
    checks = (*decided, *result.checks)
    options = {**result.options, "pose_reading": decision.reading.description}
    if request.mirror_x:
        options["mirror_x"] = True
    done = replace(
        result,
        checks=checks,
        verdict=verdict_of(checks),
        options=options,
        inputs=session.file_records(files),
    )
    return review(done)
