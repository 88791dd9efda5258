"""A result without the folders of the machine it was made on: files by their names alone, wherever they are named."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass, replace
from pathlib import PurePosixPath, PureWindowsPath
from typing import Any

from calibrant.data import CalibrationResult

_ABSOLUTE = re.compile(
    r"""(?<![\w.:</\\])(?:file://|~|[A-Za-z]:(?=[\\/]))?(?:[/\\]|\.\.[/\\])(?:[^\s/\\"'<>|:,;()]+[/\\])*"""
)
"""The folders of an absolute path, or of one that climbs out: of Unix, of Windows, of a share."""
_KEPT = "file"
"""Fields of this name are read, not shown: where a picture lies."""


def without_folders(result: CalibrationResult) -> CalibrationResult:
    """The result with every absolute path in its texts cut to the file's name; relative ones stay as typed."""
    found: CalibrationResult = _walked(result, cleaner(result))
    return found


def cleaner(result: CalibrationResult) -> Callable[[str], str]:
    """What takes the folders out of a text: those of the result's own files, whatever is in their names, and others."""
    views = result.observations.views if result.observations else ()
    files = [*(str(i.get("file", "")) for i in result.inputs), *(v.file for v in views if v.file)]
    folders = sorted(
        {f[: -len(_last(f))] for f in files if _ABSOLUTE.match(f) and _last(f) != f}, key=len, reverse=True
    )

    def cleaned(text: str) -> str:
        for folder in folders:
            text = text.replace(folder, "")
        return _ABSOLUTE.sub("", text)

    return cleaned


def _last(file: str) -> str:
    name = PureWindowsPath(file).name if "\\" in file else PurePosixPath(file).name
    return name or file


def _walked(value: Any, cleaned: Callable[[str], str]) -> Any:
    """The value with every text in it cleaned, down to the last record; arrays as they are."""
    if isinstance(value, str):
        return cleaned(value)
    if isinstance(value, (tuple, list)):
        return type(value)(_walked(item, cleaned) for item in value)
    if isinstance(value, Mapping):
        return {_walked(key, cleaned): _walked(item, cleaned) for key, item in value.items()}
    if is_dataclass(value) and not isinstance(value, type):
        given = {f.name: getattr(value, f.name) for f in fields(value) if f.init and f.name != _KEPT}
        changed = {
            n: new for n, old in given.items() if (new := _walked(old, cleaned)) is not old and _differs(old, new)
        }
        return replace(value, **changed) if changed else value
    return value


def _differs(old: Any, new: Any) -> bool:
    """Whether anything in it is another text: records are compared by identity, arrays never are."""
    if isinstance(old, str):
        return bool(old != new)
    if isinstance(old, (tuple, list)):
        return any(_differs(a, b) for a, b in zip(old, new, strict=True))
    if isinstance(old, Mapping):
        return list(old) != list(new) or any(_differs(a, b) for a, b in zip(old.values(), new.values(), strict=True))
    return old is not new
