"""Errors of fresh views, each beside what the calibration predicts for a view that it never saw.

At robot poses: off = local(T predicted, T seen), its covariance that of the calibration, the robot's pose and the
corners (`watch.placed`). Without a robot the lens alone is asked: what a pose of the view's own leaves, against the
noise that the calibration states.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, Check, HeldOut, Measured, Observations, ViewResult, verdict_of
from calibrant.data.details import TaskRun, TaskRuns
from calibrant.data.verdicts import stamp
from calibrant.geometry import se3, so3
from calibrant.optimize.chances import chi2_tail
from calibrant.verification.runs import run_checks, unreachable_tolerance
from calibrant.verification.touch.errors import CHI2_3_95, chi2_at, radius_95
from calibrant.verification.watch.placed import PlacedView
from calibrant.verification.watch.sequential import Sight

CONTRADICTS = 1e-3
"""Chance of errors as large from which on the calibration does not hold for these views."""


@dataclass(frozen=True, eq=False)
class HeldView:
    """A fresh view: errors px (rms per point), mm (of the target's middle, in the camera) and deg, None where there
    is no robot to predict a pose; predicted: what each stays below with 95 %; inside: its 95 % region."""

    name: str
    points: int
    px: float
    predicted_px: float
    mm: float
    predicted_mm: float
    deg: float | None = None
    predicted_deg: float | None = None
    inside: bool | None = None


def at_poses(camera: Camera, placed: Sequence[PlacedView], sights: Sequence[Sight]) -> tuple[HeldView, ...]:
    """Views at robot poses."""
    return tuple(_at_pose(camera, one, sight) for one, sight in zip(placed, sights))


def _at_pose(camera: Camera, one: PlacedView, sight: Sight) -> HeldView:
    points, T_seen = one.view.points, one.T_camera_target
    T = se3.retract(T_seen, -sight.off)
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    arm = T_seen[:3, :3] @ middle
    J = np.concatenate([-so3.hat(arm), np.eye(3)], axis=1)
    C = sight.covariance + sight.of_calibration @ sight.of_calibration.T + sight.of_place @ sight.of_place.T
    shift, S = J @ sight.off, J @ C @ J.T
    rotated = points @ T[:3, :3].T
    uv, J_point, _ = camera.model.project_with_jacobians(camera.values, rotated + T[:3, 3])
    J_px = np.concatenate([-J_point @ so3.hat(rotated), J_point], axis=-1)
    of_pose = float(np.einsum("nai,ij,naj->", J_px, C - sight.covariance, J_px)) / len(points)
    noise = 0.0 if one.view.sigma_px is None else float(np.mean(one.view.sigma_px**2))
    squares = np.sum((uv - one.view.uv) ** 2, axis=1)
    # The pose's six numbers move all points together: a mean of so few is spread as chi-square of six is.
    limit = chi2_at(0.95, 6.0) / 6.0
    return HeldView(
        one.view.id,
        len(points),
        float(np.sqrt(squares.mean())),
        float(np.sqrt(of_pose * limit + 2 * noise)),
        1e3 * float(np.linalg.norm(shift)),
        1e3 * radius_95(S),
        float(np.rad2deg(np.linalg.norm(sight.off[:3]))),
        float(np.rad2deg(radius_95(C[:3, :3]))),
        float(shift @ np.linalg.solve(S, shift)) <= CHI2_3_95,
    )


def by_lens(camera: Camera, placed: Sequence[PlacedView], sigma_px: float) -> tuple[tuple[HeldView, ...], float, int]:
    """Views without a robot, with chi-square and its freedom over all of them."""
    out, total, freedom = [], 0.0, 0
    for one in placed:
        n = len(one.view)
        squares = np.sum(one.view.residuals(camera, one.T_camera_target) ** 2, axis=1)
        spare = max(2 * n - 6, 1)
        rms = float(np.sqrt(squares.mean()))
        limit = sigma_px * float(np.sqrt(chi2_at(0.95, spare) / n))
        middle = one.T_camera_target[:3, :3] @ one.view.points.mean(axis=0) + one.T_camera_target[:3, 3]
        mm_per_px = 1e3 * float(middle[2]) / float(camera.parameters["fx"])
        out.append(HeldView(one.view.id, n, rms, limit, rms * mm_per_px, limit * mm_per_px, inside=rms <= limit))
        total += float(squares.sum()) / sigma_px**2
        freedom += spare
    return tuple(out), total, freedom


def held_out_result(
    views: Sequence[HeldView],
    chi2: tuple[float, int],
    *,
    tolerance_mm: float | None = None,
    tolerance_px: float | None = None,
    observations: Observations | None = None,
) -> CalibrationResult:
    """The result of kind "held-out": its check of that name fails where an error is above the tolerance."""
    runs = TaskRuns("held-out", "camera", tuple(_run(v, tolerance_mm, tolerance_px) for v in views), tolerance_mm)
    chance = chi2_tail(chi2[1], chi2[0])
    text = f"chi-square {chi2[0]:.0f} of {chi2[1]}: errors as large have a chance of {chance:.2g} by what is stated"
    bad = chance < CONTRADICTS
    if bad:
        text += "; the calibration is less certain than it says, or something has changed since"
    words = unreachable_tolerance(float(np.median([v.predicted_mm for v in views])), tolerance_mm)
    checks = (
        *run_checks(runs),
        Check("chi-square", "warn" if bad else "ok", text, chance),
        *(() if words is None else (Check("tolerance", "warn", words),)),
    )
    rms = {n: _rms([getattr(v, n) for v in views]) for n in ("px", "mm", "deg")}
    limits = {n: _rms([getattr(v, f"predicted_{n}") for v in views]) for n in rms}
    figures = {f"rms {n}": Measured(v, unit=n) for n, v in rms.items() if v is not None}
    figures |= {f"predicted {n} (95 %)": Measured(v, unit=n) for n, v in limits.items() if v is not None}
    return stamp(
        CalibrationResult(
            "held-out",
            verdict_of(checks),
            checks=checks,
            held_out=HeldOut(rms["mm"], rms["deg"], rms["px"]),
            figures=figures,
            views=tuple(ViewResult(v.name, True, v.points, v.px) for v in views),
            details=(runs,),
            observations=observations,
        )
    )


def _run(view: HeldView, tolerance_mm: float | None, tolerance_px: float | None) -> TaskRun:
    reasons = []
    if tolerance_mm is not None and view.mm > tolerance_mm:
        reasons.append(f"{view.mm:.2f} mm off, more than the tolerance of {tolerance_mm:g} mm")
    if tolerance_px is not None and view.px > tolerance_px:
        reasons.append(f"{view.px:.2f} px off, more than the tolerance of {tolerance_px:g} px")
    remark = "; ".join(reasons) or f"{view.px:.3f} px (95 %: {view.predicted_px:.3f})"
    return TaskRun(
        view.name,
        not reasons,
        view.mm,
        view.predicted_mm,
        view.inside,
        turned_deg=view.deg,
        predicted_95_deg=view.predicted_deg,
        reason=remark,
    )


def _rms(values: Sequence[float | None]) -> float | None:
    known: Array = np.array([v for v in values if v is not None])
    return float(np.sqrt(np.mean(known**2))) if len(known) == len(values) and len(known) else None
