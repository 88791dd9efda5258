"""What `calibrant hand-eye` does: read, pair, ask the doctor, calibrate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from calibrant.cli import session
from calibrant.errors import InputError, RefusedError
from calibrant.tasks.robots import hand_eye_data
from calibrant.tasks.robots.hand_eye_data import named_files as named_files

if TYPE_CHECKING:
    from calibrant.data import CalibrationResult, Check
    from calibrant.diagnose.doctor.diagnosis import Diagnosis
    from calibrant.diagnose.doctor.evidence.finding import Finding


@dataclass(frozen=True)
class Request(hand_eye_data.Request):
    """The command's arguments, as given."""

    method: str = "joint"
    workspace: str | None = None
    tolerance: str | None = None
    target_sigma: str | None = None


def calibrate(request: Request) -> CalibrationResult:
    """Run the whole command. Raises: InputError, RefusedError as the parts do."""
    from calibrant.calibrate.cell.by_method import JOINT, require_method
    from calibrant.calibrate.cell.hand_eye import calibrate_hand_eye
    from calibrant.diagnose.budget.volume import check_request

    check_request(request.workspace, request.tolerance, request.target_sigma)
    if require_method(request.method) != JOINT and request.workspace is not None:
        raise InputError(f"--workspace needs an uncertainty, which {request.method} does not state; leave --method out")
    data = hand_eye_data.read(request)
    with session.status("Examining the data …", quiet=request.quiet):
        diagnosis = hand_eye_data.diagnose(data, request)
    require_sound(diagnosis)
    target = data.T_camera_target if data.observations is None else diagnosis.numbered(data.observations)
    with session.status("Calibrating …", quiet=request.quiet):
        result = calibrate_hand_eye(
            diagnosis.poses.notation.poses,
            target,  # type: ignore[arg-type]
            setup=diagnosis.poses.setup,
            camera=data.camera,
            model=request.model,
            fix=request.fix,
            method=request.method,
        )
    return _complete(session.with_misses(result), diagnosis, data, request)


def require_sound(diagnosis: Diagnosis) -> None:
    """Raises: RefusedError naming what failed, and the command that repairs what can be repaired."""
    failed = [f for f in diagnosis.findings if f.status == "fail"]
    if not failed:
        return
    words = "; ".join(f"{f.name}: {f.check.message}" for f in failed)
    if all(f.proposal for f in failed):
        words += "; calibrant doctor with the same arguments and --apply calibrates from repaired data"
    raise RefusedError(words)


def _complete(
    result: CalibrationResult, diagnosis: Diagnosis, data: hand_eye_data.PairedData, request: Request
) -> CalibrationResult:
    """The result with what was decided on the way, as checks, and the files it was made from."""
    from calibrant.data import Check, verdict_of
    from calibrant.diagnose.review import review

    decision = diagnosis.poses.decision
    checks = (
        Check("pose-reading", "ok", decision.message, decision.confidence),
        *doctor_checks(diagnosis.findings, result.checks),
        Check("pairing", "ok", data.pairing),
        *result.checks,
    )
    options = {**result.options, **({"mirror_x": True} if request.mirror_x else {})}
    done = replace(
        result,
        checks=checks,
        verdict=verdict_of(checks),
        options=options,
        decided={**result.decided, "pose_reading": decision.notation.description},
        inputs=session.file_records(data.files),
    )
    return in_workspace(review(done), request.workspace, request.tolerance, request.target_sigma)


def doctor_checks(findings: Sequence[Finding], known: Sequence[Check]) -> list[Check]:
    """The findings as checks, but for questions that the calibration has answered itself, and better."""
    answered = {c.name for c in known}
    return [f.check for f in findings if f.name not in answered]


def in_workspace(
    result: CalibrationResult, workspace: str | None, tolerance: str | None, target_sigma: str | None
) -> CalibrationResult:
    """The result with its accuracy in the workspace asked for, where one is. Raises: InputError for a wrong volume."""
    from calibrant.diagnose.budget.volume import check_request

    check_request(workspace, tolerance, target_sigma)
    if workspace is None:
        return result
    from calibrant.diagnose.budget.workspace import with_workspace

    return with_workspace(result, workspace, tolerance=tolerance, target_sigma=target_sigma)
