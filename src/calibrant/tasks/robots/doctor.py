"""Find what is wrong with hand-eye data or a stereo pair's; with `apply`, calibrate from the repaired data."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from calibrant.errors import InputError, RefusedError
from calibrant.tasks.inputs import session
from calibrant.tasks.inputs.bags.topics import ONLY, bag_files, cameras_of_bag
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.bags import PosedBagOptions
from calibrant.tasks.options.cameras import KnownCameraOptions, LensOptions
from calibrant.tasks.options.choices import SETUPS
from calibrant.tasks.options.images import NamedPhotoOptions, PairPhotoOptions, PointsOptions, SearchOptions
from calibrant.tasks.options.option import Option
from calibrant.tasks.options.poses import PoseOptions, TargetPoseOptions
from calibrant.tasks.options.robots import RobotOptions
from calibrant.tasks.options.words import split_names
from calibrant.tasks.outcome import Document, NextStep, Outcome
from calibrant.tasks.robots import hand_eye_list, pair_doctor
from calibrant.tasks.robots.hand_eye_bag import poses_named, read_bag, require_one_source
from calibrant.tasks.robots.hand_eye_list import ListRequest, PairedData

if TYPE_CHECKING:
    from calibrant.data import CalibrationResult, Check, RobotPoses
    from calibrant.diagnose.doctor.diagnosis import Diagnosis
    from calibrant.diagnose.look import Look

EXAMPLE = 'cb.doctor(images="photos/*.png", poses="poses.csv", target="chessboard:9x6:25mm")'


@dataclass(frozen=True, kw_only=True)
class Request:
    """Find what is wrong with hand-eye data (how poses are written, pairing, flipped boards, size, motion) or with the
    pictures of two cameras (pairing, sides, mirror images, exchanged cameras, other cameras' pictures).

    calibrant doctor --images photos/*.png --poses poses.csv --target chessboard:9x6:25mm
    calibrant doctor --bag run.mcap --image-topic /camera/image_raw --tf base_link:tool0 --target chessboard:9x6:25mm
    calibrant doctor --left photos/left*.jpg --right photos/right*.jpg --target chessboard:9x6:25mm

    Proposes a repair for each fault and shows how the loop closes before and after it. Nothing is changed: --apply
    calibrates from the repaired data and writes new files. Exit status 1 while a fault stands, or a warning that a
    repair is proposed for.
    """

    poses: Annotated[tuple[str, ...], Option("FILES")] = ()
    """File of robot poses, or one file a pose."""
    pair: PairPhotoOptions = PairPhotoOptions()
    photos: NamedPhotoOptions = NamedPhotoOptions()
    recording: PosedBagOptions = PosedBagOptions()
    points: PointsOptions = PointsOptions()
    measured: TargetPoseOptions = TargetPoseOptions()
    known: KnownCameraOptions = KnownCameraOptions()
    setup: Annotated[str, Option("SETUP", choices=SETUPS)] = "auto"
    """auto, eye-in-hand or eye-to-hand."""
    form: PoseOptions = PoseOptions()
    arm: RobotOptions = RobotOptions()
    apply: bool = False
    """Repair the data in memory and calibrate: --out, --repaired-poses are new files."""
    repaired_poses: Annotated[Path | None, Option("FILE.csv", output="file")] = None
    """With --apply: the repaired poses, T_base_gripper in metres."""
    lens: LensOptions = LensOptions()
    search: SearchOptions = SearchOptions()


def reads(request: Request) -> list[str]:
    """Every file that is named, and the photos that patterns stand for."""
    if request.pair.asked:
        return [str(f) for f in pair_doctor.pictures(_pair_request(request, SILENT)).inputs]
    if request.recording.bag is not None:
        files = [*bag_files(request.recording.bag), *request.arm.files]
        return [*files, *([] if request.known.camera is None else [str(request.known.camera)])]
    return hand_eye_list.named_files(_list_request(request, SILENT))


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """What was found, or the calibration of the repaired data; faults that stand unrepaired are the outcome's refusal.

    Raises: InputError; RefusedError where nothing can be said of the data.
    """
    from calibrant.data.verdicts import stamp
    from calibrant.diagnose.doctor.diagnosis import as_result
    from calibrant.diagnose.look import look

    if request.repaired_poses is not None and not request.apply:
        raise InputError("--repaired-poses goes with --apply: without it nothing is repaired")
    if request.pair.asked:
        return pair_doctor.run(_pair_request(request, listener))
    if not request.poses and request.recording.bag is None:
        raise InputError(
            "--poses is missing: name the robot poses, a recording that has them (--bag), or --left and --right, the "
            "pictures of two cameras"
        )
    asked, said = _with_bag(request, _list_request(request, listener))
    data = hand_eye_list.read(asked)
    with listener.status("Examining the data …"):
        diagnosis = hand_eye_list.diagnose(data, asked)
    seen_by = as_result(diagnosis)
    found = stamp(replace(seen_by, checks=(*said, *seen_by.checks), inputs=session.file_records(data.files)))
    if not request.apply:
        return Outcome(result=found, then=_then(diagnosis), refusal=_refusal(diagnosis))
    seen = look(found)
    try:
        with listener.status("Calibrating from the repaired data …"):
            result = _repaired(diagnosis, data, asked)
    except RefusedError as error:
        return Outcome(summary=lambda: seen, refusal=error)
    documents = []
    if request.repaired_poses is not None:
        documents.append(Document(request.repaired_poses, csv_text(diagnosis.repaired.poses).encode()))
    # The page shows what was found, also where it was repaired.
    return Outcome(result=result, documents=documents, summary=lambda: (seen, "", result), page=partial(_page, seen))


def _with_bag(request: Request, asked: ListRequest) -> tuple[ListRequest, tuple[Check, ...]]:
    """The list with the bag's pictures for photos and its poses, and what the bag says of its moments and clocks."""
    recording = request.recording
    points = request.points.observations is not None or bool(request.measured.target_poses)
    require_one_source(recording, images=request.photos.images, poses=request.poses, points=points)
    if recording.bag is None:
        return asked, ()
    camera = None
    if request.known.camera is not None:
        (given,) = cameras_of_bag(recording.bag, (str(request.known.camera),))
        camera = Path(given)
    cameras = {} if camera is None else {ONLY: camera}
    bag = read_bag(recording, asked, request.photos.target, cameras, request.setup)
    poses = poses_named(recording, ())
    return replace(asked, images=bag.images, poses=poses, recorded=bag.raw, camera=camera), bag.checks


def _pair_request(request: Request, listener: Listener) -> pair_doctor.PairRequest:
    """Raises: InputError for options that are of hand-eye data alone."""
    given = {
        "--poses": request.poses,
        "--bag": request.recording.bag,
        "--images": request.photos.images,
        "--observations": request.points.observations,
        "--target-poses": request.measured.target_poses,
        "--camera": request.known.camera,
        "--repaired-poses": request.repaired_poses,
    }
    wrong = [option for option, value in given.items() if value]
    if wrong:
        raise InputError(f"--left and --right are a stereo pair's pictures: leave out {', '.join(wrong)}")
    return pair_doctor.PairRequest(
        pair=request.pair,
        target=request.photos.target,
        search=request.search,
        model=request.lens.model,
        apply=request.apply,
        listener=listener,
    )


def _list_request(request: Request, listener: Listener) -> ListRequest:
    return ListRequest(
        poses=request.poses,
        images=request.photos.images,
        target=request.photos.target,
        observations=request.points.observations,
        measured=request.measured,
        camera=request.known.camera,
        setup=request.setup,
        form=request.form,
        arm=request.arm,
        lens=request.lens,
        search=request.search,
        listener=listener,
    )


def _repaired(diagnosis: Diagnosis, data: PairedData, request: ListRequest) -> CalibrationResult:
    """The hand-eye calibration of the repaired data; what was repaired is said as warnings.

    Raises: RefusedError for a fault that only a person can cure, and as the calibration does.
    """
    from calibrant.calibrate.cell.boards.turned import NAME
    from calibrant.data import Check, verdict_of
    from calibrant.diagnose.doctor.evidence.told import faults
    from calibrant.diagnose.doctor.repair import calibrate_repaired

    found = calibrate_repaired(diagnosis, model=request.lens.model, fix=split_names(request.lens.fix))
    result = session.with_misses(found)
    done = tuple(
        Check(f.name, "warn", f"repaired: {f.check.message}" if f.proposal else f.message, f.check.value)
        for f in diagnosis.findings
        if f.status != "ok"
    )
    decision = diagnosis.poses.decision
    checks = (
        Check("pose-reading", "ok", decision.message, decision.confidence),
        *done,
        *(f.check for f in diagnosis.named(NAME)),
        Check("pairing", "ok", data.pairing),
        *(c for c in result.checks if c.name not in {d.name for d in done}),
    )
    decided = {**result.decided, "pose_reading": decision.notation.description}
    inputs = session.file_records(data.files)
    complete = replace(result, checks=checks, verdict=verdict_of(checks), decided=decided, inputs=inputs)
    return complete.with_detail(faults(diagnosis.findings))


def _page(seen: Look) -> str:
    from calibrant.reports.html import report_page

    return report_page(seen)


def _refusal(diagnosis: Diagnosis) -> RefusedError | None:
    """What is said when faults, or warnings with a cure, stand unrepaired; None where there are none."""
    standing = [f for f in diagnosis.findings if f.status == "fail" or (f.status == "warn" and f.proposal)]
    if not standing:
        return None
    names = ", ".join(dict.fromkeys(f.name for f in standing))
    told = "found and not repaired" if diagnosis.sound else "the data are not fit for calibration"
    cure = "; --apply calibrates from repaired data" if _is_repairable(diagnosis) else ""
    return RefusedError(f"{told}: {names}{cure}")


def _is_repairable(diagnosis: Diagnosis) -> bool:
    """Whether --apply has something to repair, and no fault is left that only a person can cure."""
    cured = [f for f in diagnosis.findings if f.proposal and (f.repair is not None or f in diagnosis.poses.findings)]
    return bool(cured) and all(f.proposal for f in diagnosis.findings if f.status == "fail")


def _then(diagnosis: Diagnosis) -> NextStep | None:
    """The command that calibrates: from the repaired data where they are, from the data where nothing stands."""
    if _is_repairable(diagnosis):
        files = ("--apply", "--out", "repaired.json", "--report", "repaired.html")
        return NextStep("calibrate from the repaired data", "doctor", files)
    if diagnosis.sound:
        return NextStep("calibrate", "hand-eye", ("--out", "hand-eye.json", "--report", "hand-eye.html"))
    return None


def csv_text(poses: RobotPoses) -> str:
    """Poses in the native form: image,x,y,z,qx,qy,qz,qw, T_base_gripper in metres."""
    from calibrant.geometry.rotations import quaternion_xyzw_from_matrix

    T = poses.T_base_gripper
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(["image", "x", "y", "z", "qx", "qy", "qz", "qw"])
    for name, t, q in zip(poses.ids, T[:, :3, 3], quaternion_xyzw_from_matrix(T[:, :3, :3])):
        writer.writerow([name, *(repr(float(v)) for v in (*t, *q))])
    return buffer.getvalue()
