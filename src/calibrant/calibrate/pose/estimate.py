"""Target poses as a result: transforms camera -> target with their uncertainty, checks and verdict in words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.pose.both_solutions import (
    FEWEST_POINTS,
    UNKNOWNS,
    Poses,
    PoseSolution,
    ViewPose,
    Weakest,
    view_poses,
)
from calibrant.calibrate.reprojection.outliers import points_reason
from calibrant.cameras import Camera
from calibrant.data import (
    CalibrationResult,
    Check,
    Observations,
    TransformEstimate,
    View,
    ViewResult,
    as_transform,
    verdict_of,
)
from calibrant.data.verdicts import stamp
from calibrant.errors import InputError
from calibrant.optimize.chances import chi2_tail

CONFIDENCE = 0.99
SECOND = " (second solution)"
SAID = 1.5
"""How much wider sigma is for shared errors before it is said: by chance a view of many has 1.3."""
FEW_SPARE = 8
"""Spare values below which an estimated noise is itself unknown by more than a quarter: 1 / sqrt(2 nu)."""
SUSPICIOUS_RMS_PX = 2.0
"""Detectors locate points to well under 1 px: more is another camera, a wrong size in the spec, or a misread board."""
NO_FIT = 0.1
"""Residual over the target's extent in the image above which no pose fits: points are then mixed up, not noisy."""
NEIGHBOUR = 0.5
"""Residual over the distance of neighbouring points from which a point is as near to its neighbour's place."""
BY_CHANCE = 1e-4
"""How often noise as it was given would leave such residuals: one in ten thousand sets is no chance."""
LENS_SIGMAS = 4.0
"""What the camera's own uncertainty may leave in the residuals, in its sigmas, before they count against the noise."""
LEAST_ODDS = 20.0
"""Odds below which one of two poses is a guess, whatever confidence was asked for: wrong once in 21 pictures."""
ALONG_DEG, ACROSS_DEG = 20.0, 70.0


def estimate_poses(
    camera: Camera, observations: Observations, *, sigma_px: float | None = None, confidence: float = CONFIDENCE
) -> CalibrationResult:
    """Where the target is in every view of one camera: `pose.view_poses` as a result of kind "pose".

    sigma_px: noise of a point per axis, by default the detector's or that of the residuals; confidence: from which
    probability a pose is told from its second solution.
    The transform of the only view is camera -> target, of several camera -> target@VIEW; where two solutions cannot be
    told apart the other is there too, named "… (second solution)".
    Raises: InputError for two cameras, a confidence outside 0.5 to 1, no usable view, and as `view_poses`.
    """
    if not 0.5 < confidence < 1:
        raise InputError(f"confidence is a probability between 0.5 and 1, such as 0.99; got {confidence}")
    if len(observations.image_sizes) != 1:
        raise InputError(f"poses are of one camera, the observations have {', '.join(observations.image_sizes)}")
    ((name, image_size),) = observations.image_sizes.items()
    if image_size != camera.image_size:
        raise InputError(
            f"the camera is for images of {camera.image_size[0]}x{camera.image_size[1]} px, the images are "
            f"{image_size[0]}x{image_size[1]} px; use the camera of these images"
        )
    if camera.model.projection == "parallel":
        raise InputError(
            f"a {camera.model.name} camera sees no distance, so that a target has no pose to it; expected a camera "
            "whose rays meet"
        )
    usable = [v for v in observations.views if len(v) >= FEWEST_POINTS]
    if not usable:
        raise InputError(
            f"no view has {FEWEST_POINTS} points or more: "
            + ("; ".join(f"{v.id} has {len(v)}" for v in observations.views[:5]) or "no target was found")
        )
    poses = view_poses(camera, usable, sigma_px=sigma_px)
    checks = _pose_checks(camera, poses, confidence)
    total = sum(len(p.view) for p in poses.views)
    rms_px = float(np.sqrt(sum(len(p.view) * p.best.rms_px**2 for p in poses.views) / total))
    return stamp(
        CalibrationResult(
            kind="pose",
            verdict=verdict_of(checks),
            checks=checks,
            cameras={name: camera},
            transforms=_pose_transforms(name, poses, confidence),
            rms_px=rms_px,
            sigma_px=poses.sigma_px,
            views=_pose_views(observations.views, poses, confidence),
            options={"confidence": confidence} | ({} if sigma_px is None else {"sigma_px": sigma_px}),
            observations=observations,
        )
    )


def _pose_transforms(camera: str, poses: Poses, confidence: float) -> tuple[TransformEstimate, ...]:
    out = []
    for p in poses.views:
        child = "target" if len(poses.views) == 1 else f"target@{p.view.id}"
        out.append(as_transform(camera, child, p.best.T_camera_target, p.best.covariance))
        if p.other is not None and p.ambiguous(confidence):
            out.append(as_transform(camera, child + SECOND, p.other.T_camera_target, p.other.covariance))
    return tuple(out)


