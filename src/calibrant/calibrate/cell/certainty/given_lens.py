"""A lens that was given as exact, beside what the cell says of it: is it the lens that took these pictures?

With its focal lengths and its centre free at the end of the fit, one step leads to where robot and pictures put them, d
away, with the covariance C = P^-1 (what points of a view share is in it, see `views`). As for `size`, lenses are before
the data as given, or with odds `ODDS` off in focal lengths, centre or both, by a multiple of `SPREADS` of what the cell
tells these to (`doubts`). Averaged, a lens that agrees costs sigma what cannot be told of it, and one that does not is
held by it. Beyond chance it is named.

Beside a robot that costs a twentieth. Cameras that targets moved by hand tie hang on their lenses by far more: with two
exact lenses the depth of a point is known thirty times better than with free ones, and doubts of a few per cent, which
data that agree leave of them, would be nearly all of sigma. There a doubt counts from where the data make it likelier
than not (`LIKELIER`), and is nothing before; its odds are those of all exact lenses together. What a lens would do
that is off by as much as cannot be told is said beside (`untold`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.cell.certainty.doubts import Group, carried, columns, doubted
from calibrant.calibrate.cell.certainty.lens import BY_CHANCE
from calibrant.calibrate.cell.certainty.views import lens_shares
from calibrant.calibrate.cell.problem.camera_role import CameraRole
from calibrant.calibrate.cell.problem.groups import lens_variable
from calibrant.calibrate.cell.problem.problem import Cell
from calibrant.cameras import Camera
from calibrant.optimize import linear
from calibrant.optimize.chances import chi2_tail
from calibrant.optimize.solution import Solution

ODDS = 1.0
"""Of two lenses that are given as exact, one is off by as much as a cell can see: nobody's is exact."""
SPREADS = (4.0,)
"""Multiples of what the cell tells of the lens: doubts that it can tell. One of 1 beside it makes sigma of clean cells
2 % larger and holds no more wrong lenses; doubts of 6 hold a centre that is a pixel off too seldom."""
LIKELIER = 0.5
"""Chance from which the doubt about a lens counts that all else hangs on."""
MOST_OFF = 0.01
"""Of the focal length: what a lens in a file is off by where nothing shows it, in focal lengths and centre."""
TOGETHER = (("fx", "fy"), ("cx", "cy"), ("fx", "fy", "cx", "cy"))
"""What is off at once: focus and zoom, crop, and size or another camera."""
MAIN = ("fx", "fy", "cx", "cy")
"""What files get wrong, of another size, crop or focus; the rest hardly shows in a few views."""


@dataclass(frozen=True, eq=False)
class LensDoubt:
    """covariance (s, s): what is added to that of the shared unknowns; could_add (s, s): what a lens that is off by as
    much as cannot be told would; chance: of a right lens that seems as far off; names and moved (k,): the free
    parameters, and where robot and pictures put them less where they were given; sigma (k,) of that."""

    covariance: Array
    could_add: Array
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


def lens_doubt(
    cell: Cell, solution: Solution, freed: Solution, camera: str, *, sigma_px: float, hanging: int = 0
) -> LensDoubt | None:
    """What the cell says of a lens that was given as exact. None where it says nothing.

    freed: the fit, at its values, with the lens free as `freed_role` has it, and cell with that role; hanging: how many
    exact lenses there are that targets moved by hand tie, where this is one of them.
    """
    step = linear.solve(freed.equations, 0.0)
    if step is None or freed.unobservable:
        return None
    lens = lens_variable(camera)
    at = columns(freed, lens)
    # Where the lens is as given all views err alike by it: what they share is asked where it is as found.
    values = freed.problem.retract(freed.values, step)
    found = replace(freed, values=values, equations=freed.problem.linearize(values, freed.sigmas))
    shared = lens_shares(cell, found, camera, sigma_px=sigma_px)
    role = cell.roles[camera]
    free = [k for k, n in enumerate(role.camera.model.parameter_names) if n not in role.held]
    C = freed.shared_covariance[np.ix_(at, at)]
    C_all = C if shared is None else C + shared[np.ix_(free, free)]
    d = step.shared[at]
    scale = np.sqrt(np.diag(C_all))
    squares = float((d / scale) @ np.linalg.solve(C_all / scale[:, None] / scale, d / scale))
    chance = chi2_tail(len(d), squares)
    names = tuple(role.camera.model.parameter_names[k] for k in free)
    C_all, off = _within_reason(C_all, d, MOST_OFF * _focal_px(role.camera))
    doubt = doubted(C_all, off, lens_groups(names, odds=ODDS / max(hanging, 1)), SPREADS)
    doubts = np.zeros_like(C) if hanging and doubt.chance < LIKELIER else doubt.off
    moved = carried(solution, freed, at, but=(lens,))
    return LensDoubt(moved @ doubts @ moved.T, moved @ C_all @ moved.T, chance, names, d, scale)


def _within_reason(C: Array, d: Array, most: float) -> tuple[Array, Array]:
    """C and d of lens parameters in pixels by which no lens given as exact is off by more than `most` typically: what
    the cell does not tell of it, as one picture of a flat board does not, is no doubt without bounds."""
    scale = np.sqrt(np.diag(C))
    P = np.linalg.inv(C / scale[:, None] / scale)
    both = scale[:, None] * np.linalg.inv(P + np.diag((scale / most) ** 2)) * scale
    return both, both @ ((P @ (d / scale)) / scale)


def _focal_px(camera: Camera) -> float:
    return float(np.mean([abs(camera.parameters[n]) for n in ("fx", "fy") if n in camera.parameters]))


def lens_groups(names: Sequence[str], *, odds: float = ODDS) -> list[Group]:
    """What of a lens may be off at once, alike, odds in all."""
    apart = [tuple(k for k, n in enumerate(names) if n in group) for group in TOGETHER]
    groups = [g for i, g in enumerate(apart) if g and g not in apart[:i]]
    return [Group(g, odds / len(groups)) for g in groups]
