"""Checks of an intrinsic calibration that its own figures answer: is the camera determined, do the views agree?"""

from __future__ import annotations

import statistics
from collections.abc import Sequence

import numpy as np

from calibrant.calibrate.reprojection.held import ASPECT, GROUPS, expand_fix
from calibrant.calibrate.reprojection.outliers import Marked
from calibrant.cameras import Camera, CameraModel
from calibrant.data import Check, View, ViewResult
from calibrant.errors import RefusedError
from calibrant.optimize.solution import Solution
from calibrant.percent import percent

FEW_VIEWS = 10
"""Below this the residuals say little about whether the model fits: the poses absorb too much of them."""
FOCAL_WARN, FOCAL_FAIL = 0.01, 0.10
"""Relative 1 sigma of the focal length: distances are off by as much. 1 % is 10 mm at 1 m; 10 % is no calibration."""
SUSPICIOUS_RMS_PX = 1.0
"""Detectors locate points to a few tenths of a pixel even in poor photos; more is a wrong model or a wrong target."""
OUTLIER_WARN = 0.02
VIEW_WARN_RATIO = 3.0
"""A view whose rms is 3 times the typical one lies beyond the spread of chi for 10 points and more."""


CONDITIONS_PER_VIEW = 2
"""What one view of a plane says about focal lengths and principal point (Zhang 2000, section 2.3)."""


MINIMUM_COMMON = 4
"""Points by which two views of a plane are told apart or not."""
STILL_PX = 1.0
"""A board whose points lie within this of where another view has them, rms, was not moved in between: it repeats."""


FOCAL = "focal-length"


