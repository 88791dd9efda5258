"""Poses as programs print them: controllers' own text, ROS's tf_echo, a JSON value a line.

What none of the syntaxes of `poses` reads is looked at here. Each pattern is recognised by a mark of its own, and reads
the text only when it explains every such mark: a line that it cannot read is left to the syntax's own error.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from typing import Any

from calibrant.errors import InputError
from calibrant.formats.poses.makers import FORMATS, RobotFormat, controller_text
from calibrant.formats.poses.raw import PoseOptions
from calibrant.formats.poses.rows import PoseTable
from calibrant.reading.json_text import parse_json

_N = r"\s*+([-+]?(?:\d++\.?+\d*+|\.\d++)(?:[eE][-+]?\d++)?+)\s*+"
_TF_ECHO = RobotFormat(
    "ROS",
    PoseOptions(units="m", rotation="quat-xyzw", direction="base-gripper"),
    ("x", "y", "z", "qx", "qy", "qz", "qw"),
    re.compile(
        r"Translation:\s*\[" + ",".join([_N] * 3) + r"\]\s*-\s*Rotation:\s*in Quaternion(?:\s*\(xyzw\))?\s*\["
        + ",".join([_N] * 4) + r"\]"
    ),
)  # fmt: skip


@dataclass(frozen=True)
class _Print:
    """A text by its mark, which stands once before each pose."""

    mark: re.Pattern[str]
    form: RobotFormat


_PRINTS = (
    _Print(re.compile(r"\bp\s*\["), FORMATS["ur"]),
    _Print(re.compile(r"\{[^{}]*?\bX\s"), FORMATS["kuka"]),
    _Print(re.compile(r"\brobtarget\b"), FORMATS["abb"]),
    _Print(re.compile(r"\bP\[\d+"), FORMATS["fanuc"]),
    _Print(re.compile(r"\bTranslation:"), _TF_ECHO),
)


def read_printed(text: str, source: str) -> PoseTable | None:
    """The poses in a print of a known kind; None for any other text."""
    for known in _PRINTS:
        count = len(known.mark.findall(text))
        table = controller_text(text, source, known.form) if count else None
        if table is not None and len(table.rows) == count:
            return table
    return None


def read_lines(text: str, source: str) -> list[Any] | None:
    """One JSON value a line (JSON Lines); None for any other text. Raises: InputError naming a line that is none."""
    lines = [(i, line.strip()) for i, line in enumerate(text.splitlines(), start=1) if line.strip()]
    if len(lines) < 2 or not all(line[0] + line[-1] in ("{}", "[]") for _, line in lines):
        return None
    try:
        parse_json(lines[0][1])
    except (json.JSONDecodeError, InputError):
        return None
    from calibrant.formats.documents.opencv_storage import read_json  # YAML's library: not for tables

    # Lines above are left empty, so that an error names the line of the file.
    return [read_json("\n" * (i - 1) + line, source) for i, line in lines]


def read_documents(text: str, source: str) -> list[Any] | None:
    """YAML documents one after the other, as `rostopic echo` prints messages; None for a single one, or no YAML."""
    parts = re.split(r"(?m)^---[ \t]*$", text)
    starts = [0]
    for part in parts[:-1]:
        starts.append(starts[-1] + part.count("\n"))
    filled = [(start, part) for start, part in zip(starts, parts) if part.strip() and not part.lstrip().startswith("%")]
    if len(filled) < 2:
        return None
    from calibrant.formats.documents.opencv_storage import read_yaml  # YAML's library: not for tables

    try:
        found = [read_yaml("\n" * start + part, source) for start, part in filled]
    except InputError:
        return None
    return found if all(isinstance(document, dict | list) for document in found) else None
