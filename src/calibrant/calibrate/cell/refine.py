"""The weighted fit of a cell, and again without what does not belong, until nothing more goes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.cell.certainty.level_hold import held_levels
from calibrant.calibrate.cell.consistency import inconsistent_views
from calibrant.calibrate.cell.fitted import fitted_cameras, fitted_places
from calibrant.calibrate.cell.problem.groups import geometry_variable, pictures_factor
from calibrant.calibrate.cell.problem.layout import Frame
from calibrant.calibrate.cell.problem.problem import Cell, cell_problem
from calibrant.calibrate.cell.problem.problem import places as rows_of
from calibrant.calibrate.cell.problem.views import HandEyeViews
from calibrant.calibrate.intrinsics.fit import ORDINARY, Stopping
from calibrant.calibrate.reprojection.outliers import mark
from calibrant.errors import RefusedError, causes
from calibrant.optimize.levenberg_marquardt import SolverOptions
from calibrant.optimize.noise import NoiseEstimate, estimate_noise
from calibrant.optimize.solution import Solution

MAX_CLEANING_ROUNDS = 3
MOST_LEFT_OUT = 1 / 3
"""Where more of a list's views disagree, the fault is not in single views."""
LEAST_VIEWS, LEAST_POINTS = 3, 6
"""What a list keeps of its views, and a view of its points, whatever disagrees."""
NEARLY_UNDAMPED = SolverOptions(initial_damping=1e-8)
LEAST_SIGMA_START = 1e-6
"""Start of a noise level when the closed form fits exactly: radians and metres."""


def refined(
    cell: Cell, transforms: Mapping[Frame, Array], spread: tuple[float, float], stop: Stopping = ORDINARY
) -> tuple[NoiseEstimate, Cell]:
    """The fit with its noise levels, and what is left of the cell.

    transforms: the start; spread: what a loop errs by typically, radians and metres; stop: each solve. Raises:
    RefusedError naming what the pictures do not determine.
    """
    sigmas = cell.levels((max(spread[0], LEAST_SIGMA_START), max(spread[1], LEAST_SIGMA_START)))
    cell, transforms = in_sight(cell, transforms)
    options = _options(cell, sigmas, stop)
    rounds = MAX_CLEANING_ROUNDS + sum(int(f.keep.sum()) for f in cell.free.values())
    for k in range(rounds + 1):
        noise = estimate_noise(cell_problem(cell, transforms, sigmas), floors=cell.floors(), options=options)
        solution = noise.solution
        if solution.unobservable:
            raise RefusedError(causes(u.message for u in solution.unobservable[:3]))
        cell = _seen_again(cell, solution)
        cleaned = cell if k == rounds else _cleaned(cell, solution)
        if cleaned is cell:
            break
        cell, transforms, sigmas = cleaned, fitted_places(cell, solution), dict(solution.sigmas)
    return held_levels(noise, options=options), cell


def _options(cell: Cell, sigmas: Mapping[str, float], stop: Stopping) -> SolverOptions | None:
    """How each solve goes; None as usual. Residuals are over their sigma here: an epsilon in pixels is so too."""
    # A handheld target's poses are from the same pictures: the start is a step from the optimum, damping costs steps.
    usual = NEARLY_UNDAMPED if cell.layout.rig else None
    if stop == ORDINARY:
        return usual
    points = sum(len(v) for i, _, _ in cell.lists for v in cell.used_views(i))
    asked = stop.options(points)
    pixel = max((sigmas[cell.pixel_group(name)] for name in cell.roles), default=1.0)
    return replace(
        usual or SolverOptions(), max_iterations=asked.max_iterations, norm_tolerance=asked.norm_tolerance / pixel
    )


UNSEEN = "by the other cameras its target is not before this one with all its points"


