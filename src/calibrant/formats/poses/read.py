"""Reading robot poses (and target poses) from any file a person could plausibly hand in.

`read_poses` reads the numbers and what the file says about them; `notations` lists what they can mean;
`diagnose.conventions.decide` chooses among these by the data. A syntax is a file of its own and an entry of READERS.
"""

from __future__ import annotations

import glob
import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from calibrant.data.file_names import distinct_names
from calibrant.errors import InputError
from calibrant.formats.poses.arrays import ARRAYS, read_arrays
from calibrant.formats.poses.blocks import read_blocks
from calibrant.formats.poses.columns import is_header
from calibrant.formats.poses.documents import read_document
from calibrant.formats.poses.joint_columns import joints_in, poses_from_joints
from calibrant.formats.poses.makers import (
    RobotFormat,
    controller_text,
    in_format,
    merged,
    refuse_other_units,
    robot_format,
)
from calibrant.formats.poses.natural_order import natural_key
from calibrant.formats.poses.notations import PoseNotation as PoseNotation
from calibrant.formats.poses.notations import every_notation as every_notation
from calibrant.formats.poses.notations import excluded as excluded
from calibrant.formats.poses.notations import notations as notations
from calibrant.formats.poses.notations import options as options
from calibrant.formats.poses.prints import read_documents, read_lines, read_printed
from calibrant.formats.poses.raw import RawPoses as RawPoses
from calibrant.formats.poses.results import poses_of_result
from calibrant.formats.poses.rows import PoseTable, header_of, raw_poses
from calibrant.formats.poses.text import read_labelled_pairs, read_text_table
from calibrant.formats.poses.time_column import times_beside, without_times
from calibrant.reading.files import TEXT, decoded, read_bytes
from calibrant.reading.notes import heard, note, note_unused
from calibrant.reading.python_print import read_python
from calibrant.robots.chain import KinematicChain

Parsed = tuple[PoseTable, PoseTable | None]
_REFERENCES = 3
"""Files that name each other one after the other: a list of poses' files needs one step."""


def read_poses(
    paths: str | Path | Iterable[str | Path],
    *,
    units: str = "auto",
    rotation: str = "auto",
    angle: str = "auto",
    direction: str = "auto",
    robot: KinematicChain | None = None,
    joint_angle: str = "auto",
    maker: str | None = None,
) -> RawPoses:
    """Raw poses from one file, or one file a pose: a list of paths, a folder, or a pattern such as poses/*.yaml.

    Files a pose are put in natural order and named by their stem. The options say how the numbers are to be read and
    go with the result to `notations`: units m, mm; rotation quat-xyzw, quat-wxyz, rotvec, euler:ZYX (any of the 24
    orders), matrix; angle deg, rad; direction base-gripper (T_base_gripper), gripper-base; each auto by default.

    With a `robot` the files hold joint values (columns q1, q2 … or the joints' names), and its forward kinematics gives
    the poses; joint_angle deg, rad, or auto: by the limits. `maker` (ur, kuka …; robot_formats) sets the options that
    are left at auto and reads the controller's own text.

    Raises: InputError naming file and line (or entry) for whatever is not a pose, and for unknown options.
    """
    asked = options(units=units, rotation=rotation, angle=angle, direction=direction)
    fmt = None if maker is None else robot_format(maker)
    table, target = read_table(paths, fmt)
    if robot is not None:
        raw = replace(poses_from_joints(table, robot, angle=joint_angle), times=times_beside(table))
        return _said(raw if target is None else replace(raw, target=raw_poses(target)))
    if joints_in(table, None) is not None and not is_header(table.header):
        raise InputError(
            f"{table.source}: joint values without poses; say which robot they are of (--robot FILE, a URDF or DH "
            "table), and its forward kinematics gives the poses"
        )
    raw = replace(raw_poses(table), times=times_beside(table))
    if fmt is not None:
        refuse_other_units(raw, fmt, asked)
        asked = options(**vars(merged(asked, fmt)))
    raw = replace(raw, options=asked)
    return _said(raw if target is None else replace(raw, target=raw_poses(target)))


def _said(raw: RawPoses) -> RawPoses:
    """The poses, once it is said how they were read and what of their file was not used."""
    for half in (raw, raw.target):
        if half is None:
            continue
        for words in half.notes:
            note(f"{half.source}: {words}")
        note_unused(half.source, without_times(half.unused) if half.times is not None else half.unused)
    return raw


def read_table(paths: str | Path | Iterable[str | Path], fmt: RobotFormat | None = None) -> Parsed:
    """The table of one file, or of one file a pose, and that of target poses where it holds pairs."""
    files = files_of(paths)
    table, target = _parse(files[0], fmt) if len(files) == 1 else _joined(files, fmt)
    return (table if fmt is None else in_format(table, fmt)), target


