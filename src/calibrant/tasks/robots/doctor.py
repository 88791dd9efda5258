"""What `calibrant doctor` does: examine, say what was found, and with --apply calibrate from the repaired data."""

from __future__ import annotations

import csv
import io
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from calibrant.cli import session
from calibrant.errors import InputError, RefusedError
from calibrant.tasks.robots import hand_eye_data

if TYPE_CHECKING:
    from calibrant.data import CalibrationResult, RobotPoses
    from calibrant.diagnose.doctor.diagnosis import Diagnosis
    from calibrant.diagnose.look import Look


@dataclass(frozen=True)
class Repair:
    """Whether repairs are applied, and where the repaired poses go."""

    apply: bool = False
    poses: Path | None = None

    def check(self, outputs: session.Outputs, inputs: Sequence[str]) -> None:
        """Raises: InputError for a file that cannot be written, or that nobody asked to be repaired."""
        if self.poses is None:
            return
        if not self.apply:
            raise InputError("--repaired-poses goes with --apply: without it nothing is repaired")
        session.check_writable(self.poses, force=outputs.force)
        taken = {Path(f).resolve() for f in [*inputs, *map(str, outputs.paths)]}
        if self.poses.resolve() in taken:
            raise InputError(f"{self.poses} is an input or another output of this command; give it a name of its own")


def run(request: hand_eye_data.Request, outputs: session.Outputs, repair: Repair) -> None:
    """Run the whole command. Raises: InputError, RefusedError; the latter also for faults that stand unrepaired."""
    from calibrant.data.verdicts import stamp
    from calibrant.diagnose.doctor.diagnosis import as_result
    from calibrant.diagnose.look import look

    data = hand_eye_data.read(request)
    with session.status("Examining the data …", quiet=request.quiet):
        diagnosis = hand_eye_data.diagnose(data, request)
    result = stamp(replace(as_result(diagnosis), inputs=session.file_records(data.files)))
    found = look(result)
    if not outputs.quiet and not outputs.json:
        from rich.console import Console

        from calibrant.reports.terminal import summary

        Console().print(summary(found))
    if repair.apply:
        result = repaired(diagnosis, data, request)
        if repair.poses is not None:
            session.write_bytes(repair.poses, csv_text(diagnosis.repaired.poses).encode())
    _write(result, found, outputs, repair)
    if not repair.apply:
        _require_sound(diagnosis)


def repaired(diagnosis: Diagnosis, data: hand_eye_data.PairedData, request: hand_eye_data.Request) -> CalibrationResult:
    """The hand-eye calibration of the repaired data; what was repaired is said as warnings.

    Raises: RefusedError for a fault that only a person can cure, and as the calibration does.
    """
    from calibrant.calibrate.cell.boards.turned import NAME
    from calibrant.data import Check, verdict_of
    from calibrant.diagnose.doctor.diagnosis import faults
    from calibrant.diagnose.doctor.repair import calibrate_repaired
    from calibrant.diagnose.review import review

    with session.status("Calibrating from the repaired data …", quiet=request.quiet):
        found = calibrate_repaired(diagnosis, model=request.model, fix=request.fix)
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
    return review(complete.with_detail(faults(diagnosis.findings)))


def _write(result: CalibrationResult, found: Look, outputs: session.Outputs, repair: Repair) -> None:
    """Write the result, and the page of what was found, also where it was repaired."""
    from calibrant.data.result_file import result_text

    if outputs.out is not None:
        result.write(outputs.out, force=outputs.force)
    if outputs.report is not None:
        from calibrant.reports.html import write_report

        write_report(found, outputs.report, force=outputs.force)
    if outputs.json:
        sys.stdout.write(result_text(result) + "\n")
    elif not outputs.quiet:
        written = [*outputs.paths, *([repair.poses] if repair.poses is not None else [])]
        if repair.apply:
            from rich.console import Console

            from calibrant.reports.terminal import summary

            Console().print(summary(result))
        if written:
            sys.stdout.write(f"\nWritten: {', '.join(str(p) for p in written)}\n")


def _require_sound(diagnosis: Diagnosis) -> None:
    failed = [f for f in diagnosis.findings if f.status == "fail"]
    if failed:
        names = ", ".join(dict.fromkeys(f.name for f in failed))
        cure = "; --apply calibrates from repaired data" if all(f.proposal for f in failed) else ""
        raise RefusedError(f"the data are not fit for calibration: {names}{cure}")


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
