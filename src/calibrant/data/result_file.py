"""The result file: JSON, format calibrant/2, written whole or not at all and read back without loss.

`docs/file-formats.md` lists the keys. Keys that do not apply are absent. Numbers are written so that reading gives the
same double; NaN and infinity are never written. An observations file is a result of kind "observations".
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from calibrant.data.format_one import FORMAT_ONE
from calibrant.data.observations import Observations
from calibrant.data.result_decoding import KEYS, decode, refuse_constant
from calibrant.data.result_encoding import FORMAT, encode, format_json
from calibrant.data.results import CalibrationResult
from calibrant.errors import InputError
from calibrant.reading.files import RESULT, draft, read_text, reason_of
from calibrant.reading.json_text import parse_json
from calibrant.reading.notes import note_unused


def write_result(result: CalibrationResult, path: str | Path, *, force: bool = False) -> Path:
    """Write a result file. An empty `created` or `version` is filled in with the time (UTC) and this version.

    Raises: InputError when the path exists and `force` is False, cannot be written, or a number is not finite.
    """
    return write_text(result_text(result) + "\n", path, force=force)


def result_text(result: CalibrationResult) -> str:
    """The result as JSON text of format calibrant/2. Raises: InputError when a number is not finite."""
    return format_json(encode(result))


def read_result(path: str | Path) -> CalibrationResult:
    """Read a result file.

    Raises: InputError: missing, not JSON, another format, a key missing or of the wrong kind.

        >>> import calibrant as cb
        >>> result = cb.read("camera.json")  # doctest: +SKIP
    """
    if not isinstance(path, str | Path):
        raise InputError(f"cannot read {path!r}: it is no path of a file")
    path = Path(path)
    text = read_text(path, most=RESULT, what="result file", expected=f"a JSON file of format {FORMAT}")
    try:
        data = parse_json(text, parse_constant=refuse_constant)
    except json.JSONDecodeError as error:
        raise InputError(
            f"{path}:{error.lineno}: not JSON ({error.msg}); expected a result file of format {FORMAT}"
        ) from error
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    try:
        result = decode(data)
        note_unused(str(path), () if data["format"] == FORMAT_ONE else (key for key in data if key not in KEYS))
        return result
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def write_observations(
    observations: Observations,
    path: str | Path,
    *,
    options: Mapping[str, Any] | None = None,
    inputs: Iterable[Mapping[str, str]] = (),
    force: bool = False,
) -> Path:
    """Write an observations file: a result of kind "observations". Raises as `write_result`."""
    result = CalibrationResult(
        "observations", "ok", observations=observations, options=dict(options or {}), inputs=tuple(inputs)
    )
    return write_result(result, path, force=force)


def read_observations(path: str | Path) -> Observations:
    """The observations in a result file of any kind. Raises: InputError as `read_result`, or when it holds none."""
    result = read_result(path)
    if result.observations is None:
        raise InputError(
            f"{path}: a {result.kind} result without observations; give a file written by calibrant detect"
        )
    return result.observations


def write_text(text: str, path: str | Path, *, force: bool = False) -> Path:
    """Write a text file whole or not at all. Raises: as `write_bytes`."""
    return write_bytes(text.encode("utf-8"), path, force=force)


def write_bytes(content: bytes, path: str | Path, *, force: bool = False) -> Path:
    """Write a file whole or not at all: a temporary neighbour is filled, synced and renamed over the path.

    Raises: InputError when the path exists and `force` is False, or cannot be written; nothing is left behind.
    """
    path = Path(path)
    if path.is_dir():
        raise InputError(f"cannot write {path}: it is a folder; give the name of a file in it")
    if path.exists() and not force:
        raise InputError(f"{path} exists already; give another name, or force=True to replace it")
    target = Path(os.path.realpath(path))  # a link stays a link: the file behind it is replaced
    try:
        temporary, stream = draft(target)
        try:
            with stream:
                stream.write(content)
                stream.flush()
                os.fsync(stream.fileno())
            os.replace(temporary, target)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise InputError(
            f"cannot write {path}: {reason_of(error)}; choose a folder that exists and is writable"
        ) from error
    return path