def in_sight(cell: Cell, transforms: Mapping[Frame, Array]) -> tuple[Cell, Mapping[Frame, Array]]:
    """The cell without the views of handheld targets that their camera cannot see from where the start has it.

    A few points in one picture may place a board behind the camera that sees it; no step leads out of there.
    """
    handheld = [i for i, p, _ in cell.lists if p.handheld]
    if not handheld:
        return cell, transforms
    problem = cell_problem(cell, transforms, cell.levels((LEAST_SIGMA_START, LEAST_SIGMA_START)))
    data = list(cell.data)
    for i in handheld:
        if not cell.used_views(i):
            continue
        k = problem.factor_index(pictures_factor(i))
        seen = np.isfinite(problem.factors[k].residuals(*problem.gather(k, problem.start))).all(axis=1)
        offsets = np.cumsum([0, *(len(v) for v in cell.used_views(i))])[:-1]
        unseen = ~np.logical_and.reduceat(seen, offsets)
        if unseen.any() and not unseen.all():
            dropped = np.zeros(len(data[i]), dtype=bool)
            dropped[np.flatnonzero(data[i].use)[unseen]] = True
            data[i] = data[i].without(dropped, [UNSEEN] * len(dropped))
    left = replace(cell, data=tuple(data))
    return left, kept_places(cell, left, transforms)


def kept_places(cell: Cell, left: Cell, places: Mapping[Frame, Array]) -> dict[Frame, Array]:
    """Where what is left of a cell starts from: of handheld targets, the moments that are still seen."""
    kept = dict(places)
    for frame in cell.layout.handheld:
        kept[frame] = places[frame][rows_of(cell.moments_by_hand(frame[1]), left.moments_by_hand(frame[1]))]
    return kept


def _seen_again(cell: Cell, solution: Solution) -> Cell:
    """The target poses of the used views found again by the cameras as refined; those of handheld targets are asked for
    no more."""
    if cell.layout.rig:
        return cell
    cameras = fitted_cameras(cell, solution)
    again = [p.seen is not None and not p.handheld and d.use.any() for _, p, d in cell.lists]
    data = [d.seen_by(cameras[p.camera]) if more else d for more, (_, p, d) in zip(again, cell.lists)]
    return replace(cell, data=tuple(data))


def _cleaned(cell: Cell, solution: Solution) -> Cell:
    """Without the views that do not fit the others; else without points beyond the noise; else without the joint
    parameters that are hardly known. The cell itself where nothing goes."""
    data = [_without_odd(cell, solution, i) for i in range(len(cell.data))]
    if all(new is old for new, old in zip(data, cell.data)):
        data = [_without_points(cell, solution, i) for i in range(len(cell.data))]
    if any(new is not old for new, old in zip(data, cell.data)):
        return replace(cell, data=tuple(data))
    free = {robot: f.without_weak(solution, geometry_variable(robot)) for robot, f in cell.free.items()}
    return replace(cell, free=free) if any(free[r] is not f for r, f in cell.free.items()) else cell


def _without_odd(cell: Cell, solution: Solution, i: int) -> HandEyeViews:
    """List i without views whose loop does not fit the others; a handheld target closes no loop."""
    data = cell.data[i]
    if cell.layout.pictures[i].handheld:
        return data
    odd = inconsistent_views(cell, solution, i)
    used = int(data.use.sum())
    if not odd.any() or used - odd.sum() < LEAST_VIEWS or odd.sum() > MOST_LEFT_OUT * used:
        return data
    reason = "its robot pose and its image disagree by more than the noise of the others explains"
    return data.without(odd, [reason] * len(data))


def _without_points(cell: Cell, solution: Solution, i: int) -> HandEyeViews:
    """List i without points beyond the noise. A view that does not fit as a whole is judged by its pose, not point by
    point."""
    data, views = cell.data[i], cell.used_views(i)
    if not views:
        return data
    norms = np.linalg.norm(solution.residuals(pictures_factor(i)), axis=1)
    offsets = np.concatenate([[0], np.cumsum([len(v) for v in views])])
    marked = mark(norms, offsets)
    kept = list(data.views or ())
    changed = False
    for k, (row, view) in enumerate(zip(np.flatnonzero(data.use).tolist(), views)):
        keep = marked.keep[offsets[k] : offsets[k + 1]]
        if not (marked.drop_view[k] or keep.all() or keep.sum() < LEAST_POINTS):
            kept[row], changed = view.subset(keep), True
    return replace(data, views=tuple(kept)) if changed else data
