"""What `calibrant hand-eye` does: read, pair, decide how the poses are written, calibrate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from calibrant.cli import session
from calibrant.cli.options import exclude_names
from calibrant.errors import InputError, RefusedError

if TYPE_CHECKING:
    from calibrant.cameras import Camera
    from calibrant.data import CalibrationResult, Check, Observations
    from calibrant.diagnose.conventions import ConventionDecision
    from calibrant.formats.poses import PoseReading, RawPoses

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Request:
    """The command's arguments, as given."""

    poses: tuple[str, ...]
    images: tuple[str, ...] = ()
    target: str | None = None
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


def calibrate(request: Request) -> CalibrationResult:
    """Run the whole command. Raises: InputError, RefusedError as the parts do."""
    from calibrant.formats.poses import read_poses

    _check_setup(request.setup)
    raw = read_poses(
        list(request.poses),
        units=request.units,
        rotation=request.rotation,
        angle=request.angle,
        direction=request.direction,
    )
    if request.images:
        return _from_images(request, raw)
    return _from_pose_pairs(request, raw)


def _check_setup(setup: str) -> None:
    from calibrant.calibrate.hand_eye.setup import SETUPS

    if setup not in ("auto", *SETUPS):
        raise InputError(f"unknown setup {setup!r}; choose auto, {' or '.join(SETUPS)}")


def _from_images(request: Request, raw: RawPoses) -> CalibrationResult:
    from calibrant.calibrate.hand_eye.calibrate import calibrate_hand_eye
    from calibrant.detect.images import expand
    from calibrant.formats.camera_files import read_camera
    from calibrant.formats.pairing import match_raw

    if request.target is None:
        raise InputError("photos need the board they show: --target, such as chessboard:9x6:25mm")
    if request.target_poses:
        raise InputError("give photos (--images) or measured target poses (--target-poses), not both")
    files = exclude_names(expand(list(request.images)), request.exclude)
    pairing = match_raw(raw, [f.name for f in files])
    observations = session.detect_boards(
        files, request.target, mirror_x=request.mirror_x, workers=request.workers, quiet=request.quiet
    )
    session.load_solver(quiet=request.quiet)
    size = next(iter(observations.image_sizes.values()))
    camera = None if request.camera is None else read_camera(request.camera, image_size=size)
    names = [files[v].name for v in pairing.view_index]
    row = dict(zip(names, pairing.pose_index))
    observations = replace(observations, views=tuple(replace(v, moment=v.id) for v in observations.views))
    ids, B = _target_poses(observations, camera, request)
    decision, reading = _decide(raw, [row[i] for i in ids], B, request)
    poses = reading.take(list(row.values()), list(row)).poses
    with session.status("Calibrating …", quiet=request.quiet):
        result = calibrate_hand_eye(
            poses, observations, setup=decision.setup, camera=camera, model=request.model, fix=request.fix
        )
    inputs = [*files, *request.poses, *([request.camera] if request.camera else [])]
    return _complete(session.with_misses(result), decision, pairing.message, inputs, request)


def _from_pose_pairs(request: Request, raw: RawPoses) -> CalibrationResult:
    from calibrant.calibrate.hand_eye.calibrate import calibrate_hand_eye
    from calibrant.formats.pairing import match, match_by_order
    from calibrant.formats.poses import read_poses, readings

    if request.target_poses:
        target = read_poses(list(request.target_poses), units=request.units, angle=request.angle)
    elif raw.target is not None:
        target = raw.target
    else:
        raise InputError("give photos (--images with --target), or measured target poses (--target-poses)")
    names = target.names or tuple(str(i) for i in range(len(target)))
    if raw.names is not None and target.names is not None:
        pairing = match(raw.names, names)
    else:
        pairing = match_by_order(len(raw), names)
    B = np.asarray(readings(target, direction="base-gripper")[0].T_base_gripper)[list(pairing.view_index)]
    session.load_solver(quiet=request.quiet)
    decision, reading = _decide(raw, pairing.pose_index, B, request)
    poses = reading.take(pairing.pose_index, [names[v] for v in pairing.view_index]).poses
    with session.status("Calibrating …", quiet=request.quiet):
        result = calibrate_hand_eye(poses, B, setup=decision.setup)
    return _complete(result, decision, pairing.message, [*request.poses, *request.target_poses], request)


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


def _decide(
    raw: RawPoses, rows: Sequence[int], B: Array, request: Request
) -> tuple[ConventionDecision, PoseReading]:
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
