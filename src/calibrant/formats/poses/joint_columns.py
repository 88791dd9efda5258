"""Joint values in tables of any kind: which columns they are, and in which unit."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.formats.poses.columns import name_and_unit
from calibrant.formats.poses.raw import PoseOptions, RawPoses, Stated
from calibrant.formats.poses.rows import PoseTable, numbers_of, plain_header
from calibrant.robots.chain import KinematicChain
from calibrant.robots.limits import LIMIT_SLACK, check_limits

_NUMBERED = re.compile(r"^(?P<stem>[a-z0-9]*joint[a-z]*|q|j|a|axis|theta)(?P<number>\d{1,2})$")
_JOINT_ANGLES = ("auto", "deg", "rad")
DEGREES_FROM = 0.5
"""Share of rows beyond the limits as radians from which a table is in degrees: ordinary poses have some joint beyond 6
degrees in nearly every row, a table in radians passes a limit in a few."""
_NAMES = ("image", "file", "filename", "name", "id", "view", "pose")
"""Columns that name the rows, the best first."""
_FACTORS = {"deg": np.pi / 180, "rad": 1.0, "m": 1.0, "mm": 1e-3, "cm": 1e-2, "in": 0.0254, "": 1.0}


@dataclass(frozen=True)
class JointColumns:
    """Positions of the joints' columns in a table, what they are called, and the unit each states ("" for none)."""

    index: tuple[int, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]


def find_joints(header: Sequence[str]) -> JointColumns | None:
    """Columns q1 q2 ..., joint_1 ..., j0 j1 ..., target_joints_1 ... of a table; None when it has none.

    Raises: InputError when two sets of joints stand side by side.
    """
    sets: dict[str, dict[int, int]] = {}
    for i, column in enumerate(header):
        match = _NUMBERED.match(name_and_unit(column)[0])
        if match:
            sets.setdefault(match["stem"], {})[int(match["number"])] = i
    complete = {}
    for stem, columns in sets.items():
        numbers = sorted(columns)
        counts_on = numbers == list(range(numbers[0], numbers[0] + len(numbers))) and numbers[0] in (0, 1)
        # Five and more a or q are axes; q1 ... q4 are a quaternion, and a single a1 is part of a pose.
        if counts_on and (
            "joint" in stem or stem in ("j", "axis") or len(numbers) >= 5 or (stem == "q" and len(numbers) != 4)
        ):
            complete[stem] = [columns[n] for n in numbers]
    if len(complete) > 1:
        raise InputError(f"several sets of joints: {', '.join(complete)}; keep the columns of one")
    return None if not complete else _joint_columns(header, next(iter(complete.values())))


def joints_of_robot(header: Sequence[str], chain: KinematicChain) -> JointColumns:
    """Columns of a robot's joints: by their names, else numbered ones in the robot's order.

    Raises: InputError naming the joints that are missing or unknown.
    """
    keys = [name_and_unit(column)[0] for column in header]
    wanted = [re.sub(r"[^0-9a-z]", "", j.name.lower()) for j in chain.joints]
    missing = [j.name for j, key in zip(chain.joints, wanted) if key not in keys]
    if not missing:
        return _joint_columns(header, [keys.index(key) for key in wanted])
    listed = ", ".join(j.name for j in chain.joints)
    found = find_joints(header)
    if found is None or len(missing) < len(wanted):
        raise InputError(
            f"no column for joint {missing[0]}; the robot's joints are {listed}; the columns are "
            f"{', '.join(repr(c.strip()) for c in header)}; expected the joints' names, or q1 to q{len(wanted)}"
        )
    if len(found.index) != len(wanted):
        raise InputError(
            f"{len(found.index)} joint values ({', '.join(found.names)}) for {len(wanted)} joints ({listed})"
        )
    return found


def joints_in(table: PoseTable, chain: KinematicChain | None) -> JointColumns | None:
    """The columns of a robot's joints in a table, or numbered ones where the robot is not known; None when it has none.

    Raises: InputError naming the file.
    """
    try:
        return find_joints(table.header) if chain is None else joints_of_robot(table.header, chain)
    except InputError as error:
        raise InputError(f"{table.source}: {error}") from error


