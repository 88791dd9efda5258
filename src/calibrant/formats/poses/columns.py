"""What the columns of a pose table mean, from their names.

A name is taken apart into words, a unit (`X[mm]`, `rx (deg)`, `tx_m`) and a role: a coordinate, a part of a quaternion,
an angle about an axis, an element of a matrix, the pose's name. What the names settle is kept apart from what is only
likely, so that the data may overrule the latter in silence and the former only with a word.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from calibrant.errors import InputError
from calibrant.formats.poses.raw import Stated

LENGTH_UNITS: Mapping[str, float] = {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "in": 0.0254}
"""Metres in one unit."""

_UNIT_NAMES = {
    **dict.fromkeys(("m", "meter", "meters", "metre", "metres"), "m"),
    **dict.fromkeys(("mm", "millimeter", "millimeters", "millimetre", "millimetres"), "mm"),
    **dict.fromkeys(("cm", "centimeter", "centimeters", "centimetre", "centimetres"), "cm"),
    **dict.fromkeys(("in", "inch", "inches"), "in"),
    **dict.fromkeys(("deg", "degree", "degrees", "°"), "deg"),
    **dict.fromkeys(("rad", "radian", "radians"), "rad"),
}
_IN_BRACKETS = re.compile(r"^(?P<name>.*?)\s*[\[(]\s*(?P<unit>[^\])]*?)\s*[\])]\s*$")
_AS_SUFFIX = re.compile(r"^(?P<name>.+?)[_ .](?P<unit>mm|m|cm|in|deg|rad|degrees|radians)$", re.IGNORECASE)

_LISTED = 30
"""Columns in a message."""
_LONGEST_NAME = 200
"""Letters of a column's name; a longer one is no name, and patterns take their time with it."""

_PREFIX = r"(?:field|pose|robot|actual|tcp|tool|flange|gripper|wrist|eef|ee|transform)*"
_SPACE = r"(?:orientation|orient|ori|rotation|rot)?"
_ROLES: tuple[tuple[re.Pattern[str], str], ...] = tuple(
    (re.compile(f"^{_PREFIX}{pattern}$"), role)
    for pattern, role in (
        (r"(?:position|pos|translation|trans|tvec|p|t)*([xyz])", "t{}"),
        (_SPACE + r"(?:quaternion|quat|q)([xyzw])", "q{}"),
        (_SPACE + r"(?:quaternion|quat|q)([0-4])", "q{}"),
        (_SPACE + r"(?:rotvec|rvec|rotationvector|axisangle)([xyz])", "v{}"),
        (_SPACE + r"(?:euler|eul|angle|rpy)?(roll|pitch|yaw)", "{}"),
        (r"(?:orientation|orient|ori|rotation|rot|euler|eul|angle|r)+([xyzw])", "r{}"),
        (r"(?:euler|eul|angle|e|r)([1-3])", "e{}"),
        (r"(?:rotation|rot|matrix|r|m|t|h)([0-4])([0-4])", "m{}{}"),
        (r"(alpha|beta|gamma|[abcwpot]|r)", "{}"),
    )
)
_NAME_COLUMNS = (
    *("image", "img", "imagename", "imagefile", "imagepath", "photo", "picture"),
    *("file", "filename", "filepath", "path", "name", "label", "posename", "view", "moment", "sample"),
    *("id", "poseid", "pose", "index", "idx", "no", "nr", "num", "number", "frame", ""),
)
"""Names of the column that names the pose, the best first; the empty one is a table's unnamed index."""

_THREE_NAMED: tuple[tuple[tuple[str, ...], Stated], ...] = (
    # Rotation vectors by name; ROS and URDF: roll about x, pitch about y, yaw about z, about fixed axes, in this order.
    (("vx", "vy", "vz"), Stated(rotation="rotvec")),
    (("roll", "pitch", "yaw"), Stated(rotation="euler:xyz", axes="xyz")),
    # KUKA: A about z, B about the new y, C about the newest x, degrees.
    (("a", "b", "c"), Stated(rotation="euler:ZYX", axes="zyx", angle="deg")),
    # Fanuc: W about x, P about y, R about z, fixed axes, degrees.
    (("w", "p", "r"), Stated(rotation="euler:xyz", axes="xyz", angle="deg")),
    # Kawasaki: O about z, A about the new y, T about the newest z, degrees.
    (("o", "a", "t"), Stated(rotation="euler:ZYZ", angle="deg")),
    (("rx", "ry", "rz"), Stated(axes="xyz")),
    (("alpha", "beta", "gamma"), Stated()),
    (("e1", "e2", "e3"), Stated()),
)
_YAW_FIRST = Stated(rotation="euler:ZYX", axes="zyx")


