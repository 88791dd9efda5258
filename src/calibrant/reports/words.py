"""What a result says in words: the verdict in one line, the views and why each was used or not."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite

from calibrant.data import CalibrationResult, Check, TransformEstimate, ViewResult
from calibrant.diagnose.residuals import camera_of
from calibrant.reports.figures import camera_figures, camera_transforms, is_point, rows_name, translation_figures
from calibrant.reports.numbers import plain, sigma_text

STATUS_WORDS = {"ok": "ok", "warn": "warning", "fail": "FAILED"}
VERDICT_WORDS = {"ok": "GOOD", "warn": "USE WITH CARE", "refused": "DO NOT USE"}
KIND_TITLES = {
    "intrinsics": "Camera calibration",
    "hand-eye": "Hand-eye calibration",
    "rig": "Rig calibration",
    "doctor": "What the doctor says",
    "kinematics": "Kinematic calibration",
    "time-offset": "Time offset between camera and robot",
    "tool": "Tool calibration",
    "dynamic": "Dynamic calibration",
    "self-visibility": "Hand camera by self-visibility",
    "pose": "Target pose",
    "vanishing": "Rotation from vanishing points",
}

_SEVERITY = {"fail": 0, "warn": 1, "ok": 2}


@dataclass(frozen=True)
class ViewRow:
    """One image of the data set: whether it was used, its error, and the reason where it was left out or flagged."""

    id: str
    camera: str
    used: bool
    points: int
    points_left_out: int
    rms_px: float | None
    reason: str

    @property
    def status(self) -> str:
        """ "used", "used, flagged" or "left out"."""
        if not self.used:
            return "left out"
        return "used, flagged" if self.reason else "used"


def title(result: CalibrationResult) -> str:
    """What kind of result this is."""
    return KIND_TITLES.get(result.kind, f"Calibration: {result.kind}")


def view_rows(result: CalibrationResult) -> list[ViewRow]:
    """Every image in order: the views of the result, then the images in which no target was found."""
    rows = [_row(view, camera_of(result, view)) for view in result.views]
    known = {(row.camera, row.id) for row in rows}
    for missed in result.observations.missed if result.observations else ():
        if (missed.camera, missed.id) not in known:
            rows.append(ViewRow(missed.id, missed.camera, False, 0, 0, None, missed.reason))
    return rows


def sorted_checks(result: CalibrationResult) -> list[Check]:
    """The checks, the worst first."""
    return sorted(result.checks, key=lambda check: _SEVERITY[check.status])


def verdict_sentence(result: CalibrationResult) -> str:
    """The verdict in one sentence: what to do with the result and the reason that matters most."""
    failed = [c for c in result.checks if c.status == "fail"]
    warned = [c for c in result.checks if c.status == "warn"]
    if result.verdict == "refused":
        reason = failed[0].message if failed else "the data cannot determine the result."
        return f"{_sentence(reason)}{_more(len(failed) - 1, 'failed check')}"
    if result.verdict == "warn":
        reason = f" {_sentence(warned[0].message)}" if warned else ""
        return f"{_accuracy(result)}{reason}{_more(len(warned) - 1, 'warning')}"
    return f"{_accuracy(result)} {_passed(result)}".strip()


def _accuracy(result: CalibrationResult) -> str:
    if result.kind == "vanishing" and result.transforms and result.transforms[0].sigma_rotation_deg is not None:
        return f"The rotation is known to {sigma_text(float(result.transforms[0].sigma_rotation_deg.max()))} deg (1σ)."
    offset = result.figures.get("offset")
    if offset is not None and isfinite(offset.sigma):
        return f"The offset is known to {sigma_text(1e3 * offset.sigma)} ms (1σ)."
    if result.kind == "kinematics" and result.held_out is not None and result.held_out.mm is not None:
        return f"Poses kept out of the fit are met to {plain(result.held_out.mm, digits=2)} mm rms."
    if result.kind in ("hand-eye", "pose", "tool", "dynamic", "self-visibility") and result.transforms:
        known = [text for text in map(_known_to, camera_transforms(result)) if text]
        if known:
            return f"{', '.join(known)} (1σ, worst axis)."
    if result.cameras:
        figures = [f for f in camera_figures(next(iter(result.cameras.values()))) if f.sigma]
        focal = [f for f in figures if f.name in ("fx", "fy", "f")]
        if focal:
            f = focal[0]
            return f"{f.name} is known to {plain(100 * f.sigma / f.value, digits=2)} % (1σ)." if f.sigma else ""
    return "Done."


def _known_to(estimate: TransformEstimate) -> str:
    """How well a transform is known; empty where that is not stated."""
    known = [f.sigma for f in translation_figures(estimate) if f.sigma is not None]
    turns = estimate.sigma_rotation_deg
    if not known or turns is None:
        return ""
    if is_point(estimate):
        return f"{estimate.parent} → {estimate.child} is known to {sigma_text(max(known))} mm"
    return (
        f"{estimate.parent} → {estimate.child} is known to {sigma_text(max(known))} mm and "
        f"{sigma_text(float(turns.max()))} deg"
    )


def _passed(result: CalibrationResult) -> str:
    rows, used = view_rows(result), sum(row.used for row in view_rows(result))
    views = f"{used} of {len(rows)} {rows_name(result)} used" if rows else ""
    checks = "every check passed" if result.checks else ""
    text = ", ".join(part for part in (views, checks) if part)
    return f"{text[:1].upper()}{text[1:]}." if text else ""


def _row(view: ViewResult, camera: str) -> ViewRow:
    return ViewRow(view.id, camera, view.used, view.points, view.points_left_out, view.rms_px, view.reason or "")


def _sentence(text: str) -> str:
    text = text.strip()
    text = f"{text[:1].upper()}{text[1:]}"
    return text if text.endswith((".", "!", "?")) else f"{text}."


def _more(count: int, noun: str) -> str:
    return f" (And {count} more {noun}{'s' if count > 1 else ''}: see the checks.)" if count > 0 else ""