def joint_values(
    table: PoseTable, columns: JointColumns, chain: KinematicChain | None, *, angle: str
) -> tuple[Array, str]:
    """Joint values (n, k) in radians and metres, and how they were read, in words.

    The unit is the column's, else `angle`; else radians where the limits allow it, degrees where only these do.
    Raises: InputError for text, values beyond the limits, an unknown `angle`.
    """
    if angle not in _JOINT_ANGLES:
        raise InputError(f"unknown unit of joint angles {angle!r}; known: {', '.join(_JOINT_ANGLES)}")
    raw = numbers_of(table, columns.index)
    slides = (
        np.array([j.kind == "prismatic" for j in chain.joints]) if chain is not None else np.zeros(raw.shape[1], bool)
    )
    silent = np.array([unit == "" for unit in columns.units])
    stated = raw * np.array([_FACTORS[unit] for unit in columns.units])
    in_degrees = np.where(silent & ~slides, np.pi / 180, 1.0)
    if angle == "auto" and chain is not None and _degrees(chain, stated, stated * in_degrees):
        angle = "deg"
    q = stated * in_degrees if angle == "deg" else stated
    if chain is not None:
        check_limits(chain, q, table.places)
    units = sorted({*columns.units} - {""} or {"deg" if angle == "deg" else "rad"})
    return q, f"joints {', '.join(columns.names)} in {' and '.join(units)}"


def poses_from_joints(table: PoseTable, chain: KinematicChain, *, angle: str) -> RawPoses:
    """T_base_flange of every row by forward kinematics, as poses whose notation is settled.

    Raises: InputError naming the file: joints that are missing, unknown, or beyond their limits.
    """
    try:
        columns = _bare(table, chain) or joints_of_robot(table.header, chain)
    except InputError as error:
        raise InputError(f"{table.source}: {error}") from error
    q, _ = joint_values(table, columns, chain, angle=angle)
    T = chain.forward(q)
    return RawPoses(
        T[:, :3, 3],
        T[:, :3, :3],
        names_of(table),
        table.places,
        Stated(units="m", rotation="matrix", direction="base-gripper"),
        PoseOptions(units="m", rotation="matrix", direction="base-gripper"),
        source=table.source,
        notes=table.notes,
        unused=_unused(table, columns),
        joints=q,
    )


def names_of(table: PoseTable) -> tuple[str, ...] | None:
    """What the table calls its rows, where the joints are all else it holds."""
    if table.names is not None:
        return table.names
    keys = [name_and_unit(column)[0] for column in table.header]
    at = next((keys.index(key) for key in _NAMES if key in keys), None)
    if at is None:
        return None
    return tuple(str(row[at]).strip() for row in table.rows)


def _unused(table: PoseTable, columns: JointColumns) -> tuple[str, ...]:
    """Columns that hold no joint of the robot's, and no name."""
    return tuple(
        name.strip()
        for i, name in enumerate(table.header)
        if i not in columns.index and name_and_unit(name)[0] not in _NAMES
    )


def without(table: PoseTable, columns: JointColumns) -> PoseTable:
    """The table without its joints."""
    rest = [i for i in range(len(table.header)) if i not in columns.index]
    header = tuple(table.header[i] for i in rest)
    return replace(table, header=header, rows=tuple(tuple(row[i] for i in rest) for row in table.rows))


def _bare(table: PoseTable, chain: KinematicChain) -> JointColumns | None:
    """Rows of bare numbers, as many as the robot has joints: the joints in order, since a robot is given."""
    n = len(chain.joints)
    plain = plain_header(n)
    if plain is None or tuple(table.header[-n:]) != plain[0]:
        return None
    first = len(table.header) - n
    return JointColumns(tuple(range(first, first + n)), tuple(f"number {k + 1}" for k in range(n)), ("",) * n)


def _joint_columns(header: Sequence[str], index: Sequence[int]) -> JointColumns:
    units = [name_and_unit(header[i])[1] for i in index]
    for i, unit in zip(index, units):
        if unit not in _FACTORS:
            raise InputError(
                f"the unit {unit!r} of column {header[i].strip()!r} is not known here; known: deg, rad, m, mm"
            )
    return JointColumns(tuple(index), tuple(header[i].strip() for i in index), tuple(units))


def _degrees(chain: KinematicChain, plain: Array, scaled: Array) -> bool:
    """Whether values without a unit are degrees: only as these are they within the limits, and not for a few rows.

    One row in radians beyond a limit is a fault of that row; it does not make all others a sixtieth of a turn.
    """
    beyond = ~_within(chain, plain)
    return bool(beyond.mean() > DEGREES_FROM and _within(chain, scaled).all())


def _within(chain: KinematicChain, q: Array) -> NDArray[np.bool_]:
    """Which rows (n,) are inside the limits."""
    return np.all((q >= chain.lower - LIMIT_SLACK) & (q <= chain.upper + LIMIT_SLACK), axis=1)
