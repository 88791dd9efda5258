"""Do intervals mean what they say? A covariance is that of the linearised problem: over an interval the camera must
bend little, and no other camera may fit as well.

Bending. Along the interval of parameter k the others follow, e_k = 1.96 C_k / sigma_k. What a straight line misses,

    gamma_k = |f(theta + e_k) + f(theta - e_k) - 2 f(theta)| / (2 sigma)     over all points,

is in units of the noise, as the interval's own end is 1.96 units away (Bates and Watts 1980, "Relative curvature
measures of nonlinearity"). Terms that nearly cancel, as a rational lens's numerator and denominator may, bend by
thousands.

A second camera. Families of wide lenses have two shapes of nearly the same field, one on either side of their plain
form. The refinement finds the one on the side it starts from; the other is tried too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.intrinsics.fit import Fit, Start, refine
from calibrant.calibrate.reprojection.factor import StackedViews
from calibrant.calibrate.reprojection.held import expand_fix
from calibrant.calibrate.starts import any_lens as camera_start
from calibrant.cameras import Camera, CameraModel
from calibrant.data import Check
from calibrant.geometry import se3

QUANTILE = 1.96
GAMMA_WARN = QUANTILE
"""As far as the interval reaches itself. Below, the poses take up most of what a line misses, and coverage is right."""
POINTS = 400
"""Points to measure bending with: a smooth function of 20 parameters needs no more."""
RAYS = 600
ROUNDING_PX = 1e-6
"""Noise below is that of exact data: what bends there is rounding."""
ANOTHER_SIGMAS = 10.0
"""A second camera is a different one: the start's tolerance alone leaves a few sigma."""
AS_LIKELY = 3.841
"""95 % of chi-square with 1 degree of freedom: a second camera below it lies within what the interval should hold."""


def linearity_check(camera: Camera, views: StackedViews, T_camera_target: Array, sigma_px: float) -> Check:
    """Can the parameters' intervals be taken at their word? Models with a gauge are linear in all they estimate."""
    gamma = bending(camera, views, T_camera_target, sigma_px)
    worst = float(gamma.max(initial=0.0))
    if worst <= GAMMA_WARN:
        text = f"over their intervals the parameters act in proportion (to {worst:.1g} of the noise)"
        return Check("linearity", "ok", text, worst)
    names = [n for n, g in zip(camera.model.parameter_names, gamma) if g > GAMMA_WARN]
    text = (
        f"{', '.join(names)} are not determined apart: their intervals reach so far that the lens does not change in "
        "proportion. Pixels and rays are certain as stated, these numbers are not; use a model with fewer terms, fix "
        "some, or take views that fill the image's corners"
    )
    return Check("linearity", "warn", text, min(worst, 1e300))


def bending(camera: Camera, views: StackedViews, T_camera_target: Array, sigma_px: float) -> Array:
    """gamma (k,) of every parameter, 0 for those held; infinite where an interval leaves the model's domain."""
    kind, gamma = camera.model, np.zeros(len(camera.values))
    if kind.gauge or camera.covariance is None or sigma_px <= ROUNDING_PX:
        return gamma
    chosen = np.unique(np.linspace(0, len(views.uv) - 1, POINTS).astype(np.int64))
    edge = np.repeat(np.arange(len(views.offsets) - 1), np.diff(views.offsets))[chosen]
    p = np.ascontiguousarray(se3.apply(T_camera_target[edge], views.points[chosen]).T)
    sigma = np.sqrt(np.diag(camera.covariance))
    moving = np.flatnonzero(sigma > 0)
    e = QUANTILE * camera.covariance[moving] / sigma[moving, None]
    uv = _pixels(kind, [camera.values, *(camera.values + e), *(camera.values - e)], p)
    share = np.sqrt(len(views.uv) / len(chosen)) / views.sigma[chosen]
    missed = (uv[1 : 1 + len(moving)] + uv[1 + len(moving) :] - 2 * uv[0]) * share
    size = np.sqrt(np.einsum("kan,kan->k", missed, missed)) / (2 * sigma_px)
    gamma[moving] = np.where(np.isfinite(size), size, np.inf)
    return gamma


def _pixels(kind: CameraModel, values: Sequence[Array], p: Array) -> Array:
    """Pixels (m, 2, n) of the points p (3, n) for each of m sets of parameters (k,), by the compiled model."""
    n, rows = p.shape[1], kind.rows()
    uv, J_point, J_parameters = np.empty((len(values), 2, n)), np.empty((6, n)), np.empty((2 * len(values[0]), n))
    for parameters, into in zip(values, uv):
        rows(n, parameters, p, into, J_point, J_parameters)
    return uv


def better_of_two(fit: Fit, kind: CameraModel, fix: Sequence[str]) -> Fit:
    """The fit, or that of the second camera when it is the better one; with a check when both are as likely."""
    held = set(expand_fix(fix, kind)[0])
    values = fit.solution.value("camera")[0]
    second = None if held or kind.gauge or kind.projection != "central" else _second(kind, values, fit.stacked.uv)
    if second is None or fit.solution.unobservable:
        return fit
    variance = 2 * fit.solution.cost / max(2 * len(fit.stacked.uv) - fit.solution.problem.free_count, 1)
    sigma = np.sqrt(np.diag(fit.solution.covariance("camera")) * variance)
    if not np.any(np.abs(second - values) > ANOTHER_SIGMAS * sigma):
        return fit
    start = Start(second, fit.solution.value("T_camera_target"))
    other = refine(fit.stacked, kind, start, fix=fix)
    found = other.value("camera")[0]
    if not (other.converged and np.any(np.abs(found - values) > ANOTHER_SIGMAS * sigma)):
        return fit
    surplus = 2 * (other.cost - fit.solution.cost) / variance
    chosen, left = (other, values) if surplus < 0 else (fit.solution, found)
    checks = (_ambiguity(kind, left, abs(surplus)),) if abs(surplus) < AS_LIKELY else ()
    return replace(fit, solution=chosen, checks=checks)


def _ambiguity(kind: CameraModel, left: Array, surplus: float) -> Check:
    text = ", ".join(f"{n} {v:.5g}" for n, v in zip(kind.parameter_names, left))
    return Check(
        "second-camera",
        "warn",
        f"a second {kind.name} camera fits as well ({text}; chi-square higher by {surplus:.2g}): the intervals are "
        "around one of the two. Both have the same rays where points were seen; take views nearer to the image's rim",
        surplus,
    )


def _second(kind: CameraModel, values: Array, uv: Array) -> Array | None:
    """Parameters (k,) on the other side of the model's plain form that have nearly the same rays; None without."""
    pixels = uv[:: max(1, len(uv) // RAYS)]
    rays = kind.unproject(values, pixels)
    good = np.isfinite(rays).all(axis=1)
    centre = values[[kind.index("cx"), kind.index("cy")]]
    focal = kind.project_with_jacobians(values, [0.0, 0.0, 1.0])[1][0, 0]
    plain = kind.starting_values(float(focal), centre)
    mirrored = 2 * plain - values
    frame = [kind.index(n) for n in ("fx", "fy", "cx", "cy")]
    mirrored[frame] = values[frame]
    with np.errstate(all="ignore"):
        scale = focal / kind.project_with_jacobians(mirrored, [0.0, 0.0, 1.0])[1][0, 0]
        mirrored[frame[:2]] *= scale
        if not (np.isfinite(kind.project(mirrored, rays[good])).all() and scale > 0):
            return None
    return camera_start.fitted(kind, rays[good], pixels[good], focal=float(focal), centre=centre, start=mirrored)
