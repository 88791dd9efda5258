"""A push between two poses in words: what moved, between which poses, and by how much."""

from __future__ import annotations

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.cell.certainty.moved import Moved
from calibrant.calibrate.cell.problem.layout import IN_HAND, Pictures, variable
from calibrant.calibrate.cell.problem.problem import Cell
from calibrant.data import Check
from calibrant.geometry import se3
from calibrant.optimize.solution import Solution


def moved_check(cell: Cell, solution: Solution, robot: str, found: Moved) -> Check:
    """The warning, with the push as the camera or the board went that it may have been."""
    ids = cell.moments(robot)
    lists = [p for p in cell.layout.pictures if p.movers == (robot,)]
    place = np.zeros(3) if not lists else _place(cell, solution, lists[0], standing=found.standing)
    way, covariance = found.at(place)
    mm, sigma_mm = (1e3 * x for x in _length(way, covariance))
    deg, sigma_deg = np.rad2deg(_length(found.way[:3], found.covariance[:3, :3]))
    message = (
        f"{_what(lists, standing=found.standing)} moved between {ids[found.first - 1]} and {ids[found.first]} by "
        f"{mm:.2g} ± {sigma_mm:.1g} mm and {deg:.2g} ± {sigma_deg:.1g} deg (chance of as much without: "
        f"{found.chance:.1g}); the result lies between both places, and sigma holds them. Calibrate the poses before "
        "and from there on apart"
    )
    return Check("moved", "warn", message, mm)


def _what(lists: list[Pictures], *, standing: bool) -> str:
    """What may have moved. A camera that stands, a board that stands and the robot's stand look alike to the loop."""
    in_hand = {p.setup == IN_HAND for p in lists}
    if in_hand == {True}:
        return "the board or the robot's stand" if standing else "the camera on the flange"
    if in_hand == {False}:
        return "the camera or the robot's stand" if standing else "the board on the flange"
    return "something that stands" if standing else "something on the flange"


def _place(cell: Cell, solution: Solution, p: Pictures, *, standing: bool) -> Array:
    """Where the camera or the target is that stands before this robot, or hangs from it: (3,), m."""
    base = cell.layout.base(p.robot)
    at, child = next(f for f in cell.layout.constants(p) if (f[0] == base) == standing)
    T: Array = solution.value(variable((cell.layout.root if standing else at, child)))[0]
    if standing and base != cell.layout.root:
        T = se3.inverse(solution.value(variable((cell.layout.root, base)))[0]) @ T
    return np.asarray(T[:3, 3])


def _length(way: Array, covariance: Array) -> tuple[float, float]:
    """|way| and its sigma."""
    size = float(np.linalg.norm(way))
    along = way / max(size, np.finfo(float).tiny)
    return size, float(np.sqrt(along @ covariance @ along))
