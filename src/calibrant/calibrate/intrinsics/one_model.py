"""Intrinsic calibration with one camera model: its parameters from views of a target.

Closed-form start (Zhang 2000), then every parameter and every pose in one least-squares problem

    min sum_ij |project(theta, T_camera_target_i p_j) - uv_ij|^2 / sigma^2,

solved once on all points, judged, and solved again without what does not belong. The noise is estimated from the
residuals, sigma^2 = sum r^2 / (2 N - unknowns); the covariance is the inverse of the normal matrix times it, and what
the points of a view, a dot of the board and a place in the image share (see `shared_errors`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.calibrate.classical import planar as planar_start
from calibrant.calibrate.classical.planar import PlaneViews
from calibrant.calibrate.intrinsics.checks import intrinsics_checks, require_conditions
from calibrant.calibrate.intrinsics.fit import ORDINARY, Fit, Start, Stopping, fit_and_clean, refine
from calibrant.calibrate.intrinsics.linearity import better_of_two, linearity_check
from calibrant.calibrate.intrinsics.rolling_fit import GLOBAL, Moving, moving_fit
from calibrant.calibrate.intrinsics.rolling_motions import with_motions
from calibrant.calibrate.intrinsics.shaped_fit import shaped_fit
from calibrant.calibrate.intrinsics.shared_errors import shared_errors, shared_errors_check
from calibrant.calibrate.intrinsics.target_shape import FLAT, with_noise
from calibrant.calibrate.intrinsics.wide_lens import model_check, refuse_wide_lens
from calibrant.calibrate.reprojection.factor import StackedViews, stack
from calibrant.calibrate.reprojection.held import expand_fix
from calibrant.calibrate.reprojection.outliers import MINIMUM_POINTS, Marked, median, view_reason
from calibrant.calibrate.reprojection.view_results import fitted_view, unused_view
from calibrant.calibrate.starts import any_lens as camera_start
from calibrant.calibrate.starts import with_depth as spatial_start
from calibrant.calibrate.starts.with_depth import SolidViews, see_target
from calibrant.cameras import Camera, CameraModel
from calibrant.data import CalibrationResult, Observations, View, ViewResult, verdict_of
from calibrant.data.details import BentTarget, FreeTarget
from calibrant.data.verdicts import refuse_if_failed, stamp
from calibrant.errors import CalibrantError, InputError, RefusedError
from calibrant.geometry import se3
from calibrant.optimize.solution import Solution

FOCAL_LENGTH_GRID = (0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0, 8.0)
"""Focal lengths to try, in image widths, when the views do not show theirs: 90 to 7 degrees of view."""

MOST_NAMED = 3
"""Views that an error names; more would hide what it says."""


@dataclass(frozen=True, eq=False)
class Kept:
    """A calibrated camera, the fit behind it, and the views it rests on, without the points that were left out."""

    result: CalibrationResult
    views: tuple[View, ...]
    stacked: StackedViews
    solution: Solution


def calibrate_keeping(
    observations: Observations,
    *,
    model: str = "brown",
    fix: Sequence[str] = (),
    initial: Camera | None = None,
    max_error_px: float | None = None,
    target_shape: str = FLAT,
    shutter: str = GLOBAL,
    stop: Stopping = ORDINARY,
) -> Kept:
    """`calibrate_intrinsics` of one model for problems that go on with the same views: the result, and what it kept."""
    kind = camera_start.model_for(model, observations)
    expand_fix(fix, kind)
    if len(observations.image_sizes) != 1:
        raise InputError(
            f"intrinsic calibration takes one camera, the observations have {len(observations.image_sizes)}: "
            f"{', '.join(observations.image_sizes)}; choose one with observations.of_camera(name)"
        )
    ((camera_name, image_size),) = observations.image_sizes.items()
    views, too_small = _enough_points(observations.views)
    if views:
        stacked = stack(views)
        seen = see_target(stacked)
        if not seen.good.all():
            views, on_a_line = _without(views, seen.good)
            too_small |= on_a_line
            stacked, seen = (stack(views), seen.only(stacked, seen.good)) if views else (stacked, seen)
    if not views:
        raise InputError(
            f"there is no view with {MINIMUM_POINTS} points or more, not all on a line, to calibrate from "
            f"({_why_no_view(observations, too_small)})"
        )
    if isinstance(seen, PlaneViews):
        require_conditions(views, kind, fix)
    try:
        start = find_start(stacked, seen, kind, image_size, initial=initial, fix=fix)
        views, stacked, start, unseen = _in_sight(views, stacked, start, kind)
        too_small |= unseen
        fit, marked = fit_and_clean(views, stacked, start, kind, fix, max_error_px, stop=stop)
        fit = better_of_two(fit, kind, fix)
    except CalibrantError:
        refuse_wide_lens(kind, stacked, image_size)
        raise
    shape: BentTarget | FreeTarget | None = None
    if target_shape != FLAT:
        fit, marked, shape = shaped_fit(views, start, fit, marked, kind, fix, max_error_px, shape=target_shape)
    moving: Moving | None = None
    if shutter != GLOBAL:
        moving, marked = moving_fit(views, fit, kind, height=image_size[1], max_error_px=max_error_px, stop=stop)
        fit = moving.fit
    result = _intrinsics_result(
        observations, camera_name, image_size, kind, fix, fit, marked, too_small, max_error_px, initial
    )
    if shape is not None:
        options = {**result.options, "target_shape": target_shape}
        result = replace(result, options=options).with_detail(with_noise(shape, result.sigma_px or 0.0))
    if moving is not None:
        result = with_motions(result, moving, kind, height=image_size[1])
    return Kept(result, fit.views, fit.stacked, fit.solution)


def _why_no_view(observations: Observations, reasons: dict[str, str]) -> str:
    """What each view lacks: the first few by name, the others counted."""
    said = [f"{name}: {reason}" for name, reason in list(reasons.items())[:MOST_NAMED]]
    if len(reasons) > MOST_NAMED:
        said.append(f"{len(reasons) - MOST_NAMED} more views like these")
    if observations.missed:
        said.append(f"{len(observations.missed)} images without a board")
    return "; ".join(said) or "no views were given"


def _enough_points(views: Sequence[View]) -> tuple[tuple[View, ...], dict[str, str]]:
    """Views with points enough for a pose, and the reasons for the others."""
    few = {v.id: f"{len(v)} points, a pose needs {MINIMUM_POINTS}" for v in views if len(v) < MINIMUM_POINTS}
    return tuple(v for v in views if v.id not in few) if few else tuple(views), few


def _without(views: Sequence[View], good: NDArray[np.bool_]) -> tuple[tuple[View, ...], dict[str, str]]:
    """Views that determine a homography, and the reasons for the others."""
    reasons = {
        v.id: f"its {len(v)} points lie on a line, which determines no pose" for v, ok in zip(views, good) if not ok
    }
    return tuple(v for v, ok in zip(views, good) if ok), reasons


def _in_sight(
    views: tuple[View, ...], stacked: StackedViews, start: Start, kind: CameraModel
) -> tuple[tuple[View, ...], StackedViews, Start, dict[str, str]]:
    """Views all of whose points the camera of the start can see, and the reasons for the others; all of them where it
    is not a few, for then the start is to blame."""
    edge = np.repeat(np.arange(len(views)), np.diff(stacked.offsets))
    p = se3.apply(start.T_camera_target[edge], stacked.points)
    good = np.logical_and.reduceat(kind.sees(start.parameters, p), stacked.offsets[:-1])
    if good.all() or 2 * int(good.sum()) <= len(views):
        return views, stacked, start, {}
    reasons = {
        v.id: "no pose of the board has all its points before the camera" for v, ok in zip(views, good) if not ok
    }
    kept = tuple(v for v, ok in zip(views, good) if ok)
    return kept, stack(kept), Start(start.parameters, start.T_camera_target[good]), reasons


def find_start(
    views: StackedViews,
    seen: PlaneViews | SolidViews,
    kind: CameraModel,
    image_size: tuple[int, int],
    *,
    initial: Camera | None,
    fix: Sequence[str],
) -> Start:
    """Closed-form start: from `initial` when given, else by how the model's rays lie.

    Perspective: Zhang's, else the best of a grid of focal lengths. All around or parallel: see `camera_start`. Targets
    with depth: see `spatial_start`.
    """
    if isinstance(seen, SolidViews):
        if initial is None:
            _refuse_unknown_focal_length(kind, fix)
        return Start(*spatial_start.start_parameters(views, kind, image_size, initial=initial))
    if initial is not None:
        parameters = camera_start.transferred(initial, kind, views.uv)
        if kind.projection == "parallel":  # whose rays meet nowhere and make no homography
            _, T = camera_start.parallel_start(seen.xy, views.uv, views.offsets, image_size)
            return Start(parameters, T @ seen.T_plane_target)
        T, _ = camera_start.poses_of_rays(seen.xy, camera_start.rays_of(kind, parameters, views.uv), views.offsets)
        return Start(parameters, T @ seen.T_plane_target)
    _refuse_unknown_focal_length(kind, fix)
    if kind.projection != "perspective":
        parameters, T = camera_start.start_parameters(kind, seen.xy, views.uv, views.offsets, image_size)
        return Start(parameters, T @ seen.T_plane_target)
    centre = (np.array(image_size, dtype=np.float64) - 1) / 2
    focal = planar_start.focal_lengths(seen.H, centre)
    if focal is not None:
        if expand_fix(fix, kind)[1]:
            # The ratio that is held is that of the start: square pixels, unless `initial` says otherwise.
            focal = (float(np.sqrt(focal[0] * focal[1])),) * 2
        return _start_at(kind, seen, focal, centre)
    return _best_of_grid(views, seen, kind, image_size, centre, fix)


def _refuse_unknown_focal_length(kind: CameraModel, fix: Sequence[str]) -> None:
    held = set(expand_fix(fix, kind)[0]) - set(kind.gauge)
    if {"fx", "fy"} & held:
        raise InputError("to fix the focal length, give its value: --initial camera.json")


def _best_of_grid(
    views: StackedViews,
    seen: PlaneViews,
    kind: CameraModel,
    image_size: tuple[int, int],
    centre: Array,
    fix: Sequence[str],
) -> Start:
    """The start with the lowest cost after refinement, over a grid of focal lengths."""
    best: tuple[float, Start] | None = None
    for widths in FOCAL_LENGTH_GRID:
        f = widths * max(image_size)
        start = _start_at(kind, seen, (f, f), centre)
        cost = refine(views, kind, start, fix=fix).cost
        if best is None or cost < best[0]:
            best = (cost, start)
    if best is None:
        raise RefusedError("no focal length gives a start; the views do not fit a perspective camera")
    return best[1]


def _start_at(kind: CameraModel, seen: PlaneViews, focal: tuple[float, float], centre: Array) -> Start:
    parameters = np.zeros(len(kind.parameter_names))
    for name, value in (("fx", focal[0]), ("fy", focal[1]), ("cx", centre[0]), ("cy", centre[1])):
        parameters[kind.index(name)] = value
    K = np.array([[focal[0], 0, centre[0]], [0, focal[1], centre[1]], [0, 0, 1.0]])
    return Start(parameters, planar_start.poses(seen.H, K) @ seen.T_plane_target)


def _intrinsics_result(
    observations: Observations,
    camera_name: str,
    image_size: tuple[int, int],
    kind: CameraModel,
    fix: Sequence[str],
    fit: Fit,
    marked: Marked,
    too_small: dict[str, str],
    max_error_px: float | None,
    initial: Camera | None,
) -> CalibrationResult:
    if spatial_start.is_flat(fit.stacked.points):
        require_conditions(fit.views, kind, fix)
    solution = fit.solution
    residuals = solution.residuals("reprojection")
    squares = np.sum(residuals**2, axis=1)
    weighted = squares / fit.stacked.sigma**2
    unknowns = solution.problem.free_count - fit.gauge_equations
    freedom = 2 * len(squares) - unknowns
    if freedom <= 0:
        raise RefusedError(
            f"{len(squares)} points cannot determine {unknowns} unknowns ({len(fit.views)} views); take more views, "
            "or fix parameters"
        )
    if solution.unobservable:
        refuse_wide_lens(kind, fit.stacked, image_size)
        raise RefusedError(
            "the views cannot determine the camera: "
            + "; ".join(u.message for u in solution.unobservable[:3])
            + ". Tilt the board 20 to 45 degrees in different directions, or fix these parameters"
        )
    sigma_px = float(np.sqrt(weighted.sum() / freedom))
    covariance, shared = shared_errors(solution, kind, fit.views, fit.stacked, image_size=image_size, sigma_px=sigma_px)
    camera = Camera(kind, image_size, solution.value("camera")[0], covariance)
    rms_px = float(np.sqrt(squares.mean()))
    view_results = _intrinsics_views(observations.views, fit, marked, too_small, squares)
    checks = (
        *intrinsics_checks(camera, solution, view_results, rms_px, marked),
        shared_errors_check(shared),
        # Where points err alike it takes that much more noise to move the camera as far.
        linearity_check(camera, fit.stacked, solution.value("T_camera_target"), sigma_px * shared.times),
        *fit.checks,
        *model_check(camera, fit.stacked, rms_px),
    )
    result = stamp(
        CalibrationResult(
            kind="intrinsics",
            verdict=verdict_of(checks),
            checks=checks,
            cameras={camera_name: camera},
            rms_px=rms_px,
            sigma_px=sigma_px,
            views=view_results,
            options=_options(kind, fix, max_error_px, initial),
            observations=observations,
        )
    ).with_detail(shared)
    refuse_if_failed(result)
    return result


def _options(
    kind: CameraModel, fix: Sequence[str], max_error_px: float | None, initial: Camera | None
) -> dict[str, object]:
    options: dict[str, object] = {"model": kind.name}
    if fix:
        options["fix"] = list(fix)
    if max_error_px is not None:
        options["max_error_px"] = max_error_px
    if initial is not None:
        options["initial"] = initial.parameters
    return options


def _intrinsics_views(
    all_views: Sequence[View],
    fit: Fit,
    marked: Marked,
    too_small: dict[str, str],
    squares: Array,
) -> tuple[ViewResult, ...]:
    parts = [squares[a:b] for a, b in pairwise(fit.stacked.offsets.tolist())]
    offsets = fit.stacked.offsets
    typical = median(np.sqrt(np.add.reduceat(squares, offsets[:-1]) / np.diff(offsets)))
    T = fit.solution.value("T_camera_target") if fit.T_camera_target is None else fit.T_camera_target
    place = {v.id: i for i, v in enumerate(fit.views)}
    out = []
    for view in all_views:
        i = place.get(view.id)
        if i is None:
            out.append(unused_view(view, too_small.get(view.id, view_reason(len(view), typical))))
        else:
            out.append(fitted_view(view, parts[i], T[i], total=len(view), limit_px=marked.limit_px))
    return tuple(out)
