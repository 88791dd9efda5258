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
    from rich.console import RenderableType

    from calibrant.data import CalibrationResult, RobotPoses
    from calibrant.diagnose.doctor.diagnosis import Diagnosis

WORDS = {"ok": "noted", "warn": "warning", "fail": "FAULT"}
STYLES = {"ok": "", "warn": "yellow", "fail": "bold red"}


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
    from calibrant.diagnose.doctor.diagnosis import as_result

    data = hand_eye_data.read(request)
    with session.status("Examining the data …", quiet=request.quiet):
        diagnosis = hand_eye_data.diagnose(data, request)
    loud = not outputs.quiet and not outputs.json
    if loud:
        from rich.console import Console

        Console().print(summary(diagnosis))
    result = replace(as_result(diagnosis), inputs=session.file_records(data.files))
    if repair.apply:
        result = repaired(diagnosis, data, request)
        if repair.poses is not None:
            session.write_bytes(repair.poses, csv_text(diagnosis.repaired.poses).encode())
    _write(result, diagnosis, outputs, repair)
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


def _write(result: CalibrationResult, diagnosis: Diagnosis, outputs: session.Outputs, repair: Repair) -> None:
    from calibrant.data.result_file import result_text, write_text

    if outputs.out is not None:
        result.write(outputs.out, force=outputs.force)
    if outputs.report is not None:
        from calibrant.reports.doctor import render

        write_text(render(diagnosis), outputs.report, force=outputs.force)
    if outputs.json:
        sys.stdout.write(result_text(result) + "\n")
    elif not outputs.quiet:
        written = [*outputs.paths, *([repair.poses] if repair.poses is not None else [])]
        if repair.apply:
            from rich.console import Console

            from calibrant.reports.terminal import summary as result_summary

            Console().print(result_summary(result))
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


def summary(diagnosis: Diagnosis) -> RenderableType:
    """What was found, for a terminal: the worst first, each with its confidence and what to do."""
    from rich.console import Group
    from rich.padding import Padding
    from rich.text import Text

    parts: list[RenderableType] = [Text("Doctor", style="bold"), Text(diagnosis.poses.decision.message), Text()]
    for f in diagnosis.findings:
        heading = f"{WORDS[f.status]}  {f.name}  (confidence {_percent(f.confidence)})"
        parts.append(Text(heading, style=STYLES[f.status]))
        parts.append(Padding(Text(f.message), (0, 0, 0, 4)))
        if f.proposal:
            parts.append(Padding(Text(f"proposed: {f.proposal}"), (0, 0, 0, 4)))
    before, after = diagnosis.examination.before, diagnosis.examination.after
    if not diagnosis.findings:
        parts.append(Text("nothing wrong found", style="green"))
    if before is not None and after is not None:
        text = f"the loop closes to {before.text} rms"
        parts.append(Text(text if before == after else f"{text} as given, to {after.text} repaired"))
    return Group(*parts)


def _percent(value: float) -> str:
    """A confidence in per cent that is never rounded up to certainty."""
    return "> 99.9 %" if value > 0.999 else f"{100 * value:.1f} %"
