"""Poses as the makers of robots write them: `--robot-format ur` and its like.

Each says the unit, the notation of rotations and the order of bare numbers, and where a controller's own text has poses
in it (UR script, KRL, RAPID, Fanuc's LS files) how to find them there.

Sources: Universal Robots script manual, `pose` (metres, axis times angle in radians); libfranka, `RobotState::O_T_EE`
(4x4 matrix, 16 numbers by columns, metres); KUKA KSS programming manual, FRAME (millimetres, degrees; A about z, B
about the new y, C about the newest x); Fanuc, XYZWPR (millimetres, degrees; W, P, R about fixed x, y, z); ABB RAPID
reference, `robtarget` and `orient` (millimetres; q1 the scalar); in millimetres and degrees too: Yaskawa (Rx, Ry, Rz
about fixed x, y, z), Stäubli VAL 3 (Rx, Ry, Rz about moving x, y, z), Kawasaki AS (O, A, T about moving z, y, z).
"""

from __future__ import annotations

import re
from bisect import bisect_left
from dataclasses import dataclass, replace

from calibrant.errors import InputError
from calibrant.formats.poses.raw import NOTHING_STATED, PoseOptions, RawPoses
from calibrant.formats.poses.rows import MATRIX_NAMES, PoseTable

_N = r"\s*+([-+]?(?:\d++\.?+\d*+|\.\d++)(?:[eE][-+]?\d++)?+)\s*+"
# Names and what stands between are bounded: a text of nothing but beginnings would else be walked once for each.
_NAME = r"(?:(?P<name>[A-Za-z_$][\w$\[\]]{0,63})\s{0,20}:?=\s{0,20})?"


@dataclass(frozen=True)
class RobotFormat:
    """A maker's way to write poses: columns of bare numbers, how they are read, and the pattern of its own text."""

    maker: str
    options: PoseOptions
    columns: tuple[str, ...]
    text: re.Pattern[str] | None = None


def _euler(order: str) -> PoseOptions:
    return PoseOptions(units="mm", rotation=f"euler:{order}", angle="deg", direction="base-gripper")


def _named(names: str, separator: str, unit: str = "") -> str:
    return separator.join(rf"{name}\s*=?{_N}{unit if i < 3 else unit and '(?:deg)?'}" for i, name in enumerate(names))


FORMATS: dict[str, RobotFormat] = {
    "ur": RobotFormat(
        "Universal Robots",
        PoseOptions(units="m", rotation="rotvec", angle="rad", direction="base-gripper"),
        ("x", "y", "z", "rx", "ry", "rz"),
        re.compile(_NAME + r"p\s{0,20}\[" + ",".join([_N] * 6) + r"\]"),
    ),
    "franka": RobotFormat(
        "Franka",
        PoseOptions(units="m", rotation="matrix", direction="base-gripper"),
        tuple(MATRIX_NAMES[4 * (k % 4) + k // 4] for k in range(16)),
    ),
    "kuka": RobotFormat(
        "KUKA",
        _euler("ZYX"),
        ("x", "y", "z", "a", "b", "c"),
        re.compile(_NAME + r"\{\s*(?:(?:E6)?(?:POS|FRAME)\s*:)?\s*" + _named("XYZABC", r"\s*,\s*") + r"[,}]"),
    ),
    "fanuc": RobotFormat(
        "Fanuc",
        _euler("xyz"),
        ("x", "y", "z", "w", "p", "r"),
        re.compile(
            r"(?:(?P<name>P\[\d{1,9})[^{}]{0,200}\{[^{}]{0,500}?)?" + _named("XYZWPR", r"\s*,\s*", r"(?:mm)?"),
            re.DOTALL,
        ),
    ),
    "abb": RobotFormat(
        "ABB",
        PoseOptions(units="mm", rotation="quat-wxyz", direction="base-gripper"),
        ("x", "y", "z", "q1", "q2", "q3", "q4"),
        re.compile(_NAME + r"\[\s*\[" + ",".join([_N] * 3) + r"\]\s*,\s*\[" + ",".join([_N] * 4) + r"\]"),
    ),
    "yaskawa": RobotFormat("Yaskawa", _euler("xyz"), ("x", "y", "z", "rx", "ry", "rz")),
    "staubli": RobotFormat("Stäubli", _euler("XYZ"), ("x", "y", "z", "rx", "ry", "rz")),
    "kawasaki": RobotFormat("Kawasaki", _euler("ZYZ"), ("x", "y", "z", "o", "a", "t")),
}


def robot_format(name: str) -> RobotFormat:
    """The format of that name. Raises: InputError listing the known ones."""
    if name.lower() not in FORMATS:
        raise InputError(f"unknown robot format {name!r}; known: {', '.join(FORMATS)}")
    return FORMATS[name.lower()]


def controller_text(text: str, source: str, fmt: RobotFormat) -> PoseTable | None:
    """Poses in a controller's own text, with their names and lines; None where it has none."""
    found = [] if fmt.text is None else list(fmt.text.finditer(text))
    if not found:
        return None
    ends = [i for i, character in enumerate(text) if character == "\n"]
    lines = [bisect_left(ends, m.start()) + 1 for m in found]
    first = 2 if fmt.text is not None and "name" in fmt.text.groupindex else 1
    rows = tuple(m.groups()[first - 1 :] for m in found)
    names = [str(m["name"] or "").replace("P[", "P") for m in found] if first == 2 else []
    named = tuple(names) if names and all(names) and len(set(names)) == len(names) else None
    return PoseTable(fmt.columns, rows, tuple(f"{source}:{i}" for i in lines), source, names=named)


def in_format(table: PoseTable, fmt: RobotFormat) -> PoseTable:
    """A table of bare numbers with the maker's columns; a table with names of its own stays as it is."""
    plain = {6: ("x", "y", "z", "e1", "e2", "e3"), 7: ("x", "y", "z", "q0", "q1", "q2", "q3"), 16: MATRIX_NAMES}
    count = len(fmt.columns)
    # A list of 16 by columns has been turned by its bottom row already, where that row tells.
    if count == 16 or tuple(table.header[-count:]) != plain[count]:
        return table
    lead = table.header[: len(table.header) - count]
    return replace(table, header=(*lead, *fmt.columns), stated=NOTHING_STATED, bare=False)


def refuse_other_units(raw: RawPoses, fmt: RobotFormat, asked: PoseOptions) -> None:
    """What a file's own names state is not overruled by a maker's habit. Raises: InputError naming both."""
    for what, said, own, option in (
        ("positions", raw.stated.units, fmt.options.units, asked.units),
        ("angles", raw.stated.angle, fmt.options.angle, asked.angle),
    ):
        if said is not None and option == "auto" and own not in ("auto", said):
            raise InputError(
                f"{raw.source}: the file says its {what} are in {said}, a text of {fmt.maker} has them in {own}: leave "
                f"--robot-format out, or say which it is (--pose-{'units' if what == 'positions' else 'angle'})"
            )


def merged(asked: PoseOptions, fmt: RobotFormat) -> PoseOptions:
    """The maker's notation, except where the user says otherwise."""
    own = vars(fmt.options)
    return PoseOptions(**{key: own[key] if value == "auto" else value for key, value in vars(asked).items()})
