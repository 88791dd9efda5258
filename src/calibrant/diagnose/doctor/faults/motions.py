"""Motions that leave something unobservable, by name, with the motion that would cure it."""

from __future__ import annotations

from calibrant.calibrate.solvers.motion import DEGENERATE, motion_report
from calibrant.diagnose.doctor.evidence.case import Case
from calibrant.diagnose.doctor.evidence.finding import Finding

ASKED = (*DEGENERATE, "small-rotations")
"""What the motions decide; whether robot and camera move alike is what the faults of the data are about."""


def examine(case: Case) -> list[Finding]:
    """Findings about the motions that are not in order."""
    report = motion_report(case.A, case.B, frame=case.setup.camera_parent)
    return [Finding(f.name, f.status, f.message) for f in report.findings if f.status != "ok" and f.name in ASKED]
