"""Poses in JSON and YAML: lists or named groups of fields, nested as ROS nests them, matrices, pairs of poses."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import PurePath
from typing import Any

from calibrant.errors import InputError
from calibrant.formats.poses.columns import is_header, layout_of
from calibrant.formats.poses.raw import NOTHING_STATED, Stated
from calibrant.formats.poses.rows import MATRIX_NAMES, Cell, PoseTable, bottom_rows, entry_of, plain_header, upright

_ROTATION_KEY = re.compile(r"rot|orient|quat|^q$|^r$|rvec|euler|rpy|angle|axis")
_HAND = ("gripper", "hand", "tool", "flange", "tcp", "ee", "eef", "effector", "end", "wrist")
_BOARD = ("target", "board", "marker", "tag", "object", "pattern")
# Hand-eye samples as calibration tools save them: what they call the robot's pose, and the target's.
_ROBOT_KEYS = (
    "effectorwrtworld",
    "tbasegripper",
    *(f"{part}2base" for part in _HAND),
    "robot",
    "robotpose",
    *(f"{part}pose" for part in _HAND),
)
_TARGET_KEYS = (
    "objectwrtsensor",
    "tcameratarget",
    *(f"{part}2{camera}" for part in _BOARD for camera in ("cam", "camera")),
    "optical",
    "tracking",
    "camera",
    "target",
    "marker",
    *(f"{part}pose" for part in _BOARD),
)
# OpenCV's gripper2base names the map from gripper to base coordinates, T_base_gripper.
_JOINTS_KEY = re.compile(r"joint|^q$|^configuration$")
_GRIPPER = r"(?:gripper|flange|tool|tcp|wrist|ee|eef|hand|effector)"
_STATES_BASE_GRIPPER = re.compile(f"^(?:t|h|pose)?(?:base{_GRIPPER}|{_GRIPPER}2base)$")
_STATES_GRIPPER_BASE = re.compile(f"^(?:t|h|pose)?(?:{_GRIPPER}base|base2{_GRIPPER})$")

Fields = dict[str, Cell]


def read_document(
    data: Any, source: str, *, read_reference: Callable[[str], PoseTable]
) -> tuple[PoseTable, PoseTable | None]:
    """The table of poses in a JSON or YAML document, and the table of target poses when it holds pairs.

    read_reference reads the file that an entry names in place of numbers. Raises: InputError naming file and entry.
    """
    entries, names, stated = _entries(_unfolded(data), source)
    places = tuple(f"{source}[{name if names else i}]" for i, name in enumerate(names or range(len(entries))))
    if not entries:
        raise InputError(f"{source}: no poses: the list is empty")
    pairs = [_pair(entry) for entry in entries]
    if all(pair is not None for pair in pairs):
        robot, target = ([pair[k] for pair in pairs if pair is not None] for k in (0, 1))
        return _table_of(robot, places, source, names, stated, read_reference), _table_of(
            target, places, source, names, NOTHING_STATED, read_reference
        )
    return _table_of(entries, places, source, names, stated, read_reference), None


def _unfolded(data: Any) -> Any:
    """The document with matrices given as rows, cols and data (as ViSP and ROS save them) as plain lists.

    One row or one column, such as a pose of six numbers, is a list of numbers; others are lists of their rows.
    """
    if isinstance(data, list):
        return [_unfolded(value) for value in data]
    if not isinstance(data, Mapping):
        return data
    keys = {_key(k): k for k in data}
    if {"rows", "cols", "data"} <= set(keys) and isinstance(data[keys["data"]], list):
        rows, cols, values = (data[keys[k]] for k in ("rows", "cols", "data"))
        flat = [cell for row in values for cell in (row if isinstance(row, list) else [row])]
        if isinstance(rows, int) and isinstance(cols, int) and len(flat) == rows * cols > 0:
            return flat if 1 in (rows, cols) else [flat[i : i + cols] for i in range(0, len(flat), cols)]
    return {key: _unfolded(value) for key, value in data.items()}


def _table_of(
    entries: Sequence[Any],
    places: tuple[str, ...],
    source: str,
    names: tuple[str, ...] | None,
    stated: Stated,
    read_reference: Callable[[str], PoseTable],
) -> PoseTable:
    """A table from entries that all have the same fields."""
    fields = [_pose_fields(entry, where, read_reference) for entry, where in zip(entries, places)]
    first, found = fields[0]
    header = tuple(first)
    rows = tuple(entry_of(entry, header, where) for (entry, _), where in zip(fields, places))
    notes: tuple[str, ...] = ()
    if set(MATRIX_NAMES) <= set(header):
        at = [header.index(name) for name in MATRIX_NAMES]
        turned, note = upright([[row[i] for i in at] for row in rows])
        bottom_rows(turned, places)
        others = [i for i in range(len(header)) if i not in at]
        header = (*(header[i] for i in others), *MATRIX_NAMES)
        rows = tuple((*(row[i] for i in others), *cells) for row, cells in zip(rows, turned))
        notes = (note,) if note else ()
    merged = Stated(**{key: getattr(found, key) or value for key, value in vars(stated).items()})
    bare = all(isinstance(e, list) and len(e) == 6 for e in entries)
    return PoseTable(header, rows, places, source, names=names, stated=merged, notes=notes, keyed=True, bare=bare)


def _entries(data: Any, source: str) -> tuple[list[Any], tuple[str, ...] | None, Stated]:
    """The entries of a document, one a pose, their names when they are a mapping's keys, what a key states."""
    if isinstance(data, Mapping):
        keys = {_key(k): k for k in data}
        if _looks_like_pose(data):
            return [data], None, NOTHING_STATED
        if len(data) == 1 or not all(isinstance(v, Mapping | list) and _looks_like_pose(v) for v in data.values()):
            # {"poses": [...]} and its like: the one value that holds several poses.
            inner = [(k, v) for k, v in data.items() if isinstance(v, Mapping | list) and len(v) > 0]
            lists = [(k, v) for k, v in inner if isinstance(v, list) and any(isinstance(e, Mapping | list) for e in v)]
            chosen = lists if len(lists) == 1 else inner if len(inner) == 1 else []
            if chosen and not (len(data) == 1 and _looks_like_pose(chosen[0][1])):
                entries, names, stated = _entries(chosen[0][1], source)
                return (
                    entries,
                    names,
                    stated if stated.direction else Stated(direction=_stated_direction(_key(chosen[0][0]))),
                )
        numbered = _numbered(data)
        if numbered is not None:
            return list(numbered), None, NOTHING_STATED
        if keys and all(isinstance(v, Mapping | list) for v in data.values()):
            return list(data.values()), tuple(str(k) for k in data), NOTHING_STATED
        raise InputError(
            f"{source}: no poses under the keys {_listed_keys(data)}; expected a list of poses, or fields x, y, z, …"
        )
    if isinstance(data, list):
        if data and (not any(isinstance(v, Mapping | list) for v in data) or _is_matrix(data)):
            return [data], None, NOTHING_STATED
        return data, None, NOTHING_STATED
    found = {bool: "true or false", int: "a number", float: "a number", str: "text", type(None): "nothing (null)"}
    raise InputError(f"{source}: holds {found.get(type(data), type(data).__name__)}, expected a list of poses")