def refuse_ambiguous(raw: RawPoses) -> None:
    """Raises: InputError for three numbers a rotation without a word on what they are: they could be anything."""
    stated, asked = raw.stated, raw.options
    three = raw.rotation.ndim == 2 and raw.rotation.shape[1] == 3
    if three and stated.rotation is None and asked.rotation == "auto":
        raise InputError(
            f"{raw.source}: three numbers a rotation, and nothing says what they are; say it: --pose-rotation rotvec, "
            "euler:ZYX …, or --robot-format ur, kuka …"
        )
    if three and stated.angle is None and asked.angle == "auto" and len({r.angle for r in notations(raw)}) > 1:
        raise InputError(f"{raw.source}: rotations in degrees or radians? Say it: --pose-angle deg or rad")


def files_of(paths: str | Path | Iterable[str | Path]) -> list[Path]:
    """The files meant by paths, folders and patterns, in natural order; a single file stands alone."""
    given = [paths] if isinstance(paths, str | Path) else list(paths)
    if not given:
        raise InputError("no file of poses given")
    files: list[Path] = []
    for item in given:
        path = Path(item)
        if path.is_dir():
            found = [p for p in path.iterdir() if p.is_file() and p.suffix.lower() in SUFFIXES]
            if not found:
                raise InputError(f"{path}: a folder without pose files; expected files {', '.join(SUFFIXES)}")
        elif path.exists():
            found = [path]
        else:
            found = [Path(name) for name in glob.glob(str(item))]
            if not found:
                raise InputError(
                    f"{item}: no such file, and no file matches it as a pattern; check the path of the poses"
                )
        files += found
    return sorted(dict.fromkeys(files), key=lambda p: natural_key(str(p)))


def _joined(files: list[Path], fmt: RobotFormat | None) -> Parsed:
    """One table from files of one pose each, named by their stems, and one of target poses where each holds a pair."""
    parsed = []
    with heard() as notes:
        for path in files:
            table, target = _parse(path, fmt)
            if len(table.rows) != 1:
                raise InputError(
                    f"{path}: {len(table.rows)} poses; where several files are given, each holds one pose; "
                    "give one file alone, or files of one pose"
                )
            parsed.append((table, target))
    if notes:
        note(notes[0] if len(notes) == 1 else f"{notes[0]} (and so in other files: {len(notes)} notes)")
    alone = [path for path, (_, target) in zip(files, parsed) if target is None]
    if 0 < len(alone) < len(files):
        raise InputError(
            f"{alone[0]}: a robot pose without a target pose, which other files have; {len(alone)} of {len(files)} "
            "files are like that: leave them out"
        )
    targets = [target for _, target in parsed if target is not None]
    return _one_table(files, [table for table, _ in parsed]), _one_table(files, targets) if targets else None


def _one_table(files: list[Path], tables: list[PoseTable]) -> PoseTable:
    """The tables of one row each as one; bare numbers are named by what all files hold."""
    tables = _named_alike(tables)
    header = tables[0].header
    rows = []
    for path, table in zip(files, tables):
        if sorted(table.header) != sorted(header):
            raise InputError(
                f"{path}: has {', '.join(table.header)}; the first file, {files[0].name}, has {', '.join(header)}; "
                "expected the same fields in every file"
            )
        rows.append(tuple(table.rows[0][table.header.index(column)] for column in header))
    places = tuple(table.places[0] for table in tables)
    names = tuple(name.removesuffix(path.suffix) for path, name in distinct_names(files).items())
    return replace(
        tables[0], rows=tuple(rows), places=places, names=names, source=f"{files[0].parent} ({len(files)} files)"
    )


def _named_alike(tables: list[PoseTable]) -> list[PoseTable]:
    """Tables of bare numbers with one set of names: one pose alone may not tell that its rotation stands first."""
    if not all(t.bare and len(t.header) == len(tables[0].header) for t in tables):
        return tables
    named = header_of([t.rows[0] for t in tables])
    return tables if named is None else [replace(t, header=named[0], stated=named[1]) for t in tables]