def require_conditions(views: Sequence[View], model: CameraModel, fix: Sequence[str]) -> None:
    """Refuse views too few for the focal lengths and the principal point that are free. Repeated views count once.

    Distortion would make up the missing conditions: the fit converges, with figures that rest on the lens model alone.
    Raises: RefusedError naming what is missing.
    """
    held, aspect = expand_fix(fix, model)
    free = [n for group in ("focal", "principal") for n in GROUPS[group] if n not in held]
    unknowns = len(free) - (aspect and {"fx", "fy"} <= set(free))
    distinct = _distinct(views, -(-unknowns // CONDITIONS_PER_VIEW))
    if CONDITIONS_PER_VIEW * distinct < unknowns:
        repeated = f" ({len(views)} given, the others show the board where it was)" if len(views) > distinct else ""
        raise RefusedError(
            f"views: {distinct} usable view{'s' if distinct != 1 else ''}{repeated} cannot determine "
            f"{', '.join(free)}: a view of a flat target gives {CONDITIONS_PER_VIEW} conditions, {unknowns} are "
            f"needed; take more, better 10 to 20, tilted in different directions, or fix some: --fix principal,{ASPECT}"
        )


def _distinct(views: Sequence[View], enough: int) -> int:
    """How many views show the board in a place of its own; not counted further than `enough`."""
    found: list[View] = []
    for view in views:
        if len(found) == enough:
            break
        if not any(_same_place(view, other) for other in found):
            found.append(view)
    return len(found)


def _same_place(view: View, other: View) -> bool:
    common, a, b = np.intersect1d(view.point_ids, other.point_ids, return_indices=True)
    if len(common) < MINIMUM_COMMON:
        return False
    return float(np.sqrt(np.mean(np.sum((view.uv[a] - other.uv[b]) ** 2, axis=1)))) < STILL_PX


def intrinsics_checks(
    camera: Camera, solution: Solution, views: Sequence[ViewResult], rms_px: float, marked: Marked
) -> tuple[Check, ...]:
    """All checks, in the order a person would ask."""
    return (
        _convergence(solution),
        _kept_views_check(views),
        focal_length_check(camera),
        _reprojection(camera, rms_px),
        _outliers(views, marked),
        _agreement_check(views),
    )


def _convergence(solution: Solution) -> Check:
    message = f"{solution.message} ({solution.iterations} steps)"
    return Check("convergence", "ok" if solution.converged else "fail", message, float(solution.iterations))


def _kept_views_check(views: Sequence[ViewResult]) -> Check:
    used = sum(v.used for v in views)
    text = f"{used} of {len(views)} views used"
    if used < FEW_VIEWS:
        return Check(
            "views", "warn", f"{text}; {FEW_VIEWS} or more, tilted in different directions, make it reliable", used
        )
    return Check("views", "ok", text, used)


def focal_length_check(camera: Camera) -> Check:
    """How well the focal length is known, and what to do where that is not well enough."""
    relative = _focal_uncertainty(camera)
    text = _focal_text(relative)
    if relative > FOCAL_FAIL:
        return Check(FOCAL, "fail", f"{text}: the views do not determine it; tilt the board 20 to 45 degrees", relative)
    if relative > FOCAL_WARN:
        return Check(FOCAL, "warn", f"{text}; more views with the board tilted would make it sharper", relative)
    return Check(FOCAL, "ok", text, relative)


def focal_length_with_faults(camera: Camera, fitted: Camera) -> Check | None:
    """The check for a camera whose sigma was made to hold what the review found; None where it holds no more.

    Args: fitted, the camera as the fit stated it. What the faults add no tilted view cures: they are to be.
    """
    relative, alone = _focal_uncertainty(camera), _focal_uncertainty(fitted)
    if relative <= alone or alone > FOCAL_FAIL:
        return None  # nothing was added, or the views do not tell it anyway
    text = f"{_focal_text(relative)}, to {percent(alone)} beside what the other checks name"
    if relative <= FOCAL_WARN:
        return Check(FOCAL, "ok", text, relative)
    return Check(FOCAL, "warn", f"{text}: cure that first", relative)


def _focal_text(relative: float) -> str:
    return f"the focal length is known to {percent(relative)} (1 sigma)"


def _reprojection(camera: Camera, rms_px: float) -> Check:
    text = f"the points are {rms_px:.2g} px rms from where the camera sees them"
    if rms_px > SUSPICIOUS_RMS_PX:
        message = (
            f"{text}, more than a detector's noise: the {camera.model.name} model does not describe this lens, or the "
            "target is not flat or not the one given"
        )
        return Check("reprojection", "warn", message, rms_px)
    return Check("reprojection", "ok", text, rms_px)


def _focal_uncertainty(camera: Camera) -> float:
    """Relative 1 sigma of the focal length at the axis, f = du / d(x/z), larger one of both image axes.

    It is fx itself for perspective models. Others share it between fx and their terms, which may trade against each
    other freely: sigma^2 = g^T C g with g = df / d parameters = d(d pixel / d parameters) / d(x/z), by central
    differences along x and y: two points each, however many parameters.
    """
    if camera.model.projection == "perspective" or camera.covariance is None:
        sigma, values = camera.sigma, camera.parameters
        return max(sigma[n] / values[n] for n in ("fx", "fy"))
    step = 1e-5  # the error of the difference is h^2 = 1e-10 and eps / h = 2e-11, relative
    points = np.array([[step, 0, 1], [-step, 0, 1], [0, step, 1], [0, -step, 1]])
    J = camera.model.project_with_jacobians(camera.values, points)[2]
    g = np.stack([J[0, 0] - J[1, 0], J[2, 1] - J[3, 1]]) / (2 * step)
    focal = np.diagonal(camera.model.project_with_jacobians(camera.values, [0.0, 0.0, 1.0])[1][:, :2])
    return float(np.max(np.sqrt(np.einsum("ik,kl,il->i", g, camera.covariance, g)) / focal))


def _outliers(views: Sequence[ViewResult], marked: Marked) -> Check:
    points = sum(v.points + v.points_left_out for v in views)
    lost = sum(v.points_left_out for v in views) + sum(v.points for v in views if not v.used)
    share = lost / points
    if lost == 0:
        return Check("outliers", "ok", "no point had to be left out", 0.0)
    text = f"{lost} of {points} points left out (limit {marked.limit_px:.2g} px)"
    if share > OUTLIER_WARN:
        return Check(
            "outliers", "warn", f"{text}; look at the views that lost points: blur, glare or a misread board", share
        )
    return Check("outliers", "ok", text, share)


def _agreement_check(views: Sequence[ViewResult]) -> Check:
    rms = {v.id: v.rms_px for v in views if v.used and v.rms_px is not None}
    typical, worst = statistics.median(rms.values()), max(rms, key=rms.__getitem__)
    ratio = rms[worst] / typical if typical > 1e-9 else 1.0
    text = f"the worst view, {worst}, has {rms[worst]:.2g} px rms; the typical one {typical:.2g} px"
    return Check("view-agreement", "warn" if ratio > VIEW_WARN_RATIO else "ok", text, ratio)