def _looks_like_pose(value: Any) -> bool:
    if isinstance(value, list):
        return _is_matrix(value) or (
            len(value) in (6, 7, 12, 16) and not any(isinstance(v, Mapping | list) for v in value)
        )
    try:
        fields, _ = _pose_fields(value, "", _no_reference)
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


def _is_matrix(value: Any) -> bool:
    if not isinstance(value, list) or len(value) not in (3, 4):
        return False
    return all(isinstance(row, list) and len(row) == 4 and not any(isinstance(c, list) for c in row) for row in value)


def _pair(entry: Any) -> tuple[Any, Any] | None:
    """The two poses of an entry that is a pair, robot first; None when it is not."""
    if isinstance(entry, list) and len(entry) == 2 and all(_looks_like_pose(half) for half in entry):
        return entry[0], entry[1]
    if isinstance(entry, Mapping):
        keys = {_key(k): k for k in entry}
        robot = next((keys[key] for name in _ROBOT_KEYS for key in _spelled(name) if key in keys), None)
        target = next((keys[key] for name in _TARGET_KEYS for key in _spelled(name) if key in keys), None)
        if robot is not None and target is not None:
            return {robot: entry[robot]}, {target: entry[target]}
        return _solved_beside(entry, keys)
    return None


def _spelled(name: str) -> tuple[str, ...]:
    """A key, and as people write it who begin the names of transforms with a letter."""
    return name, f"t{name}", f"h{name}"