def _pose_views(views: Sequence[View], poses: Poses, confidence: float) -> tuple[ViewResult, ...]:
    known = {p.view.id: p for p in poses.views}
    out = []
    for view in views:
        p = known.get(view.id)
        if p is None:
            few = f"{len(view)} points, a pose needs {FEWEST_POINTS}"
            out.append(ViewResult(view.id, False, len(view), reason=few, camera=view.camera))
            continue
        words = [points_reason(p.left_out, len(view), poses.marked.limit_px)] if p.left_out else []
        if p.ambiguous(confidence):
            words.append(f"two poses fit, this one with probability {p.best.probability:.2g}")
        T = p.best.T_camera_target
        reason = "; ".join(words) or None
        out.append(ViewResult(view.id, True, len(p.view), p.best.rms_px, reason, view.camera, p.left_out, T))
    return tuple(out)


def _pose_checks(camera: Camera, poses: Poses, confidence: float) -> tuple[Check, ...]:
    return (
        _pose_fit_check(poses),
        _pose_noise_check(poses),
        _two_fold(poses, confidence),
        weakest_check(poses.views),
        _pose_camera_check(camera, poses),
    )


def _pose_fit_check(poses: Poses) -> Check:
    worst = max(poses.views, key=lambda p: p.best.rms_px)
    rms = worst.best.rms_px
    extent = float(np.hypot(*np.ptp(worst.view.uv, axis=0)))
    where = "" if len(poses.views) == 1 else f" in {worst.view.id}"
    text = f"the points are {rms:.2g} px rms from where the pose puts them{where}"
    if rms > NO_FIT * extent:
        return Check(
            "reprojection", "fail",
            f"{text}, of {extent:.0f} px that the target measures: no pose fits. Are the points in the right order, "
            "and is it the camera that took the image?", rms,
        )  # fmt: skip
    apart = _spacing(worst.view)
    if rms > SUSPICIOUS_RMS_PX and rms > NEIGHBOUR * apart:
        return Check(
            "reprojection", "fail",
            f"{text}, half of the {apart:.2g} px from a point to its neighbour or more: which point is which the fit "
            "does not show. Are the points in the right order, is it the camera that took the image, and has the "
            "target the rows and columns that were said?", rms,
        )  # fmt: skip
    if rms > SUSPICIOUS_RMS_PX:
        text += ", more than a detector's noise: check the target's size, its flatness, and whether the camera is right"
        return Check("reprojection", "warn", text, rms)
    return Check("reprojection", "ok", text, rms)


def _spacing(view: View) -> float:
    """Typical distance of a point to the nearest other one, px."""
    gaps = np.linalg.norm(view.uv[:, None] - view.uv, axis=2)
    np.fill_diagonal(gaps, np.inf)
    return float(np.median(gaps.min(axis=1)))


def _pose_noise_check(poses: Poses) -> Check:
    text = f"noise of a point {poses.sigma_px:.2g} px per axis"
    times = max(p.best.times for p in poses.views)
    if times > SAID:
        text += f" (neighbouring points err alike: sigma holds it, {times:.1f} times that of independent points)"
    if not poses.estimated:
        return _given_noise_check(f"{text}, as given", poses)
    stated = any(p.view.sigma_px is not None for p in poses.views)
    source = "by the detector and the residuals" if stated else f"by the residuals, {poses.spare} values to spare"
    if poses.spare < FEW_SPARE and not stated:
        return Check(
            "noise", "warn",
            f"{text}, {source}: too few for the uncertainty to be trusted; give the noise (--sigma-px), or more points",
            poses.sigma_px,
        )  # fmt: skip
    return Check("noise", "ok", f"{text}, {source}", poses.sigma_px)


def _given_noise_check(text: str, poses: Poses) -> Check:
    """Could noise of this size leave these residuals, with what the camera's uncertainty may add?"""
    chi2 = sum(p.best.chi2 for p in poses.views)
    of_noise = chi2 - LENS_SIGMAS**2 * sum(p.best.lens_chi2 for p in poses.views)
    if poses.spare < 1 or chi2_tail(poses.spare, max(of_noise, 0.0)) > BY_CHANCE:
        return Check("noise", "ok", text, poses.sigma_px)
    times = float(np.sqrt(chi2 / poses.spare))
    return Check(
        "noise", "warn",
        f"{text}, but the residuals are {times:.2g} times what it leaves: it is given too small. Leave "
        "--sigma-px out, so that the residuals count, and check the target's size and flatness and the camera",
        poses.sigma_px,
    )  # fmt: skip


