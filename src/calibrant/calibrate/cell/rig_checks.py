"""What the cameras of a cell are asked beside each other, and a rig as a whole, with its error at moments left out.

Every tenth moment is left out of the fit; where the target was then is found by all its cameras together, which stay
where the other moments put them. The rest is the error of places and lenses, which the fit of all hides in them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibrant.arrays import Array, Mask
from calibrant.calibrate.cell import checks as questions
from calibrant.calibrate.cell.clocks import clocks_found, suspected_clocks
from calibrant.calibrate.cell.fitted import fitted_places
from calibrant.calibrate.cell.held_out import nearest_start
from calibrant.calibrate.cell.noise_figures import pooled
from calibrant.calibrate.cell.problem.groups import pictures_factor
from calibrant.calibrate.cell.problem.layout import Frame, variable
from calibrant.calibrate.cell.problem.problem import Cell, cell_problem
from calibrant.calibrate.cell.problem.problem import places as rows_of
from calibrant.calibrate.cell.refine import NEARLY_UNDAMPED, refined
from calibrant.calibrate.cell.starts.cell import LEVEL_START, CellStart
from calibrant.calibrate.cell.starts.handheld import fewest, handheld_start
from calibrant.calibrate.intrinsics.fit import ORDINARY, Stopping
from calibrant.calibrate.reprojection.in_fit import seen_in_fit
from calibrant.data import Check, Measured
from calibrant.data.details import SharedMoments
from calibrant.errors import CalibrantError
from calibrant.geometry import se3
from calibrant.optimize.chances import CHI2_6_LIMIT
from calibrant.optimize.levenberg_marquardt import CLOSE_ENOUGH, solve
from calibrant.optimize.manifolds import SE3, Euclidean, Manifold
from calibrant.optimize.noise import NoiseEstimate
from calibrant.optimize.problem import Problem
from calibrant.optimize.solution import Solution

TENTH = 10
FROM_WHOLE = replace(CLOSE_ENOUGH, initial_damping=NEARLY_UNDAMPED.initial_damping)
"""The fit of all is a step from that without a tenth."""
HELD_OUT, FITTED = "held-out RMS", "RMS there in the fit"


def _sigma_together(cell: Cell, noise: NoiseEstimate, camera: str) -> float:
    """Pixel noise that a camera shows in the fit of all: its level, or where cameras share one, what its own residuals
    are over what they should be."""
    level, solution = cell.pixel_level(noise.levels, camera), noise.solution
    group = cell.pixel_group(camera)
    if not (cell.layout.rig or cell.alike(camera)):
        return level.sigma
    squares, count = 0.0, 0
    for i, p, d in cell.lists:
        if p.camera == camera and d.use.any():
            k = solution.problem.factor_index(pictures_factor(i))
            weighted = solution.residuals(pictures_factor(i)) * solution.problem.factors[k].weight[:, None]
            squares, count = squares + float(np.sum(weighted**2)), count + weighted.size
    every = sum(c for g, c in zip(solution.noise_shares.groups, solution.noise_shares.counts) if g == group)
    return cell.pixel_ratios[camera] * float(np.sqrt(squares / count * every / level.redundancy)) if count else 0.0


def together(cell: Cell, noise: NoiseEstimate, camera: str) -> Check:
    """Does a camera fit as well with the others as by itself?"""
    return questions.together_check(camera, _sigma_together(cell, noise, camera), cell.own_sigma_px(camera))


def rig_checks(cell: Cell, start: CellStart, noise: NoiseEstimate) -> tuple[Check, ...]:
    """What cameras are asked that handheld targets tie: do they share moments enough, do they hold still to each other,
    what do their clocks say?"""
    tied = cell.roles if cell.layout.rig else [c for group in cell.layout.by_hand if len(group) > 1 for c in group]
    if not tied:
        return ()
    levels = [cell.pixel_level(noise.levels, c) for c in tied]
    own = pooled([replace(level, sigma=cell.own_sigma_px(c)) for c, level in zip(tied, levels)])
    joint = pooled(levels)
    shared = (questions.shared_moments_check(start.pairs),) if start.pairs else ()  # none in a rig of one camera
    found = clocks_found(cell, noise.solution)
    if found is not None:
        return *shared, questions.rigidity_check(joint, own), questions.clocks_check(found)
    suspected = suspected_clocks(cell, noise.solution) if questions.loose_rig(joint, own) else None
    explained = suspected is not None and questions.explained_by(suspected.level, joint, own)
    return *shared, questions.rigidity_check(joint, own, suspected.clocks if suspected and explained else None)


def better_start(
    first: Cell, noise: NoiseEstimate, cell: Cell, stop: Stopping = ORDINARY
) -> tuple[NoiseEstimate, Cell, tuple[Check, ...]]:
    """The better of the fit and of one that starts from another tree of pairs, where a rig errs by more than its
    cameras; and what was found.

    first: the cell before anything was left out of it; noise, cell: its fit; stop: of the solves.
    """
    if not cell.layout.rig or len(cell.layout.cameras) < 2:
        return noise, cell, ()
    own = pooled([replace(cell.pixel_level(noise.levels, c), sigma=cell.own_sigma_px(c)) for c in cell.roles])
    together = pooled([cell.pixel_level(noise.levels, c) for c in cell.roles])
    if not questions.loose_rig(together, own):
        return noise, cell, ()
    try:
        places, _ = handheld_start(first.layout, first.data, rank=fewest)
        other, left = refined(first, places, LEVEL_START, stop)
    except CalibrantError:
        return noise, cell, ()  # what the first start tied by many moments may not be tied by few
    again = pooled([left.pixel_level(other.levels, c) for c in left.roles])
    apart = _furthest(cell, noise.solution, left, other.solution)
    if apart is None:
        return noise, cell, ()
    better = again < together
    check = questions.second_start_check(*apart, together, again)
    return (other, left, (check,)) if better else (noise, cell, (check,))


def _furthest(a: Cell, of_a: Solution, b: Cell, of_b: Solution) -> tuple[str, float] | None:
    """The camera that two fits place furthest apart, by how many mm; None where all are within their sigma."""
    found = []
    at_a, at_b = fitted_places(a, of_a), fitted_places(b, of_b)
    for frame in a.layout.unknown:
        d = se3.local(at_a[frame], at_b[frame])
        C = of_a.covariance(variable(frame)) + of_b.covariance(variable(frame))
        # Of one optimum, both ends are it but for the solver's stop and single points.
        if float(d @ np.linalg.solve(C, d)) > CHI2_6_LIMIT:
            found.append((frame[1], 1e3 * float(np.linalg.norm(d[3:]))))
    return max(found, key=lambda f: f[1]) if found else None


def shared_moments(cell: Cell) -> SharedMoments | None:
    """Who saw what together, of the views that are used; None for cells that are no rig of several cameras."""
    names = cell.layout.cameras
    if not cell.layout.rig or len(names) < 2:
        return None
    seen: dict[str, set[tuple[str, str]]] = {c: set() for c in names}
    for i, p, _ in cell.lists:
        carrier = cell.layout.carrier(p)
        seen[p.camera].update((carrier, m) for m in cell.used_ids(i))
    return SharedMoments(names, tuple(tuple(len(seen[a] & seen[b]) for b in names) for a in names))


@dataclass(frozen=True)
class _Held(SE3):
    """Transforms that stay as they are."""

    @property
    def free_names(self) -> tuple[str, ...]:
        return ()

    def basis(self, values: Array) -> Array | None:
        return np.zeros((1, 6, 0))

    def retract(self, values: Array, free: Array) -> Array:
        return values


def held_out_moments(cell: Cell, fit: Solution) -> Mapping[str, Measured]:
    """RMS error of moments that were left out, px, as a figure; none for cells that are no rig, and few moments."""
    layout = cell.layout
    moments = list(dict.fromkeys(m for i, _, _ in cell.lists for m in cell.used_ids(i)))
    out = set(moments[TENTH // 2 :: TENTH])
    if not layout.rig or len(moments) < 2 * TENTH:
        return {}
    masks = [np.array([m in out for m in d.ids], dtype=bool) for d in cell.data]
    if any(d.use.any() and not (d.use & ~gone).any() for d, gone in zip(cell.data, masks)):
        return {}  # a camera or a target that only these moments show
    rest = cell.kept([~gone for gone in masks])
    problem = cell_problem(rest, _places(rest, cell, fit), fit.sigmas)
    solved = solve(problem, start=nearest_start(problem, fit), options=FROM_WHOLE)
    left = cell.kept(masks)
    used = [gone[d.use] for gone, d in zip(masks, cell.data)]
    there = {v.name: value for v, value in zip(solved.problem.variables, solved.values)}
    alone = _with_rest_held(cell_problem(left, _places(left, cell, fit), fit.sigmas), there, layout.handheld)
    found = solve(alone, options=CLOSE_ENOUGH)
    held, fitted = _rms_px(left, found), _rms_px(left, fit, used)
    return {HELD_OUT: Measured(held, unit="px"), FITTED: Measured(fitted, unit="px")}


def _rms_px(left: Cell, fit: Solution, rows: Sequence[Mask] | None = None) -> float:
    """Over the points of these views, of which the fit may have more; rows: by list, which of its used rows."""
    squares = []
    for i, _, d in left.lists:
        if d.use.any():
            every = seen_in_fit(fit, pictures_factor(i))
            squares += [s for s, _ in every] if rows is None else [every[k][0] for k in np.flatnonzero(rows[i])]
    return float(np.sqrt(np.mean(np.concatenate(squares)))) if squares else float("nan")


def _places(part: Cell, cell: Cell, fit: Solution) -> dict[Frame, Array]:
    """Where a part of a cell starts from: the places of the fit of all, of handheld targets those of its moments."""
    places = fitted_places(cell, fit)
    for frame in cell.layout.handheld:
        places[frame] = places[frame][rows_of(cell.moments_by_hand(frame[1]), part.moments_by_hand(frame[1]))]
    return places


def _with_rest_held(problem: Problem, values: Mapping[str, Array], free: tuple[Frame, ...]) -> Problem:
    """The problem with all but these transforms held at the values given."""
    loose = {variable(frame) for frame in free}
    variables = []
    for v in problem.variables:
        if v.name in loose:
            variables.append(v)
            continue
        names = v.manifold.natural_names
        held: Manifold = _Held() if isinstance(v.manifold, SE3) else Euclidean(names, names)
        variables.append(replace(v, manifold=held, values=values.get(v.name, v.values)))
    return replace(problem, variables=tuple(variables))
