"""The fit of a camera whose views move while they are read: motions, their size and the noise together.

    min sum |r / sigma|^2 + sum |turn / level|^2 + sum |shift / level|^2

over camera, poses and six numbers of motion a view. sigma and levels are estimated as noise levels are, from the
residuals that each has to spare (`optimize.noise`), so that still views cost nothing and moving ones are as free as
they need; the covariance of the camera holds the motions and is averaged over what their levels are uncertain by.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.calibrate.intrinsics.fit import ORDINARY, Fit, Stopping, kept_views
from calibrant.calibrate.intrinsics.rolling_factor import CAMERA, MOTION, POSES, SHIFT, TURN, MotionPrior, RollingFactor
from calibrant.calibrate.reprojection.factor import StackedViews, stack
from calibrant.calibrate.reprojection.outliers import Marked, mark
from calibrant.calibrate.reprojection.priors import model_priors
from calibrant.calibrate.reprojection.weights import reweighted
from calibrant.cameras import CameraModel
from calibrant.data import View
from calibrant.geometry import se3
from calibrant.optimize.levenberg_marquardt import solve_again
from calibrant.optimize.manifolds import SE3, Euclidean, Variable
from calibrant.optimize.noise import NoiseEstimate, NoiseLevel, estimate_noise, with_spread
from calibrant.optimize.problem import Problem

GLOBAL, ROLLING = "global", "rolling"
SHUTTERS = (GLOBAL, ROLLING)
_NAMES = ("turn x", "turn y", "turn z", "shift x", "shift y", "shift z")
PIXEL_FLOOR = 1e-4
"""px: below any detector; noise of exact data is none, and motions are told from it all the same."""
MOTION_FLOOR = 1e-2
"""Of the corners' noise: motions below change no sigma by one part in a thousand."""
START_PX = 1.0
"""Motion to start the search for its level from, where the corners' noise is less."""


@dataclass(frozen=True, eq=False)
class Moving:
    """A fit with motions: fit, whose covariances are at unit noise; centres (m, 3) of the points that each view
    shows, metres.

    pixel, motion: the noise of a corner and the level of the shifts an axis, px.
    """

    fit: Fit
    centres: Array
    pixel: NoiseLevel
    motion: NoiseLevel


def moving_fit(
    views: Sequence[View],
    still: Fit,
    kind: CameraModel,
    *,
    height: int,
    max_error_px: float | None,
    stop: Stopping = ORDINARY,
) -> tuple[Moving, Marked]:
    """The fit of the same views with motions, and all their points judged by it, not by a camera at rest.

    Args: views, as they were given, whose sigma_px is the detector's own; still, the fit without motion; height, rows.
    """
    names = {v.id for v in still.views}
    every = tuple(v for v in views if v.id in names)
    whole = stack(every)
    centres = np.add.reduceat(whole.points, whole.offsets[:-1], axis=0) / np.diff(whole.offsets)[:, None]
    found = _fit(still, kind, centres, height, stop)
    solution = found.fit.solution
    judge = RollingFactor("reprojection", model=kind, views=whole, centres=centres, height=height)
    squares = np.sum(judge.residuals(*(solution.value(name) for name in judge.variables)) ** 2, axis=1)
    squares = np.where(squares < PIXEL_FLOOR**2, 0.0, squares)
    marked = mark(np.sqrt(squares), whole.offsets, max_error_px=max_error_px)
    judged = kept_views(every, marked, whole)
    used = np.array([v is not None for v in judged])
    kept = tuple(v for v in judged if v is not None)
    left = squares[marked.keep & np.repeat(used, np.diff(whole.offsets))]
    unknowns = solution.problem.free_count - found.fit.gauge_equations
    weighed = reweighted(kept, left, unknowns=int(unknowns))
    return _fit(
        replace(found.fit, views=weighed, stacked=stack(weighed)), kind, centres, height, stop, chosen=used
    ), marked


def _fit(
    start: Fit,
    kind: CameraModel,
    centres: Array,
    height: int,
    stop: Stopping,
    *,
    chosen: NDArray[np.bool_] | None = None,
) -> Moving:
    """From a fit with motions or without, of these views or of those of them that are chosen; centres (m, 3) of all."""
    before, views = start.solution, start.stacked
    every = slice(None) if chosen is None else chosen
    T = before.value(POSES)[every]
    at_rest = all(v.name != MOTION for v in before.problem.variables)
    motion = np.zeros((len(T), 6)) if at_rest else before.value(MOTION)[every]
    centres = centres if chosen is None else centres[chosen]
    camera = before.problem.variables[before.problem.variable_index(CAMERA)].manifold
    theta = before.value(CAMERA)
    middles = se3.apply(T, centres)
    px_per_m = np.sqrt(np.sum(kind.project_with_jacobians(theta[0], middles)[1] ** 2, axis=(1, 2)) / 2)
    problem = Problem(
        (
            Variable(POSES, SE3(), T),
            Variable(CAMERA, camera, theta),
            Variable(MOTION, Euclidean(_NAMES), motion),
        ),
        (
            RollingFactor("reprojection", model=kind, views=views, centres=centres, height=height),
            MotionPrior(TURN, px_per_m * np.linalg.norm(middles, axis=1)),
            MotionPrior(SHIFT, px_per_m),
            *model_priors(kind, camera=CAMERA, poses=POSES, T_camera_target=T),
        ),
    )
    noise = max(float(np.sqrt(np.mean(before.residuals("reprojection") ** 2))), PIXEL_FLOOR)
    begin, least = max(START_PX, noise), PIXEL_FLOOR + MOTION_FLOOR * noise
    found = estimate_noise(
        problem,
        sigmas={"pixel": noise, TURN: begin, SHIFT: begin},
        floors={"pixel": PIXEL_FLOOR, TURN: least, SHIFT: least},
        options=stop.options(len(views.uv)),
    )
    return _at_unit_noise(found, start, views, centres)


def _at_unit_noise(found: NoiseEstimate, start: Fit, views: StackedViews, centres: Array) -> Moving:
    """The estimate in units of the corners' noise, as every fit of intrinsics is: its level is multiplied later."""
    pixel, motion = found.levels["pixel"], found.levels[SHIFT]
    unit = {g: replace(n, sigma=n.sigma / pixel.sigma, deviation=n.deviation / pixel.sigma)
            for g, n in found.levels.items()}  # fmt: skip
    solution = solve_again(found.solution, {g: n.sigma for g, n in unit.items()})
    solution = with_spread(NoiseEstimate(solution, unit, found.rounds, found.settled)).solution
    shares = solution.noise_shares
    told = float(shares.traces[shares.groups.index("pixel")])
    fit = Fit(solution, start.views, views, gauge_equations=solution.problem.free_count - told, checks=start.checks)
    return Moving(fit, centres, pixel, motion)