def _two_fold(poses: Poses, confidence: float) -> Check:
    unclear = [p for p in poses.views if p.ambiguous(confidence)]
    least = min(p.best.probability for p in poses.views)
    guessed = [p for p in poses.views if p.ambiguous(LEAST_ODDS / (LEAST_ODDS + 1))]
    if guessed and not unclear:
        said = _doubts(guessed, poses.estimated)
        return Check(
            "second-solution", "warn",
            f"the likelier of two poses is given, as asked with {100 * confidence:g} % confidence, but the odds for it "
            f"are below {LEAST_ODDS:g} : 1 in {len(guessed)} of {len(poses.views)} views ({said}); ask for more "
            "(--confidence 0.99) to have both", least,
        )  # fmt: skip
    if not unclear:
        return Check("second-solution", "ok", _told_apart(poses), least)
    said = _doubts(unclear, poses.estimated)
    return Check(
        "second-solution", "warn",
        f"two poses fit {len(unclear)} of {len(poses.views)} views and cannot be told apart with "
        f"{100 * confidence:g} % confidence ({said}). Both are given, the likelier first; tilt the target, come "
        "nearer, or take a larger one", least,
    )  # fmt: skip


def _told_apart(poses: Poses) -> str:
    doubles = [p for p in poses.views if p.other is not None]
    if not doubles:
        return "no second pose fits"
    nearest = max(doubles, key=lambda p: p.other.probability if p.other else 0.0)
    other = nearest.other
    odds = other.probability if other else 0.0
    return f"the mirrored pose is ruled out: probability {odds:.1g} at most"


def _doubts(views: Sequence[ViewPose], estimated: bool) -> str:
    """Those of the first views."""
    return "; ".join(_doubt(p, estimated) for p in views[:3]) + ("; …" if len(views) > 3 else "")


def _doubt(p: ViewPose, estimated: bool) -> str:
    """Odds, how well each pose fits, and how far they are from each other."""
    other: PoseSolution = p.other or p.best
    R = p.best.T_camera_target[:3, :3].T @ other.T_camera_target[:3, :3]
    apart = np.rad2deg(np.arccos(np.clip((np.trace(R) - 1) / 2, -1, 1)))
    odds = p.best.probability / max(other.probability, 1e-12)
    fits = f"{p.best.rms_px:.2g} and {other.rms_px:.2g} px rms"
    if not estimated:
        fits += f", chi-square {p.best.chi2:.3g} and {other.chi2:.3g} with {2 * len(p.view) - UNKNOWNS} to spare"
    return f"{p.view.id}: odds {odds:.2g} : 1, {apart:.1f} deg apart; {fits}"


def weakest_check(views: Sequence[ViewPose]) -> Check:
    """Where the worst known of the poses is known worst, in words."""
    worst = max(views, key=lambda p: p.weakest.sigma_mm)
    w = worst.weakest
    where = "" if len(views) == 1 else f" in {worst.view.id}"
    return Check(
        "weakest", "ok",
        f"the target's middle is known worst{where} {_side(w)}, (x, y, z) = {_vector(w.direction)}: {w.sigma_mm:.2g} "
        f"mm (1 sigma); its rotation about {_vector(w.axis)}, {_turn_words(w)}: {w.sigma_deg:.2g} deg", w.sigma_mm,
    )  # fmt: skip


def _side(w: Weakest) -> str:
    if w.to_sight_deg < ALONG_DEG:
        return "along the line of sight"
    return (
        "across the line of sight" if w.to_sight_deg > ACROSS_DEG else f"{w.to_sight_deg:.0f} deg off the line of sight"
    )


def _turn_words(w: Weakest) -> str:
    if w.axis_to_sight_deg > ACROSS_DEG:
        return "a tilt"
    return "a turn about the line of sight" if w.axis_to_sight_deg < ALONG_DEG else "part tilt, part turn"


def _vector(v: Array) -> str:
    return f"({', '.join(f'{x:.2f}' for x in v)})"


def _pose_camera_check(camera: Camera, poses: Poses) -> Check:
    if camera.covariance is None:
        return Check(
            "camera", "warn",
            "the camera file states no uncertainty: sigmas are of the pixels' noise alone; the result of "
            "calibrant intrinsics --out has it",
        )  # fmt: skip
    shares = [
        float(np.trace(p.best.of_camera[3:, 3:]) / np.trace(p.best.covariance[3:, 3:]))
        for p in poses.views
        if p.best.of_camera is not None
    ]
    share = max(shares)
    return Check("camera", "ok", f"the camera's own uncertainty makes up to {100 * share:.0f} % of the variance", share)