@dataclass(frozen=True)
class Layout:
    """Positions of the columns that make a pose, and what their names state. rotation: 3, 4 or 9 columns."""

    name: int | None
    translation: tuple[int, ...]
    rotation: tuple[int, ...]
    stated: Stated
    passed_over: tuple[str, ...] = ()


def layout_of(header: Sequence[str]) -> Layout:
    """What the columns mean. Raises: InputError saying which columns were found and which are expected."""
    roles: dict[str, int] = {}
    units: dict[int, str] = {}
    names: dict[str, int] = {}
    unknown: list[int] = []
    for i, column in enumerate(header):
        key, unit = name_and_unit(column)
        role = _role(key)
        if key in _NAME_COLUMNS:
            names.setdefault(key, i)
        elif role is None:
            unknown.append(i)
        elif role in roles:
            raise InputError(f"two columns mean the same: {header[roles[role]]!r} and {column!r}; rename or remove one")
        else:
            roles[role] = i
            units[i] = unit
    translation, rotation, stated = _assigned(roles, header)
    used = {*translation, *rotation}
    name = next((names[key] for key in _NAME_COLUMNS if key in names), None)
    # The last row of a 4x4 matrix is part of it, though it says nothing.
    unused = {i for role, i in roles.items() if i not in used and not role.startswith("m")}
    passed_over = tuple(header[i].strip() for i in sorted({*unknown, *unused}))
    length = _one_unit(header, translation, units, tuple(LENGTH_UNITS))
    angle = _one_unit(header, rotation, units, ("deg", "rad"))
    stated = Stated(length, stated.rotation, stated.axes, stated.likely, angle or stated.angle)
    return Layout(name, translation, rotation, stated, passed_over)


def position_columns(header: Sequence[str]) -> tuple[tuple[int, ...], str | None]:
    """Columns of a position that stands alone, and its unit. Raises: InputError when there is none."""
    roles = {_role(name_and_unit(column)[0]): i for i, column in enumerate(header)}
    missing = [axis for axis in "xyz" if f"t{axis}" not in roles]
    if missing:
        raise InputError(f"no column for the position's {', '.join(missing)}; {_expected(header)}")
    columns = tuple(roles[f"t{axis}"] for axis in "xyz")
    return columns, _one_unit(header, columns, {i: name_and_unit(header[i])[1] for i in columns}, tuple(LENGTH_UNITS))


def unused_beside_position(header: Sequence[str]) -> list[str]:
    """Columns that are neither a position that stands alone nor a name."""
    columns, _ = position_columns(header)
    rest = [(i, column) for i, column in enumerate(header) if i not in columns]
    return [column.strip() for _, column in rest if name_and_unit(column)[0] not in _NAME_COLUMNS]


def has_rotation(header: Sequence[str]) -> bool:
    """True when some column can only belong to a rotation: then the pose must be complete."""
    return any(re.match(r"[qrevm]|roll|pitch|yaw", _role(name_and_unit(c)[0]) or "") for c in header)


def is_header(cells: Sequence[str]) -> bool:
    """True when the names of a line suffice for a position, or for the elements of a matrix."""
    roles = {_role(name_and_unit(cell)[0]) for cell in cells}
    return {"tx", "ty", "tz"} <= roles or {"m12", "m23"} <= roles


def name_and_unit(column: str) -> tuple[str, str]:
    """A column's name in small letters and digits, and the unit it states ("" for none)."""
    text = column.strip().strip("\"'")
    if len(text) > _LONGEST_NAME:
        return "", ""  # no column is called so
    match = _IN_BRACKETS.match(text) or _AS_SUFFIX.match(text)
    name, unit = (match["name"], match["unit"].lower()) if match else (text, "")
    return re.sub(r"[^0-9a-z]", "", name.lower()), unit


