"""Poses in text tables: CSV and its relatives, 4x4 matrices as plain lines of numbers, rows that alternate in pairs."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence

from calibrant.errors import InputError
from calibrant.formats.poses.columns import is_header
from calibrant.formats.poses.rows import MATRIX_NAMES, Cell, PoseTable, bottom_rows, header_of, upright

_COMMENTS = ("#", "%", "//")
_ROBOT_ROW = re.compile(r"(?:hand|robot|gripper|flange|tool|tcp|eef?|effector)\s*[:,;\s]\s*", re.IGNORECASE)
_TARGET_ROW = re.compile(r"(?:eye|camera|cam|target|marker|board|object)\s*[:,;\s]\s*", re.IGNORECASE)
Line = tuple[int, list[str]]


def read_labelled_pairs(text: str, source: str) -> tuple[PoseTable, PoseTable] | None:
    """The robot's and the target's poses of a text whose rows say whose they are (hand, …; eye, …); else None."""
    rows: tuple[list[str], list[str]] = ([], [])
    for line in text.splitlines():
        found = [pattern.match(line.strip()) for pattern in (_ROBOT_ROW, _TARGET_ROW)]
        if line.strip() and not any(found):
            return None
        # The other side's rows are left empty, so that an error names the line of the file.
        for of_side, match in zip(rows, found):
            of_side.append(line.strip()[match.end() :] if match else "")
    if not all(any(of_side) for of_side in rows):
        return None
    robot, target = (read_text_table("\n".join(of_side), source) for of_side in rows)
    return robot, target


def read_text_table(text: str, source: str) -> PoseTable:
    """The table in a text: comma, semicolon, tab or spaces between cells; with or without a header.

    Lines that begin with #, % or // are comments; the last one before the data is the header when it names columns.
    Raises: InputError naming file and line for rows of different lengths, or numbers that make no pose.
    """
    numbered = [(i, line.strip()) for i, line in enumerate(text.splitlines(), start=1) if line.strip(" \t,;")]
    comments = [(i, line) for i, line in numbered if line.startswith(_COMMENTS)]
    content = [(i, line) for i, line in numbered if not line.startswith(_COMMENTS)]
    if not content:
        raise InputError(f"{source}: no poses: the file is empty or holds comments only")
    separator = _separator([line for _, line in content])
    lines = _in_rows([(i, _cells(line, separator)) for i, line in content])
    header: list[str] | None = None
    if not any(_is_number(cell) for cell in lines[0][1]):
        header, lines = _trimmed(lines[0][1], 1), lines[1:]
        if not lines:
            raise InputError(f"{source}: a header but no poses under it")
    elif comments and comments[-1][0] < lines[0][0]:
        named = _cells(comments[-1][1].lstrip("#%/ \t"), separator)
        header = named if len(named) == len(lines[0][1]) and is_header(named) else None
    if header is None and len(lines[0][1]) == 4 and len(lines) % 4 == 0 and _numbers_only(lines):
        return _stacked_matrices(lines, source)
    first = len(header) if header is not None else len(lines[0][1])
    lines = [(i, _trimmed(cells, first)) for i, cells in lines]
    _refuse_ragged(lines, first, "the header" if header is not None else f"line {lines[0][0]}", source)
    places = tuple(f"{source}:{i}" for i, _ in lines)
    if header is not None:
        return PoseTable(tuple(header), tuple(tuple(cells) for _, cells in lines), places, source)
    return _without_header(lines, places, source)


def _in_rows(lines: list[Line]) -> list[Line]:
    """The lines without a count of poses above them; a pose whose numbers stand one under the other as one row."""
    single = [len(cells) == 1 for _, cells in lines]
    if all(single) and len(lines) in (6, 7, 12, 16) and _numbers_only(lines):
        return [(lines[0][0], [cell for _, cells in lines for cell in cells])]
    count = lines[0][1][0]
    counted = single[0] and len(lines) > 1 and not any(single[1:]) and count.isdecimal()
    return lines[1:] if counted and int(count) in (len(lines) - 1, (len(lines) - 1) / 4) else lines


def _without_header(lines: Sequence[Line], places: tuple[str, ...], source: str) -> PoseTable:
    rows: list[tuple[Cell, ...]] = [tuple(cells) for _, cells in lines]
    names: tuple[str, ...] | None = None
    for column, rest in ((0, slice(1, None)), (-1, slice(None, -1))):
        if not any(_is_number(str(row[column])) for row in rows):
            names, rows = tuple(str(row[column]) for row in rows), [row[rest] for row in rows]
            break
    named = header_of(rows)
    if named is None:
        raise InputError(
            f"{places[0]}: {len(rows[0])} numbers and no header; expected 6 or 7 (position and rotation), 12 or 16 "
            "(matrix); add a header such as image,x,y,z,qx,qy,qz,qw, or say whose text it is: --robot-format ur, kuka …"
        )
    header, stated = named
    notes: tuple[str, ...] = ()
    if header[-1] == MATRIX_NAMES[-1]:
        lead = len(header) - 16
        turned, note = upright([row[lead:] for row in rows])
        bottom_rows(turned, places)
        rows = [(*row[:lead], *cells) for row, cells in zip(rows, turned)]
        notes = (note,) if note else ()
    return PoseTable(header, tuple(rows), places, source, names=names, stated=stated, notes=notes, bare=True)


def _stacked_matrices(lines: Sequence[Line], source: str) -> PoseTable:
    """4x4 matrices one under the other."""
    matrices = [[cell for _, cells in lines[k : k + 4] for cell in cells] for k in range(0, len(lines), 4)]
    for i, cells in lines:
        if len(cells) != 4:
            raise InputError(f"{source}:{i}: {len(cells)} numbers, expected 4 a line (4x4 matrices)")
    places = tuple(f"{source}:{lines[k][0]}" for k in range(0, len(lines), 4))
    turned, note = upright(matrices)
    bottom_rows(turned, places)
    return PoseTable(MATRIX_NAMES, turned, places, source, notes=(note,) if note else ())


def _separator(lines: Sequence[str]) -> str | None:
    """The character between cells: the first of ; tab , that occurs in the first line; None for blanks."""
    return next((mark for mark in (";", "\t", ",") if mark in lines[0]), None)


def _cells(line: str, separator: str | None) -> list[str]:
    if separator is None:
        return line.split()
    try:
        row = next(csv.reader([line], delimiter=separator, skipinitialspace=True))
    except csv.Error as error:
        raise InputError(f"a line that is no row of a table ({error}): {line[:40]!r} …") from None
    cells = [cell.strip() for cell in row]
    if separator == ",":
        return cells
    # Where the comma does not separate cells it can only be the decimal comma.
    return [cell.replace(",", ".") if _is_number(cell.replace(",", ".")) else cell for cell in cells]


def _trimmed(cells: list[str], length: int) -> list[str]:
    """The cells without the empty ones that a separator at the end of the line adds."""
    while len(cells) > length and not cells[-1]:
        cells = cells[:-1]
    return cells


def _refuse_ragged(lines: Sequence[Line], length: int, reference: str, source: str) -> None:
    for i, cells in lines:
        if len(cells) != length:
            raise InputError(f"{source}:{i}: {len(cells)} cells, expected {length} as in {reference}")


def _numbers_only(lines: Sequence[Line]) -> bool:
    return all(_is_number(cell) for _, cells in lines for cell in cells)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
