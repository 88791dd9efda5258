"""The refinement of one camera and all its poses, and which points and views it rests on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.calibrate.reprojection.factor import ReprojectionFactor, StackedViews, stack
from calibrant.calibrate.reprojection.held import camera_manifold
from calibrant.calibrate.reprojection.links import Link
from calibrant.calibrate.reprojection.outliers import CAUCHY_SCALE_SIGMAS, MINIMUM_POINTS, Marked, mark
from calibrant.calibrate.reprojection.priors import model_priors
from calibrant.calibrate.reprojection.weights import reweighted
from calibrant.cameras import CameraModel
from calibrant.data import Check, View
from calibrant.errors import RefusedError
from calibrant.optimize.levenberg_marquardt import SolverOptions, solve
from calibrant.optimize.losses import Loss, cauchy, squared
from calibrant.optimize.manifolds import SE3, Variable
from calibrant.optimize.problem import Problem
from calibrant.optimize.solution import Solution


@dataclass(frozen=True, eq=False)
class Start:
    """Where the refinement starts: the camera's parameters (k,) and T_camera_target (m, 4, 4)."""

    parameters: Array
    T_camera_target: Array


@dataclass(frozen=True, eq=False)
class Fit:
    """A fit and what it used: the solution, its views, and for each of them the points that were kept.

    T_camera_target: poses when they are not the solution's own (the target's shape was aligned to its nominal one);
    gauge_equations: those that are no data but hold a gauge, and unknowns as far as a prior tells them;
    checks: what was found on the way.
    """

    solution: Solution
    views: tuple[View, ...]
    stacked: StackedViews
    T_camera_target: Array | None = None
    gauge_equations: float = 0
    checks: tuple[Check, ...] = ()


@dataclass(frozen=True)
class Stopping:
    """When the solver stops: after so many steps, or when the next one would lower the RMS error by less, px."""

    max_iterations: int = 100
    epsilon_px: float = 0.0

    def options(self, points: int) -> SolverOptions:
        """The same for residuals of so many points."""
        return SolverOptions(self.max_iterations, norm_tolerance=self.epsilon_px * float(np.sqrt(points)))


ORDINARY = Stopping()


def refine(
    views: StackedViews,
    kind: CameraModel,
    start: Start,
    *,
    fix: Sequence[str],
    loss: Loss | None = None,
    sigma: float = 1.0,
    stop: Stopping = ORDINARY,
) -> Solution:
    """Minimise the reprojection error over the camera's free parameters and all poses."""
    m = len(views.offsets) - 1
    factor = ReprojectionFactor(
        "reprojection",
        model=kind,
        camera="camera",
        links=[Link("T_camera_target", np.arange(m))],
        views=views,
        loss=loss or squared(),
    )
    variables = (
        Variable("T_camera_target", SE3(), start.T_camera_target),
        Variable("camera", camera_manifold(kind, fix, start.parameters), start.parameters[None]),
    )
    priors = model_priors(kind, camera="camera", poses="T_camera_target", T_camera_target=start.T_camera_target)
    problem = Problem(variables, (factor, *priors), {"pixel": sigma})
    return solve(problem, options=stop.options(len(views.uv)))


def end_of(solution: Solution, keep: NDArray[np.bool_] | None = None) -> Start:
    T = solution.value("T_camera_target")
    return Start(solution.value("camera")[0], T if keep is None else T[keep])


def fit_and_clean(
    views: tuple[View, ...],
    stacked: StackedViews,
    start: Start,
    kind: CameraModel,
    fix: Sequence[str],
    max_error_px: float | None,
    *,
    stop: Stopping = ORDINARY,
) -> tuple[Fit, Marked]:
    """Fit all points alike; leave out, by a robust fit, those that do not belong; then weigh the rest."""
    plain = stacked.alike()
    solution = refine(plain, kind, start, fix=fix, stop=stop)
    norms = np.linalg.norm(solution.residuals("reprojection"), axis=1)
    marked = mark(norms, stacked.offsets, max_error_px=max_error_px)
    kept = views
    if not marked.keep.all():
        # Gross errors bend a plain fit towards themselves: let a robust one say who is wrong.
        scale = max(marked.sigma_px, 1e-6)
        robust = refine(plain, kind, start, fix=fix, loss=cauchy(CAUCHY_SCALE_SIGMAS), sigma=scale, stop=stop)
        norms = np.linalg.norm(robust.residuals("reprojection"), axis=1)
        marked = mark(norms, stacked.offsets, max_error_px=max_error_px)
        if max_error_px is not None and not marked.keep.any():
            raise RefusedError(
                f"every point is above the limit of {max_error_px:g} px: the median residual is "
                f"{np.median(norms):.2g} px. Raise --max-error, or check the target and the model"
            )
        judged = kept_views(views, marked, stacked)
        used = np.array([v is not None for v in judged])
        kept = tuple(v for v in judged if v is not None)
        plain = stack(kept).alike()
        solution = refine(plain, kind, end_of(robust, used), fix=fix, stop=stop)
    if all(v.sigma_px is None for v in kept):
        return Fit(solution, kept, plain), marked
    squares = np.sum(solution.residuals("reprojection") ** 2, axis=1)
    kept = reweighted(kept, squares, unknowns=solution.problem.free_count)
    weighted = stack(kept)
    return Fit(refine(weighted, kind, end_of(solution), fix=fix, stop=stop), kept, weighted), marked


def kept_views(views: Sequence[View], marked: Marked, stacked: StackedViews) -> list[View | None]:
    """Each view with its kept points; None where too few are left or the whole view goes."""
    kept: list[View | None] = []
    for i, view in enumerate(views):
        keep = marked.keep[stacked.offsets[i] : stacked.offsets[i + 1]]
        if marked.drop_view[i] or keep.sum() < MINIMUM_POINTS:
            kept.append(None)
        else:
            kept.append(view if keep.all() else view.subset(keep))
    if not any(v is not None for v in kept):
        raise RefusedError("no view fits the others: the boards are misread, or the target's size or kind is wrong")
    return kept