def _role(key: str) -> str | None:
    for pattern, role in _ROLES:
        match = pattern.match(key)
        if match:
            return role.format(*match.groups())
    return None


def _assigned(roles: dict[str, int], header: Sequence[str]) -> tuple[tuple[int, ...], tuple[int, ...], Stated]:
    """Columns of the position, columns of the rotation, what the names of the latter state."""
    for base in (0, 1):  # matrices are numbered from 0 or from 1
        grid = [[roles.get(f"m{i + base}{j + base}") for j in range(4)] for i in range(3)]
        block = [cell for row in grid for cell in row[:3] if cell is not None]
        if len(block) == 9 and not (base == 0 and "m33" in roles and "m03" not in roles):
            column = [row[3] for row in grid]
            t = [cell for cell in column if cell is not None] or [roles[k] for k in ("tx", "ty", "tz") if k in roles]
            if len(t) == 3:
                return tuple(t), tuple(block), Stated(rotation="matrix")
    missing = [axis for axis in "xyz" if f"t{axis}" not in roles]
    if missing:
        raise InputError(f"no column for the position's {', '.join(missing)}; {_expected(header)}")
    translation = tuple(roles[f"t{axis}"] for axis in "xyz")
    quaternion = _quaternion(roles)
    if quaternion is not None:
        return translation, *quaternion
    for keys, stated in _THREE_NAMED:
        if all(key in roles for key in keys):
            columns = tuple(roles[key] for key in keys)
            if keys == ("roll", "pitch", "yaw") and columns == tuple(sorted(columns, reverse=True)):
                return translation, columns[::-1], _YAW_FIRST
            return translation, columns, stated
    raise InputError(f"no complete set of columns for the rotation; {_expected(header)}")


def _quaternion(roles: dict[str, int]) -> tuple[tuple[int, ...], Stated] | None:
    """Columns of a quaternion in the file's order, or as x, y, z, w when that order has no name."""
    for letters in ("q{}", "r{}"):
        columns = {axis: roles.get(letters.format(axis)) for axis in "xyz"}
        w = roles.get(letters.format("w"), roles.get("w"))
        found = [c for c in (*columns.values(), w) if c is not None]
        if len(found) == 4:
            wxyz = (found[3], *found[:3])
            if wxyz == tuple(sorted(found)):
                return wxyz, Stated(rotation="quat-wxyz")
            return tuple(found), Stated(rotation="quat-xyzw")
    for numbers in ("0123", "1234"):
        if all(f"q{n}" in roles for n in numbers):
            # Scalar first is the habit of those who number (ABB's q1 to q4, textbooks' q0 to q3), not a rule.
            return tuple(roles[f"q{n}"] for n in numbers), Stated(likely="quat-wxyz")
    return None


def _one_unit(
    header: Sequence[str], columns: Sequence[int], units: dict[int, str], known: tuple[str, ...]
) -> str | None:
    """The unit these columns state; one for all. Raises: InputError for an unknown unit, or different ones."""
    found: set[str] = set()
    for i in columns:
        text = units.get(i, "")
        if text in ("", "-", "1"):
            continue
        unit = _UNIT_NAMES.get(text)
        if unit not in known:
            raise InputError(
                f"the unit {text!r} of column {header[i].strip()!r} is not known here; known: {', '.join(known)}"
            )
        found.add(unit)
    if len(found) > 1:
        listed = ", ".join(header[i].strip() for i in columns)
        raise InputError(f"the columns {listed} have different units; expected one unit for all")
    return found.pop() if found else None


def _expected(header: Sequence[str]) -> str:
    shown = [repr(column.strip()[:40]) for column in header[:_LISTED]]
    found, native = ", ".join(shown) + (" …" if len(header) > _LISTED else ""), "image,x,y,z,qx,qy,qz,qw"
    return (
        f"found the columns {found}; expected x, y, z and a rotation: qx, qy, qz, qw, or rx, ry, rz, "
        f"or roll, pitch, yaw, or A, B, C, or W, P, R, or a matrix r11 to r33; the native header is {native}"
    )
