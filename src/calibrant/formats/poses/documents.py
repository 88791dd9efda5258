"""Poses in JSON and YAML: lists or named groups of fields, nested as ROS nests them, matrices, pairs of poses."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from calibrant.errors import InputError
from calibrant.formats.poses.document_fields import (
    dropped,
    is_matrix,
    looks_like_pose,
    pose_fields,
    spelled,
    stated_direction,
)
from calibrant.formats.poses.document_pairs import numbered, pair_of, side_by_side
from calibrant.formats.poses.raw import NOTHING_STATED, Stated
from calibrant.formats.poses.rows import MATRIX_NAMES, PoseTable, bottom_rows, entry_of, upright
from calibrant.reading.notes import note_unused


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
    pairs = [pair_of(entry) for entry in entries]
    if all(pair is not None for pair in pairs):
        robot, target = ([pair[k] for pair in pairs if pair is not None] for k in (0, 1))
        if isinstance(entries[0], Mapping) and pairs[0] is not None:
            halves = {key for half in pairs[0] if isinstance(half, Mapping) for key in half}
            note_unused(source, (str(key) for key in entries[0] if key not in halves and str(key) not in pairs[0][2]))
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
    keys = {spelled(k): k for k in data}
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
    fields = [pose_fields(entry, where, read_reference) for entry, where in zip(entries, places)]
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
    note_unused(source, dropped(entries[0]))
    merged = Stated(**{key: getattr(found, key) or value for key, value in vars(stated).items()})
    bare = all(isinstance(e, list) and len(e) == 6 for e in entries)
    return PoseTable(header, rows, places, source, names=names, stated=merged, notes=notes, keyed=True, bare=bare)


def _entries(data: Any, source: str) -> tuple[list[Any], tuple[str, ...] | None, Stated]:
    """The entries of a document, one a pose, their names when they are a mapping's keys, what a key states."""
    if isinstance(data, Mapping):
        keys = {spelled(k): k for k in data}
        if looks_like_pose(data):
            return [data], None, NOTHING_STATED
        if len(data) == 1 or not all(isinstance(v, Mapping | list) and looks_like_pose(v) for v in data.values()):
            # {"poses": [...]} and its like: the one value that holds several poses.
            inner = [(k, v) for k, v in data.items() if isinstance(v, Mapping | list) and len(v) > 0]
            lists = [(k, v) for k, v in inner if isinstance(v, list) and any(isinstance(e, Mapping | list) for e in v)]
            lists = lists if len(lists) == 1 else [(k, v) for k, v in lists if _holds_poses(v)]
            chosen = lists if len(lists) == 1 else inner if len(inner) == 1 else []
            if chosen and not (len(data) == 1 and looks_like_pose(chosen[0][1])):
                entries, names, stated = _entries(chosen[0][1], source)
                note_unused(source, (str(key) for key in data if key != chosen[0][0]))
                return (
                    entries,
                    names,
                    stated if stated.direction else Stated(direction=stated_direction(spelled(chosen[0][0]))),
                )
        pairs = numbered(data, source) or side_by_side(data, source)
        if pairs is not None:
            return list(pairs), None, NOTHING_STATED
        if keys and all(isinstance(v, Mapping | list) for v in data.values()):
            return list(data.values()), tuple(str(k) for k in data), NOTHING_STATED
        raise InputError(
            f"{source}: no poses under the keys {_listed_keys(data)}; expected a list of poses, or fields x, y, z, …"
        )
    if isinstance(data, list):
        if data and (not any(isinstance(v, Mapping | list) for v in data) or is_matrix(data)):
            return [data], None, NOTHING_STATED
        return data, None, NOTHING_STATED
    found = {bool: "true or false", int: "a number", float: "a number", str: "text", type(None): "nothing (null)"}
    raise InputError(f"{source}: holds {found.get(type(data), type(data).__name__)}, expected a list of poses")


def _holds_poses(values: list[Any]) -> bool:
    """Whether every entry of a list is a pose, or a pair; the rows of a camera's matrix are none."""
    return all(looks_like_pose(value) or pair_of(value) is not None for value in values)


def _listed_keys(data: Mapping[Any, Any]) -> str:
    return ", ".join(repr(str(k)) for k in list(data)[:8]) or "(none)"
