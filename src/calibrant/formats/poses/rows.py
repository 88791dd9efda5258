"""From named columns to raw poses: the step that every file of poses passes, whatever its syntax."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.formats.poses.columns import layout_of
from calibrant.formats.poses.raw import NOTHING_STATED, QUATERNION_NORM_TOLERANCE, RawPoses, Stated, checked_quaternions
from calibrant.geometry import rotations, se3

Cell = str | float | int | None

MATRIX_TOLERANCE = 2e-3
"""Largest |R R^T - I| of a rotation whose elements were rounded to three decimals: 2 sqrt(3) 0.0005 = 0.0017."""

_LARGEST = 1e9
"""A thousand kilometres in millimetres; larger numbers are slips, and their squares would overflow."""

FULL_TURN_DEG = 360.0
"""No notation writes a larger angle."""
_ROTATION_FIRST = {6: ("e1", "e2", "e3", "x", "y", "z"), 7: ("q0", "q1", "q2", "q3", "x", "y", "z")}
MATRIX_NAMES = tuple(f"m{i}{j}" for i in range(1, 5) for j in range(1, 5))


@dataclass(frozen=True)
class PoseTable:
    """Named columns, a row a pose, and where each row stands in its file."""

    header: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    places: tuple[str, ...]
    source: str
    names: tuple[str, ...] | None = None
    stated: Stated = NOTHING_STATED
    notes: tuple[str, ...] = ()
    keyed: bool = False
    """True when the columns were keys of a mapping, whose order says nothing."""
    bare: bool = False
    """True for bare numbers, whose columns have been named by their count and size alone."""


def raw_poses(table: PoseTable) -> RawPoses:
    """Raw poses of a table. What `table.stated` says goes over what the column names say.

    Raises: InputError naming file and line (or entry): a text where a number belongs, NaN, a quaternion of norm 0,
    a matrix that is no rotation, a name given twice, columns that are missing.
    """
    try:
        layout = layout_of(table.header)
    except InputError as error:
        raise InputError(f"{table.source}: {error}") from error
    numbers = numbers_of(table, (*layout.translation, *layout.rotation))
    names = table.names
    if names is None and layout.name is not None:
        names = tuple(str(row[layout.name] if row[layout.name] is not None else "").strip() for row in table.rows)
        if not all(names):
            raise InputError(f"{table.places[names.index('')]}: the pose's name is empty (column {layout.name + 1})")
    said = {key: value for key, value in vars(table.stated).items() if value is not None}
    stated = replace(layout.stated, **said)
    rotation = numbers[:, 3:]
    if rotation.shape[1] == 4:
        rotation = checked_quaternions(rotation, table.places)
        if table.keyed and stated.rotation == "quat-wxyz":
            rotation, stated = rotations.xyzw_from_wxyz(rotation), replace(stated, rotation="quat-xyzw")
    elif rotation.shape[1] == 9:
        rotation = _rotations(rotation.reshape(-1, 3, 3), numbers[:, :3], table.places)
    raw = RawPoses(
        numbers[:, :3], rotation, names, table.places, stated, source=table.source, notes=table.notes,
        unused=layout.passed_over,
    )  # fmt: skip
    if not table.bare or numbers.shape[1] != 6 or np.abs(numbers).max() > FULL_TURN_DEG:
        return raw
    return replace(raw, rotation_first=replace(raw, translation=numbers[:, 3:], rotation=numbers[:, :3]))


def numbers_of(table: PoseTable, columns: Sequence[int], *, bounded: bool = True) -> Array:
    """The numbers in some columns (rows, columns). Raises: InputError naming the place of what is none.

    `bounded` numbers are lengths and angles, whose size has a limit; times have none.
    """
    read = _cell_number if bounded else _any_number
    return np.array(
        [
            [read(row[i], table.header[i], where) for i in columns]
            for row, where in zip(table.rows, table.places, strict=True)
        ]
    )


def plain_header(count: int) -> tuple[tuple[str, ...], Stated] | None:
    """Column names for a pose of bare numbers, and what is likely; None when no pose has that many.

    3 + 3 and 3 + 4 numbers are a position and a rotation, 12 and 16 a matrix by rows. Four bare numbers are a
    quaternion with the scalar last as a rule (ROS, the TUM trajectory format).
    """
    position = ("x", "y", "z")
    if count == 6:
        return (*position, "e1", "e2", "e3"), NOTHING_STATED
    if count == 7:
        return (*position, "q0", "q1", "q2", "q3"), Stated(likely="quat-xyzw")
    return (MATRIX_NAMES[:count], NOTHING_STATED) if count in (12, 16) else None


def header_of(rows: Sequence[Sequence[Cell]]) -> tuple[tuple[str, ...], Stated] | None:
    """Column names for rows of bare numbers, as `plain_header`; one more number in front is a time stamp or a counter.

    Seven numbers are a counter and 3 + 3 where the last four cannot be a quaternion. The rotation stands first where
    the numbers leave no other way: the first four alone have a norm of 1, or the last three are no angles.
    """
    count = len(rows[0])
    counter = _counts(rows)
    alone = plain_header(count)
    no_quaternion_last = count == 7 and not _unit_norms(rows, slice(3, 7))
    if no_quaternion_last and _unit_norms(rows, slice(0, 4)):
        return _ROTATION_FIRST[7], Stated(likely="quat-wxyz")
    if count == 6 and _largest(rows, slice(3, 6)) > FULL_TURN_DEG >= _largest(rows, slice(0, 3)):
        return _ROTATION_FIRST[6], NOTHING_STATED
    for lead in (0, 1):
        if count == 12 + lead and (apart := _rotation_apart([row[lead:] for row in rows])) is not None:
            return ((("index" if counter else "timestamp",) if lead else ()) + apart, NOTHING_STATED)
    if alone is not None and not (counter and no_quaternion_last):
        return alone
    behind = plain_header(count - 1)
    if behind is None:
        return None
    return ("index" if counter else "timestamp", *behind[0]), behind[1]


def _rotation_apart(rows: Sequence[Sequence[Cell]]) -> tuple[str, ...] | None:
    """Column names where nine of twelve numbers side by side are a rotation, and a 3x4 matrix has none."""
    numbers = _plain_numbers(rows, slice(0, 12))
    if numbers is None or numbers.shape[1] != 12 or _are_rotations(numbers.reshape(-1, 3, 4)[:, :, :3]):
        return None
    block = tuple(f"r{i}{j}" for i in range(1, 4) for j in range(1, 4))
    if _are_rotations(numbers[:, :9].reshape(-1, 3, 3)):
        return (*block, "x", "y", "z")
    return ("x", "y", "z", *block) if _are_rotations(numbers[:, 3:].reshape(-1, 3, 3)) else None


def _are_rotations(R: Array) -> bool:
    with np.errstate(all="ignore"):
        off = np.abs(R @ np.swapaxes(R, 1, 2) - np.eye(3)).max() if np.all(np.abs(R) < 2) else np.inf
    return bool(off < MATRIX_TOLERANCE)


def upright(matrices: Sequence[Sequence[Cell]]) -> tuple[tuple[tuple[Cell, ...], ...], str | None]:
    """4x4 matrices (16 numbers each) by rows; those given by columns are transposed, and a note says so.

    By columns is how some controllers list them: then the bottom row 0 0 0 1 stands at the right.
    """

    def is_last(cells: Sequence[Cell]) -> bool:
        try:
            return [float(c) for c in cells if c is not None] == [0.0, 0.0, 0.0, 1.0]
        except (TypeError, ValueError, OverflowError):
            return False

    by_columns = [is_last(m[3::4]) and not is_last(m[12:]) for m in matrices]
    if not matrices or not all(by_columns):
        return tuple(tuple(m) for m in matrices), None
    turned = tuple(tuple(m[4 * j + i] for i in range(4) for j in range(4)) for m in matrices)
    return turned, "the 4x4 matrices are listed by columns; read so"


def bottom_rows(matrices: Sequence[Sequence[Cell]], places: Sequence[str]) -> None:
    """Raises: InputError when the last row of a 4x4 matrix is not 0 0 0 1."""
    for cells, where in zip(matrices, places):
        row = [_cell_number(cell, "last row", where) for cell in cells[12:]]
        if np.abs(np.array(row) - [0, 0, 0, 1]).max() > 1e-9:
            raise InputError(f"{where}: the last row of the 4x4 matrix is {row}, expected [0, 0, 0, 1]")


def _rotations(R: Array, t: Array, places: tuple[str, ...]) -> Array:
    checked = [
        se3.check(se3.make(matrix, position), name=where, tolerance=MATRIX_TOLERANCE)
        for matrix, position, where in zip(R, t, places)
    ]
    return np.array([T[:3, :3] for T in checked])


def _cell_number(cell: Cell, column: str, where: str) -> float:
    value = _any_number(cell, column, where)
    if math.isfinite(value) and abs(value) > _LARGEST:
        raise InputError(
            f"{where}: column {column.strip()!r} is {value:g}, beyond any length or angle; correct the line"
        )
    return value


def _any_number(cell: Cell, column: str, where: str) -> float:
    try:
        if isinstance(cell, bool) or cell is None:
            raise ValueError
        return float(cell)
    except (TypeError, ValueError, OverflowError) as error:
        found = "empty" if cell is None or cell == "" else repr(cell)
        raise InputError(f"{where}: column {column.strip()!r} is {found}, expected a number") from error


def _counts(rows: Sequence[Sequence[Cell]]) -> bool:
    """True when the first column holds whole numbers that grow by one."""
    try:
        first = np.array([float(row[0]) for row in rows if row[0] is not None])
    except (TypeError, ValueError, OverflowError):
        return False
    return bool(len(first) > 0 and np.all(first == np.round(first)) and np.all(np.diff(first) == 1))


def _unit_norms(rows: Sequence[Sequence[Cell]], columns: slice) -> bool:
    q = _plain_numbers(rows, columns)
    return q is not None and bool(np.all(np.abs(np.linalg.norm(q, axis=1) - 1) < QUATERNION_NORM_TOLERANCE))


def _largest(rows: Sequence[Sequence[Cell]], columns: slice) -> float:
    """The largest size of the numbers in some columns; NaN where one is no number."""
    numbers = _plain_numbers(rows, columns)
    return float("nan") if numbers is None else float(np.abs(numbers).max())


def _plain_numbers(rows: Sequence[Sequence[Cell]], columns: slice) -> Array | None:
    try:
        return np.array([[float(cell) for cell in row[columns] if cell is not None] for row in rows])
    except (TypeError, ValueError, OverflowError):
        return None


def entry_of(fields: Mapping[str, Cell], header: Sequence[str], where: str) -> tuple[Cell, ...]:
    """The fields in the order of the header. Raises: InputError when they are not the same fields."""
    missing = [key for key in header if key not in fields]
    extra = [key for key in fields if key not in header]
    if missing or extra:
        found = f"{'no ' + ', '.join(missing) if missing else ''}{' and ' if missing and extra else ''}"
        found += f"{', '.join(extra) + ' too many' if extra else ''}"
        raise InputError(f"{where}: {found}; expected the fields of the first pose: {', '.join(header)}")
    return tuple(fields[key] for key in header)
