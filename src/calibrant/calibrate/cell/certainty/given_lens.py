"""A lens that was given as exact, beside what the cell says of it: is it the lens that took these pictures?

With its focal lengths and its centre free at the end of the fit, one step leads to where robot and pictures put them, d
away, with the covariance C = P^-1 (what points of a view share is in it, see `views`). As for `size`, lenses are before
the data as given, or with odds `ODDS` off in focal lengths, centre or both: by what is normal with w^2 times what the
cell tells these to, C_s = P_ss^-1, all else as given, each of `SPREADS` alike. They are then seen to be off by
d_s = C_s P_s d, and the likelihood against that of a lens as given is, in k parameters,

    (1 + w^2)^(-k/2) exp(b d_s^T P_ss d_s / 2),     b = w^2 / (1 + w^2).

The lens is off by b C_s + b^2 d_s d_s^T in mean square. Averaged, a lens that agrees costs sigma what cannot be told of
it, and one that does not is held by it. Beyond chance it is named.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibrant.arrays import Array, Indices
from calibrant.calibrate.cell.certainty.lens import BY_CHANCE
from calibrant.calibrate.cell.certainty.views import lens_shares
from calibrant.calibrate.cell.problem.camera_role import CameraRole
from calibrant.calibrate.cell.problem.groups import lens_variable
from calibrant.calibrate.cell.problem.problem import Cell
from calibrant.cameras import Camera
from calibrant.optimize import linear
from calibrant.optimize.chances import chi2_tail
from calibrant.optimize.solution import Solution
from calibrant.optimize.structure import SHARED

ODDS = 1.0
"""Of two lenses that are given as exact, one is off by as much as a cell can see: nobody's is exact."""
SPREADS = (4.0,)
"""Multiples of what the cell tells of the lens: doubts that it can tell. One of 1 beside it makes sigma of clean cells
2 % larger and holds no more wrong lenses; doubts of 6 hold a centre that is a pixel off too seldom."""
TOGETHER = (("fx", "fy"), ("cx", "cy"), ("fx", "fy", "cx", "cy"))
"""What is off at once: focus and zoom, crop, and size or another camera."""
MAIN = ("fx", "fy", "cx", "cy")
"""What files get wrong, of another size, crop or focus; the rest hardly shows in a few views."""


@dataclass(frozen=True, eq=False)
class LensDoubt:
    """covariance (s, s): what is added to that of the shared unknowns; chance: of a right lens that seems as far off;
    names and moved (k,): the free parameters, and where robot and pictures put them less where they were given; sigma
    (k,) of that."""

    covariance: Array
    chance: float
    names: tuple[str, ...]
    moved: Array
    sigma: Array

    @property
    def wrong(self) -> bool:
        """Whether robot and pictures contradict the lens beyond chance."""
        return self.chance < BY_CHANCE


def freed_role(camera: Camera) -> CameraRole | None:
    """The camera with its main parameters free; None for a model that has none of them."""
    names = camera.model.parameter_names
    free = [n for n in MAIN if n in names and n not in camera.model.gauge]
    return CameraRole(camera, tuple(n for n in names if n not in free)) if free else None


def lens_doubt(cell: Cell, solution: Solution, freed: Solution, camera: str, *, sigma_px: float) -> LensDoubt | None:
    """What the cell says of a lens that was given as exact. None where it says nothing.

    freed: the fit, at its values, with the lens free as `freed_role` has it, and cell with that role.
    """
    step = linear.solve(freed.equations, 0.0)
    if step is None or freed.unobservable:
        return None
    lens = lens_variable(camera)
    columns = _columns(freed, lens)
    # Where the lens is as given all views err alike by it: what they share is asked where it is as found.
    values = freed.problem.retract(freed.values, step)
    found = replace(freed, values=values, equations=freed.problem.linearize(values, freed.sigmas))
    shared = lens_shares(cell, found, camera, sigma_px=sigma_px)
    role = cell.roles[camera]
    free = [k for k, n in enumerate(role.camera.model.parameter_names) if n not in role.held]
    C = freed.shared_covariance[np.ix_(columns, columns)]
    C_all = C if shared is None else C + shared[np.ix_(free, free)]
    d = step.shared[columns]
    scale = np.sqrt(np.diag(C_all))
    squares = float((d / scale) @ np.linalg.solve(C_all / scale[:, None] / scale, d / scale))
    chance = chi2_tail(len(d), squares)
    names = tuple(role.camera.model.parameter_names[k] for k in free)
    added = mean_square(C_all, d, names)
    K = np.linalg.solve(C / scale[:, None] / scale, freed.shared_covariance[columns] / scale[:, None]).T / scale
    moved = np.zeros((len(solution.shared_covariance), len(d)))
    for v in solution.problem.variables:
        if v.name != lens:
            moved[_columns(solution, v.name)] = K[_columns(freed, v.name)]
    return LensDoubt(moved @ added @ moved.T, chance, names, d, scale)


def mean_square(C: Array, d: Array, names: tuple[str, ...]) -> Array:
    """What the lens is off by, (k, k), averaged over what may be off in it and by how much."""
    scale = np.sqrt(np.diag(C))
    P = np.linalg.inv(C / scale[:, None] / scale)
    apart = [[k for k, n in enumerate(names) if n in group] for group in TOGETHER]
    groups = [g for i, g in enumerate(apart) if g and g not in apart[:i]]
    logs, squares = [0.0], [np.zeros_like(C)]
    for g in groups:
        C_g = np.linalg.inv(P[np.ix_(g, g)])
        off = C_g @ P[g] @ (d / scale)
        for w in SPREADS:
            share = w**2 / (1 + w**2)
            odds = np.log(ODDS / len(groups) / len(SPREADS)) - 0.5 * len(g) * np.log1p(w**2)
            logs.append(float(odds + 0.5 * share * off @ P[np.ix_(g, g)] @ off))
            whole = np.zeros_like(C)
            whole[np.ix_(g, g)] = share * C_g + share**2 * np.outer(off, off)
            squares.append(whole)
    chance = np.exp(np.array(logs) - max(logs))
    return np.asarray(scale[:, None] * np.tensordot(chance / chance.sum(), squares, 1) * scale)


def _columns(solution: Solution, name: str) -> Indices:
    """Columns of a variable in the shared part; none for one that is held or eliminated."""
    p = solution.problem.structure.placements[solution.problem.variable_index(name)]
    if p is None or p.together != SHARED:
        return np.zeros(0, dtype=np.int64)
    return (p.offset[:, None] + np.arange(p.dim)).ravel()