def _parse(path: Path, fmt: RobotFormat | None = None, above: tuple[Path, ...] = ()) -> Parsed:
    """The tables of one file. Args: above: the files whose entries led here."""
    if path.suffix.lower() in ARRAYS:
        return _read_data(read_arrays(path), path, above)
    text = decoded(
        read_bytes(path, most=TEXT, what="pose file"),
        path,
        what="pose file",
        expected=f"poses in one of {', '.join(SUFFIXES)}",
        latin=True,
    )
    if not text.strip():
        raise InputError(f"{path}: no poses: the file is empty")
    native = None if fmt is None else controller_text(text, str(path), fmt)
    if native is not None:
        return native, None
    documents = read_documents(text, str(path))
    if documents is not None:
        return _read_data(documents, path, above)
    reader = READERS.get(path.suffix.lower(), _read_unknown)
    try:
        found = reader(text, path)
    except InputError:
        other = _printed(text, path, above)
        if other is None:
            raise
        return other
    if isinstance(found, _Data):
        return _read_data(found.value, path, above)
    parsed = found
    # A line of a controller's text passes for a header, which then names no pose.
    other = None if is_header(parsed[0].header) else _printed(text, path, above)
    return parsed if other is None else other


def _printed(text: str, path: Path, above: tuple[Path, ...]) -> Parsed | None:
    """The poses in a text as programs print and log them; None for all others."""
    printed = read_printed(text, str(path))
    if printed is not None:
        return printed, None
    value = read_python(text)
    if isinstance(value, dict | list):
        return _read_data(value, path, above)
    return read_blocks(text, str(path))


@dataclass(frozen=True)
class _Data:
    """What a document holds, before its poses are looked for."""

    value: Any


def _read_text(text: str, path: Path) -> Parsed:
    pairs = read_labelled_pairs(text, str(path))
    return (read_text_table(text, str(path)), None) if pairs is None else pairs


def _read_json(text: str, path: Path) -> _Data:
    from calibrant.formats.documents.opencv_storage import read_json  # YAML's library: not for tables

    lines = read_lines(text, str(path))
    return _Data(read_json(text, str(path)) if lines is None else lines)


def _read_yaml(text: str, path: Path) -> _Data:
    from calibrant.formats.documents.opencv_storage import read_yaml  # YAML's library: not for tables

    return _Data(read_yaml(text, str(path)))


def _read_xml(text: str, path: Path) -> _Data:
    from calibrant.formats.documents.opencv_storage import read_xml  # YAML's library: not for tables

    return _Data(read_xml(text, str(path)))


def _read_unknown(text: str, path: Path) -> Parsed | _Data:
    """A file whose suffix says nothing: by its first character or line."""
    start = text.lstrip()
    if start.startswith(("{", "[")):
        return _read_json(text, path)
    if start.startswith("<"):
        return _read_xml(text, path)
    if start.startswith(("%YAML", "---", "- ")):
        return _read_yaml(text, path)
    return _read_text(text, path)


def _read_data(data: Any, path: Path, above: tuple[Path, ...] = ()) -> Parsed:
    """The tables of a document's poses. Raises: InputError for files whose entries name each other in a circle."""
    known: dict[Path, PoseTable] = {}
    here = (*above, Path(os.path.realpath(path)))

    def reference(name: str) -> PoseTable:
        other = path.parent / name
        if Path(os.path.realpath(other)) in here:
            raise InputError(f"{path}: names {name} as the file of a pose, which leads back to it")
        if len(here) > _REFERENCES:
            raise InputError(
                f"{path}: names {name} as the file of a pose, as {len(here)} files before it do; expected one"
            )
        if other not in known:
            known[other] = _parse(other, above=here)[0]
        return known[other]

    if isinstance(data, dict) and str(data.get("format", "")).startswith("calibrant/"):
        return poses_of_result(path)
    return read_document(_plain(data), str(path), read_reference=reference)


def _plain(data: Any) -> Any:
    """Arrays of OpenCV's files as lists: a stack of 4x4 matrices as a list of matrices."""
    if isinstance(data, np.ndarray):
        data = data[..., 0] if data.ndim == 3 and data.shape[2] == 1 else data
        stacked = data.ndim == 2 and data.shape[1] == 4 and data.shape[0] > 4 and data.shape[0] % 4 == 0
        array = data.reshape(-1, 4, 4) if stacked else data.ravel() if 1 in data.shape else data
        return array.tolist()
    if isinstance(data, dict):
        return {key: _plain(value) for key, value in data.items()}
    return [_plain(value) for value in data] if isinstance(data, list) else data


READERS: dict[str, Callable[[str, Path], Parsed | _Data]] = {
    ".csv": _read_text,
    ".tsv": _read_text,
    ".txt": _read_unknown,
    ".dat": _read_unknown,
    ".json": _read_json,
    ".jsonl": _read_json,
    ".yaml": _read_yaml,
    ".yml": _read_yaml,
    ".xml": _read_xml,
}
"""Reader of a pose file by its suffix; any other suffix is judged by its content."""
SUFFIXES = (*READERS, *ARRAYS)
