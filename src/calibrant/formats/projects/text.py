"""A project as the text of its `calibrant.yaml`, and back: every key checked, every message naming its place.

The file ends with YAML's own mark of a document's end, three dots: a copy that was cut off lacks it and is refused,
for YAML that is cut between two lines is YAML all the same.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Mapping
from typing import Any

from calibrant.data.typed_json import as_json, from_json
from calibrant.errors import InputError
from calibrant.formats.projects.checks import check_project
from calibrant.formats.projects.frames import check_frames
from calibrant.formats.projects.records import Project
from calibrant.reading.files import DOCUMENT
from calibrant.targets.yaml_file import parse_yaml

NUMBER = 2
"""Of the format; a change that older programs would misread raises it, and reads the lower ones. 2: touches, bodies,
bags, joint values and clocks."""
MARK = "calibrant-project"
_END = "..."
_HEAD = "# A calibrant project; see docs/project.md. Edited by hand it stays readable: leave the last line as it is.\n"
_MOST_SHOWN = 40


def project_text(project: Project) -> str:
    """The file's text. Raises: InputError for a project that is larger than such a file may be."""
    import yaml

    data = {"format": f"{MARK}/{NUMBER}", **as_json(project)}
    text: str = (
        _HEAD
        + yaml.safe_dump(data, sort_keys=False, allow_unicode=True, width=110, default_flow_style=None)
        + f"{_END}\n"
    )
    if len(text) > DOCUMENT.size:
        raise InputError(
            f"the project would have {len(text) / 1e6:.1f} MB of text, {DOCUMENT.words} at most: name folders or "
            "patterns of images in place of every single one"
        )
    return text


def parse_project(text: str, source: str) -> Project:
    """The project in a text. Raises: InputError: cut off, no project, of a newer format, a key or value that is none,
    a name that it uses and does not have."""
    try:
        return _parsed(text)
    except InputError as error:
        raise InputError(f"{source}: {error}") from error


def _parsed(text: str) -> Project:
    whole = text.rstrip().endswith(f"\n{_END}")
    try:
        data = parse_yaml(text)
    except InputError as error:
        cut = "" if whole else f"; the file does not end with a line {_END!r} either: it was cut off"
        raise InputError(f"not a project ({error}){cut}") from None
    if not isinstance(data, Mapping):
        raise InputError("empty, or no mapping of keys; expected a project that calibrant project new has made")
    _check_format(data.get("format"))
    if not whole:
        raise InputError(
            f"it does not end with a line {_END!r}: the file was cut off. Take a whole copy, or add the line where "
            "nothing is missing"
        )
    project: Project = from_json(Project, _plain({k: v for k, v in data.items() if k != "format"}, "file"), "file")
    check_project(project)
    check_frames(project)
    return project


def is_project(data: Mapping[str, Any]) -> bool:
    """Whether a mapping says that it is a project, of any format number."""
    return str(data.get("format", "")).startswith(f"{MARK}/")


def _check_format(said: Any) -> None:
    """Raises: InputError for what is no project, or one of a newer format."""
    name, _, number = str(said).partition("/")
    if name != MARK or not number.isdecimal() or len(number) > 6 or int(number) < 1:
        raise InputError(f"its format is {str(said)[:_MOST_SHOWN]!r}, expected {MARK}/{NUMBER}: not a project")
    if int(number) > NUMBER:
        raise InputError(
            f"its format is {MARK}/{number}, of a newer calibrant; this one reads up to {MARK}/{NUMBER}. Update it: "
            "pip install -U calibrant"
        )


def _plain(value: Any, where: str) -> Any:
    """The value with text for every key, as JSON has it: YAML takes a name such as 1 for a number."""
    if isinstance(value, Mapping):
        out: dict[str, Any] = {}
        for key, item in value.items():
            if isinstance(key, bool) or not isinstance(key, str | int):
                raise InputError(
                    f"{where} has the key {str(key)[:_MOST_SHOWN]!r}, which YAML takes for no text: quote it"
                )
            out[unicodedata.normalize("NFC", str(key))] = _plain(item, f"{where}.{key}")
        return out
    if isinstance(value, list):
        return [_plain(item, f"{where}[{i}]") for i, item in enumerate(value)]
    if value is not None and not isinstance(value, str | int | float | bool):
        # A date, which YAML makes of a text that looks like one.
        return str(value)
    return value
