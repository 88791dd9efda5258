"""Several points on the tool, measured at every pose, as a tracker with three reflectors gives them: poses of the tool.

The points stand on one rigid body whose shape nobody has told. Its shape is the mean of the measured ones, each moved
onto it in the least-squares sense, in turn until nothing changes (generalised Procrustes, Gower 1975); a pose is then
the motion that carries the shape onto the points as measured. The tool's frame stands in the middle of the points:
there, errors of place and of turn are not correlated.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.formats.poses.columns import LENGTH_UNITS, name_and_unit
from calibrant.formats.poses.rows import PoseTable, numbers_of
from calibrant.geometry import se3

_LABEL_COLUMNS = ("point", "reflector", "marker", "smr")
_WIDE = (re.compile(r"(?P<axis>[xyz])_?(?P<point>\d+)"), re.compile(r"p(?:oint)?_?(?P<point>\d+)_?(?P<axis>[xyz])"))
_FEWEST = 3
_ROUNDS = 100
_SETTLED = 1e-12
"""Metres by which the shape still moves: far under what any device measures."""
_LOOSEST = 0.05
"""Points that leave their mean shape by a twentieth of its size turn the tool by 3 degrees: no device measures so."""


@dataclass(frozen=True, eq=False)
class ToolPoints:
    """points (n, k, 3), metres, NaN where a point was not seen; rows (n,): the first row of each pose in its table."""

    points: Array
    rows: NDArray[np.int64]
    labels: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Body:
    """The tool as its points tell it: shape (k, 3) about their middle; T (n, 4, 4) T_world_tool; rms, metres, of a
    point from where the body's pose says it is."""

    shape: Array
    T: Array
    rms: float


def tool_points(table: PoseTable, joints: Array, unit: str | None) -> ToolPoints | None:
    """The points of each pose, where the table has more than one a pose: columns x1, y1, z1, x2 …, or a row a point.

    Args: joints (rows, n): what the table says of them; rows of one pose have the same. unit: of lengths, None to find
    it out. Returns None for a table of one position a row.
    Raises: InputError for fewer than 3 points, labels given twice.
    """
    keys = [name_and_unit(column)[0] for column in table.header]
    wide = _wide_columns(keys)
    if wide:
        values = numbers_of(table, [c for point in wide.values() for c in point]).reshape(len(table.rows), -1, 3)
        columns = [c for point in wide.values() for c in point]
        rows, labels = np.arange(len(table.rows)), tuple(wide)
    else:
        at = next((keys.index(word) for word in _LABEL_COLUMNS if word in keys), None)
        if at is None or not {"x", "y", "z"} <= set(keys):
            return None
        columns = [keys.index(axis) for axis in "xyz"]
        named = [str(row[at]).strip() for row in table.rows]
        values, rows, labels = _by_pose(table, numbers_of(table, columns), named, joints)
    if len(labels) < _FEWEST:
        raise InputError(
            f"{table.source}: {len(labels)} point(s) a pose ({', '.join(labels)}); the turn of the tool takes 3 that "
            "are not in a line; give one position a pose as x, y, z, or three points or more"
        )
    stated = {name_and_unit(table.header[c])[1] for c in columns} - {""}
    unit = unit or (stated.pop() if len(stated) == 1 else None) or ("mm" if np.nanmax(np.abs(values)) > 50.0 else "m")
    if unit not in LENGTH_UNITS:
        raise InputError(f"{table.source}: unit {unit!r} of the points; expected {', '.join(LENGTH_UNITS)}")
    return ToolPoints(values * LENGTH_UNITS[unit], rows, labels)


def body_of(seen: ToolPoints, source: str) -> Body:
    """The rigid body behind the points and its pose in each row; poses with fewer than 3 points are NaN.

    Raises: InputError where the points stand in a line, do not keep their distances, or are never seen together.
    """
    complete = np.isfinite(seen.points).all(axis=(1, 2))
    if not complete.any():
        raise InputError(f"{source}: no pose with all the points {', '.join(seen.labels)}; their shape is not known")
    whole = seen.points[complete]
    shape = whole[0] - whole[0].mean(axis=0)
    for _ in range(_ROUNDS):
        moved = np.stack([se3.apply(se3.carrying(points, shape), points) for points in whole])
        mean = moved.mean(axis=0) - moved.mean(axis=(0, 1))
        change, shape = float(np.abs(mean - shape).max()), mean
        if change < _SETTLED:
            break
    size = float(np.linalg.norm(shape, axis=1).max())
    T, squares = np.full((len(seen.points), 4, 4), np.nan), []
    for i, points in enumerate(seen.points):
        there = np.isfinite(points).all(axis=1)
        if there.sum() >= _FEWEST:
            T[i] = se3.carrying(shape[there], points[there])
            squares.append(np.square(se3.apply(T[i], shape[there]) - points[there]).sum(axis=1))
    rms = float(np.sqrt(np.concatenate(squares).mean()))
    if rms > _LOOSEST * size:
        raise InputError(
            f"{source}: the points {', '.join(seen.labels)} are off one rigid body by {rms * 1e3:.3g} mm rms, of a "
            f"body of {size * 1e3:.3g} mm; expected the same points, in the same order, at every pose"
        )
    across = float(np.linalg.svd(shape, compute_uv=False)[1])
    if across < max(_LOOSEST * size, 3 * rms):
        raise InputError(
            f"{source}: the points {', '.join(seen.labels)} stand in a line; the turn about it is not known"
        )
    return Body(shape, T, rms)


def _wide_columns(keys: Sequence[str]) -> dict[str, tuple[int, int, int]]:
    """Columns of x, y, z by point, of points that have all three; empty for a table of one position a row."""
    found: dict[str, dict[str, int]] = {}
    for i, key in enumerate(keys):
        match = next((m for pattern in _WIDE if (m := pattern.fullmatch(key))), None)
        if match:
            found.setdefault(match["point"], {})[match["axis"]] = i
    return {name: (at["x"], at["y"], at["z"]) for name, at in found.items() if len(at) == 3}


def _by_pose(
    table: PoseTable, values: Array, named: Sequence[str], joints: Array
) -> tuple[Array, NDArray[np.int64], tuple[str, ...]]:
    """Rows of one point each, gathered by pose: rows that follow each other with the same joints."""
    labels = tuple(dict.fromkeys(named))
    starts = np.flatnonzero(np.concatenate([[True], np.any(joints[1:] != joints[:-1], axis=1)]))
    points = np.full((len(starts), len(labels), 3), np.nan)
    for pose, (first, end) in enumerate(zip(starts, np.append(starts[1:], len(named)))):
        for row in range(first, end):
            k = labels.index(named[row])
            if np.isfinite(points[pose, k]).any():
                raise InputError(
                    f"{table.places[row]}: point {named[row]} stands twice at one pose (the same joint values); "
                    "expected each point once a pose"
                )
            points[pose, k] = values[row]
    return points, starts.astype(np.int64), labels
