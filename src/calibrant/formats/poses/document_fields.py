"""One pose in a document: named numbers and lists, nested as ROS nests them, matrices; what each key says."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import PurePath
from typing import Any

from calibrant.errors import InputError
from calibrant.formats.poses.columns import is_header, layout_of
from calibrant.formats.poses.raw import NOTHING_STATED, Stated
from calibrant.formats.poses.rows import MATRIX_NAMES, Cell, PoseTable, header_of

_ROTATION_KEY = re.compile(r"rot|orient|quat|^q$|^r$|rvec|euler|rpy|angle|axis")
# OpenCV's gripper2base names the map from gripper to base coordinates, T_base_gripper.
_JOINTS_KEY = re.compile(r"joint|^q$|^configuration$")
_GRIPPER = r"(?:gripper|flange|tool|tcp|wrist|ee|eef|hand|effector)"
_STATES_BASE_GRIPPER = re.compile(f"^(?:t|h|pose)?(?:base{_GRIPPER}|{_GRIPPER}2base)$")
_STATES_GRIPPER_BASE = re.compile(f"^(?:t|h|pose)?(?:{_GRIPPER}base|base2{_GRIPPER})$")

_COUNTS = (6, 7, 12, 16)
"""Numbers that make a pose."""

Fields = dict[str, Cell]


def looks_like_pose(value: Any) -> bool:
    """Whether a value has the numbers of a pose, in any of the ways that are read."""
    if isinstance(value, list):
        return is_matrix(value) or (
            len(value) in (6, 7, 12, 16) and not any(isinstance(v, Mapping | list) for v in value)
        )
    try:
        fields, _ = pose_fields(value, "", _no_reference)
    except InputError:
        return False
    return is_header(tuple(fields))


def _is_complete(fields: Fields) -> bool:
    try:
        layout_of(tuple(fields))
    except InputError:
        return False
    return True


def _no_reference(path: str) -> PoseTable:
    raise InputError(f"{path}: a file name where a pose belongs")


def is_matrix(value: Any) -> bool:
    """Whether a value is four rows of four numbers, or three."""
    if not isinstance(value, list) or len(value) not in (3, 4):
        return False
    return all(isinstance(row, list) and len(row) == 4 and not any(isinstance(c, list) for c in row) for row in value)


def pose_fields(entry: Any, where: str, read_reference: Callable[[str], PoseTable]) -> tuple[Fields, Stated]:
    """One pose as named numbers, and what its keys state."""
    if isinstance(entry, str):
        table = read_reference(entry)
        if len(table.rows) != 1:
            raise InputError(f"{where}: {entry} holds {len(table.rows)} poses, expected one")
        return dict(zip(table.header, table.rows[0])), table.stated
    if isinstance(entry, list):
        return _listed_numbers(entry, where)
    if not isinstance(entry, Mapping):
        raise InputError(f"{where}: {entry!r}, expected the fields of a pose or a list of numbers")
    out: Fields = {}
    stated = NOTHING_STATED
    for key, value in entry.items():
        named, said = _field(str(key), value, where, read_reference)
        twice = sorted(name for name in named if name in out)
        if twice:
            raise InputError(f"{where}: {', '.join(twice)} given twice, the second time under {key!r}")
        out |= named
        stated = Stated(**{k: v or getattr(stated, k) for k, v in vars(said).items()})
    return out, stated


def _field(key: str, value: Any, where: str, read_reference: Callable[[str], PoseTable]) -> tuple[Fields, Stated]:
    """The named numbers in one field."""
    short = spelled(key)
    direction = Stated(direction=stated_direction(short))
    if isinstance(value, Mapping):
        inner, stated = pose_fields(value, f"{where}.{key}", read_reference)
        prefix = "" if set(inner) & set(MATRIX_NAMES) else f"{key}."
        known = {f"{prefix}{name}": cell for name, cell in inner.items()}
        # A wrapper such as "pose" or "transform" adds nothing to names that are complete without it.
        return (inner if _is_complete(inner) else known), (
            stated if stated.direction else Stated(**{**vars(stated), **vars(direction)})
        )
    if isinstance(value, list):
        flat = [cell for row in value for cell in (row if isinstance(row, list) else [row])]
        if any(isinstance(cell, Mapping | list | str) and not is_numeric(cell) for cell in flat):
            return {}, NOTHING_STATED
        if _JOINTS_KEY.search(short) and not (short == "q" and len(flat) == 4):
            # Under a key of their own, so that they are never taken for a pose.
            stem = key if "joint" in short else "joint"
            return {f"{stem}_{i}": cell for i, cell in enumerate(flat, start=1)}, NOTHING_STATED
        rotation = bool(_ROTATION_KEY.search(short)) and not re.search("pos|trans", short)
        if len(flat) == 3 and not rotation:
            return {f"t{axis}": cell for axis, cell in zip("xyz", flat)}, direction
        if rotation and len(flat) in (3, 4, 9):
            return _rotation_list(short, flat), Stated(
                direction=direction.direction, likely="quat-xyzw" if len(flat) == 4 else None
            )
        if len(flat) in (6, 7, 12, 16):
            named, stated = _listed_numbers(value, where)
            return named, Stated(direction=direction.direction, likely=stated.likely)
        return {}, NOTHING_STATED
    if isinstance(value, str) and short == "pose":
        if PurePath(value).suffix:
            return pose_fields(value, where, read_reference)
        return {"name": value}, NOTHING_STATED
    return {key: value}, NOTHING_STATED


def _rotation_list(key: str, values: list[Cell]) -> Fields:
    """Column names for the numbers of a rotation under its key."""
    if len(values) == 9:
        return {f"r{i}{j}": values[3 * i + j - 4] for i in range(1, 4) for j in range(1, 4)}
    if len(values) == 4:
        letters = "wxyz" if "wxyz" in key else "xyzw" if "xyzw" in key else "0123"
        return {f"q{letter}": value for letter, value in zip(letters, values)}
    if "vec" in key or "axis" in key:
        return {f"rotvec{axis}": value for axis, value in zip("xyz", values)}
    if "rpy" in key:
        return dict(zip(("roll", "pitch", "yaw"), values))
    return {f"e{i}": value for i, value in enumerate(values, start=1)}


def _listed_numbers(values: list[Any], where: str) -> tuple[Fields, Stated]:
    """One pose from a bare list: 4x4 or 3x4 rows, or 6, 7, 12 or 16 numbers."""
    if any(isinstance(row, list) for row in values):
        lengths = [len(row) if isinstance(row, list) else 1 for row in values]
        if not is_matrix(values):
            raise InputError(f"{where}: rows of {lengths} numbers, expected a 4x4 matrix")
        flat = [cell for row in values for cell in row]
    else:
        flat = list(values)
    named = header_of([flat]) if len(flat) in _COUNTS else None
    if named is None:
        raise InputError(
            f"{where}: {len(flat)} numbers, expected 6 or 7 (position and rotation), 12 or 16 (matrix) or named fields"
        )
    return dict(zip(named[0], flat)), named[1]


def dropped(entry: Any, above: str = "") -> list[str]:
    """Keys of an entry, nested ones after a point, that no field of its pose came from."""
    out: list[str] = []
    for key, value in entry.items() if isinstance(entry, Mapping) else ():
        place = f"{above}{key}"
        if isinstance(value, Mapping):
            out += dropped(value, f"{place}.")
        elif isinstance(value, list) and value and not _field(str(key), value, "", _no_reference)[0]:
            out.append(place)
    return out


def stated_direction(key: str) -> str | None:
    """The direction that a key's name states; None where it states none."""
    if _STATES_BASE_GRIPPER.match(key):
        return "base-gripper"
    return "gripper-base" if _STATES_GRIPPER_BASE.match(key) else None


def is_numeric(cell: Any) -> bool:
    """Whether a cell is a number, or its text."""
    try:
        float(cell)
    except (TypeError, ValueError, OverflowError):
        return False
    return True


def spelled(key: Any) -> str:
    """A key in small letters and digits."""
    return re.sub(r"[^0-9a-z]", "", str(key).lower())
