"""A doubt about the size of a target, in the sigma of all else: a cell is solved for the size that was given.

With the size by the robot's motion m +- s, in units of the one given, targets are before the data as given, or with
odds `ODDS` off by what is normal with a multiple w s of that sigma, each of `SPREADS` alike (`doubts`). Averaged, that
is next to nothing for sizes that agree, and (m - 1)^2 for those that do not: sigma holds it from the first doubt on. An
error of the size moves all else by h = C_xs / C_ss, C the covariance with the size free.

Of one list m and s are the loop's, which is all there is. Of several, a size is doubted by what all of them tell it to:
a stereo pair that a board held by hand has measured tells the size of the one on the table, which the motion of the
robot tells to a fifth of that. m and s are then of the one problem with all sizes free, a step from its end, and each
target may be off by itself, or all of them, as likely as targets that know nothing of each other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.cell.certainty.doubts import Group, carried, columns, doubted
from calibrant.data import Measured
from calibrant.optimize import linear
from calibrant.optimize.solution import Solution

ODDS = 0.1
"""One board in ten is not of the size that was typed in: printers scale, rulers slip."""
SPREADS = (4.0, 16.0)
"""Multiples of what the motion tells the size to: where it tells, doubts are far beyond it."""


@dataclass(frozen=True, eq=False)
class FreeSizes:
    """A fit at its values with sizes free, the unknowns `scales`; told: what the only list says of the only one."""

    scales: tuple[str, ...]
    solution: Solution
    told: Measured | None = None


def size_doubt(size: Measured) -> float:
    """Mean square of what the size given is off by, relative."""
    if size.sigma <= 0:
        return float((size.value - 1) ** 2)
    one = np.array([[size.sigma**2]]), np.array([size.value - 1])
    return float(doubted(*one, [Group((0,), ODDS)], SPREADS).off[0, 0])


def size_shares(solution: Solution, freed: FreeSizes) -> Array:
    """What doubts about targets' sizes add to the covariance (s, s) of the shared unknowns."""
    none = np.zeros_like(solution.shared_covariance)
    if freed.solution.unobservable:
        return none
    at = np.concatenate([columns(freed.solution, name) for name in freed.scales])
    h = carried(solution, freed.solution, at)
    if freed.told is not None:
        return size_doubt(freed.told) * h @ h.T
    step = linear.solve(freed.solution.equations, 0.0)
    if step is None:
        return none
    C = freed.solution.shared_covariance[np.ix_(at, at)]
    return np.asarray(h @ doubted(C, step.shared[at], size_groups(len(at)), SPREADS).off @ h.T)


def size_groups(n: int) -> Sequence[Group]:
    """Each target by itself, and all."""
    alone = [Group((k,), ODDS) for k in range(n)]
    return [*alone, Group(tuple(range(n)), ODDS**n)] if n > 1 else alone
