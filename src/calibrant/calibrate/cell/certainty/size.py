"""A doubt about the size of a target, in the sigma of all else: a cell is solved for the size that was given.

With the size by the robot's motion m +- s, in units of the one given, targets are before the data as given, or with
odds `ODDS` off by what is normal with a multiple w s of that sigma, each of `SPREADS` alike. The likelihood of the
second against the first is

    (1 + w^2)^-1/2 exp(t^2 / 2 * w^2 / (1 + w^2)),     t = (m - 1) / s,

and then the size is off by (1 + (w t)^2 / (1 + w^2)) w^2 / (1 + w^2) s^2 in mean square. Averaged, that is next to
nothing for sizes that agree, and (m - 1)^2 for those that do not: sigma holds it from the first doubt on. An error of
the size moves all else by h = C_xs / C_ss, C the covariance with the size free.
"""

from __future__ import annotations

import numpy as np

from calibrant.arrays import Array, Indices
from calibrant.data import Measured
from calibrant.optimize.solution import Solution
from calibrant.optimize.structure import SHARED

ODDS = 0.1
"""One board in ten is not of the size that was typed in: printers scale, rulers slip."""
SPREADS = (4.0, 16.0)
"""Multiples of what the motion tells the size to: where it tells, doubts are far beyond it."""


def size_doubt(size: Measured) -> float:
    """Mean square of what the size given is off by, relative."""
    if size.sigma <= 0:
        return float((size.value - 1) ** 2)
    t, w2 = (size.value - 1) / size.sigma, np.square(SPREADS)
    share = w2 / (1 + w2)
    logs = np.log(ODDS / len(SPREADS)) - 0.5 * np.log1p(w2) + 0.5 * t**2 * share
    top = max(float(logs.max()), 0.0)
    chance = np.exp(logs - top) / (np.exp(-top) + np.exp(logs - top).sum())
    return float(chance @ (share * (1 + share * t**2))) * size.sigma**2


def size_shares(solution: Solution, freed: Solution, scale: str, size: Measured) -> Array:
    """What the doubt about a target's size adds to the covariance (s, s) of the shared unknowns.

    freed: the same problem with the size free, at the same values; scale: the name of that unknown.
    """
    none = np.zeros_like(solution.shared_covariance)
    if freed.unobservable:
        return none
    at = _columns(freed, scale)
    moved = freed.shared_covariance[:, at[0]] / freed.shared_covariance[at[0], at[0]]
    h = np.zeros(len(none))
    for v in solution.problem.variables:
        mine, theirs = _columns(solution, v.name), _columns(freed, v.name)
        h[mine] = moved[theirs]
    return size_doubt(size) * np.outer(h, h)


def _columns(solution: Solution, name: str) -> Indices:
    """Columns of a variable in the shared part; none for one that is held or eliminated."""
    p = solution.problem.structure.placements[solution.problem.variable_index(name)]
    if p is None or p.together != SHARED:
        return np.zeros(0, dtype=np.int64)
    return (p.offset[:, None] + np.arange(p.dim)).ravel()