def _numbered(data: Mapping[Any, Any]) -> list[dict[str, Any]] | None:
    """Entries of a mapping such as gripper2base_0, target2cam_0, gripper2base_1 …: one a pair; None for others."""
    pairs: dict[str, dict[str, Any]] = {}
    for key, value in data.items():
        short = _key(key)
        stem = short.rstrip("0123456789")
        if stem != short:
            pairs.setdefault(short[len(stem) :], {})[stem] = value
    entries = list(pairs.values())
    return entries if entries and all(_pair(entry) is not None for entry in entries) else None


def _solved_beside(entry: Mapping[Any, Any], keys: Mapping[str, Any]) -> tuple[Any, Any] | None:
    """A robot pose, and beside it the target's by the names of OpenCV's solvePnP, with or without more before them."""
    for key in keys:
        other = key.removesuffix("rvec") + "tvec"
        if key.endswith("rvec") and other in keys:
            solved = {"rvec": entry[keys[key]], "tvec": entry[keys[other]]}
            robot = {k: v for k, v in entry.items() if k not in (keys[key], keys[other])}
            return (robot, solved) if _looks_like_pose(robot) and _looks_like_pose(solved) else None
    return None


def _pose_fields(entry: Any, where: str, read_reference: Callable[[str], PoseTable]) -> tuple[Fields, Stated]:
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
        twice = sorted(set(out) & set(named))
        if twice:
            raise InputError(f"{where}: {', '.join(twice)} given twice, the second time under {key!r}")
        out |= named
        stated = Stated(**{k: v or getattr(stated, k) for k, v in vars(said).items()})
    return out, stated


def _field(key: str, value: Any, where: str, read_reference: Callable[[str], PoseTable]) -> tuple[Fields, Stated]:
    """The named numbers in one field."""
    short = _key(key)
    direction = Stated(direction=_stated_direction(short))
    if isinstance(value, Mapping):
        inner, stated = _pose_fields(value, f"{where}.{key}", read_reference)
        prefix = "" if set(inner) & set(MATRIX_NAMES) else f"{key}."
        known = {f"{prefix}{name}": cell for name, cell in inner.items()}
        # A wrapper such as "pose" or "transform" adds nothing to names that are complete without it.
        return (inner if _is_complete(inner) else known), (
            stated if stated.direction else Stated(**{**vars(stated), **vars(direction)})
        )
    if isinstance(value, list):
        flat = [cell for row in value for cell in (row if isinstance(row, list) else [row])]
        if any(isinstance(cell, Mapping | list | str) and not _numeric(cell) for cell in flat):
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
            return _pose_fields(value, where, read_reference)
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
        if not _is_matrix(values):
            raise InputError(f"{where}: rows of {lengths} numbers, expected a 4x4 matrix")
        flat = [cell for row in values for cell in row]
    else:
        flat = list(values)
    named = plain_header(len(flat))
    if named is None:
        raise InputError(
            f"{where}: {len(flat)} numbers, expected 6 or 7 (position and rotation), 12 or 16 (matrix) or named fields"
        )
    return dict(zip(named[0], flat)), named[1]


def _stated_direction(key: str) -> str | None:
    if _STATES_BASE_GRIPPER.match(key):
        return "base-gripper"
    return "gripper-base" if _STATES_GRIPPER_BASE.match(key) else None


def _numeric(cell: Any) -> bool:
    try:
        float(cell)
    except (TypeError, ValueError):
        return False
    return True


def _key(key: Any) -> str:
    return re.sub(r"[^0-9a-z]", "", str(key).lower())


def _listed_keys(data: Mapping[Any, Any]) -> str:
    return ", ".join(repr(str(k)) for k in list(data)[:8]) or "(none)"
