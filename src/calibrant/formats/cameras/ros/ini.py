"""The ini of camera_calibration_parsers, and ost.txt, in which camera_calibration puts two of them one after the other.

    [image]
    width
    640
    height
    480
    [left]
    camera matrix
    800 0 320
    …
    distortion, rectification, projection likewise

A name stands on a line, its numbers on those below; [externals] of the oldest ones is used by no program of ROS.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from calibrant.data import CalibrationResult
from calibrant.errors import InputError
from calibrant.formats.cameras.ros.camera_info import INI_MODELS, info_of, ini_text
from calibrant.formats.cameras.ros.pairs import cameras_of
from calibrant.formats.documents.document import Document
from calibrant.formats.exchange.exchange_format import (
    ExchangeFormat,
    ReadOptions,
    WriteOptions,
    one_camera,
)
from calibrant.reading.notes import note

_MARK = re.compile(r"^\[image\][ \t]*\r?$", re.MULTILINE)
_MATRIX = "camera matrix"
_SECTION = re.compile(r"^\[([^\[\]]{1,200})\]$")
_KEYS = {"width", "height", _MATRIX, "distortion", "rectification", "projection", "translation", "rotation"}
_ROWS = {_MATRIX: (3, 9), "distortion": (1, None), "rectification": (3, 9), "projection": (3, 12)}
"""Rows of each, and how many numbers are in them."""
_MOST_LINES = 10_000
_COUNTS = (4, 5, 8)
_RATIONAL = 8


def _matches(document: Document) -> bool:
    text = document.head.decode("utf-8", "replace")
    return bool(_MARK.search(text)) and _MATRIX in text


def infos_in(text: str, source: str, options: ReadOptions) -> list[Any]:
    """The cameras of the text. Raises: InputError naming the section that is not whole."""
    return [info_of(fields, options.image_size, source) for fields in _cameras(text, source)]


def _cameras(text: str, source: str) -> Iterator[dict[str, Any]]:
    size: dict[str, Any] = {}
    found = False
    for name, values in _sections(text):
        if name == "image":
            size = {f"image_{key}": _one(values, key) for key in ("width", "height")}
        elif name == "externals":
            note(f"{source}: not used: [externals]")
        else:
            found = True
            yield {"camera_name": name, **size, **_fields(name, values)}
    if not found:
        raise InputError("no camera in it; expected a section such as [left] with camera matrix, distortion, …")


def _sections(text: str) -> Iterator[tuple[str, dict[str, list[list[str]]]]]:
    """Name of each section, and the rows of words below each key in it."""
    name: str | None = None
    values: dict[str, list[list[str]]] = {}
    key: str | None = None
    lines = text.splitlines()
    if len(lines) > _MOST_LINES:
        raise InputError(f"{len(lines):,} lines; cameras in ini files have some thirty each")
    for line in map(str.strip, lines):
        section = _SECTION.match(line)
        if section:
            if name is not None:
                yield name, values
            name, values, key = section[1], {}, None
        elif line.lower() in _KEYS:
            key = line.lower()
            values.setdefault(key, [])
        elif line and line[0] not in "#;" and key is not None:
            values[key].append(line.split())
    if name is not None:
        yield name, values


def _one(values: dict[str, list[list[str]]], key: str) -> str:
    rows = values.get(key, [])
    if len(rows) != 1 or len(rows[0]) != 1:
        raise InputError(f"[image] holds no {key}; expected one number on the line below it")
    return rows[0][0]


def _fields(name: str, values: dict[str, list[list[str]]]) -> dict[str, Any]:
    """The section as the keys of the YAML."""
    found: dict[str, list[float]] = {}
    for key, (rows, count) in _ROWS.items():
        if key not in values and key in (_MATRIX, "distortion"):
            raise InputError(f"[{name}] holds no {key}")
        try:
            flat = [float(word) for row in values.get(key, [])[:rows] for word in row]
        except ValueError as error:
            raise InputError(f"[{name}] {key}: {error}, expected numbers") from None
        if key in values and (len(flat) != count if count else len(flat) not in _COUNTS):
            raise InputError(f"[{name}] {key} has {len(flat)} numbers, expected {count or '4, 5 or 8'}")
        found[key] = flat
    K, P = found[_MATRIX], found["projection"]
    return {
        "camera_matrix": {"rows": 3, "cols": 3, "data": K},
        "distortion_model": "rational_polynomial" if len(found["distortion"]) == _RATIONAL else "plumb_bob",
        "distortion_coefficients": found["distortion"],
        **({"rectification_matrix": found["rectification"]} if found["rectification"] else {}),
        **({"projection_matrix": P} if P else {}),
    }


def _read(document: Document, options: ReadOptions) -> CalibrationResult:
    infos = infos_in(document.text or "", str(document.path), options)
    return cameras_of(infos, [f"camera{i}" for i in range(1, len(infos) + 1)], options, str(document.path))


def _write(result: CalibrationResult, options: WriteOptions) -> bytes:
    name, camera = one_camera(result)
    return ini_text(camera, name=name).encode()


FORMAT = ExchangeFormat(
    name="camera-info-ini",
    title="ROS camera_calibration_parsers' ini, ost.txt",
    suffix=".ini",
    matches=_matches,
    read=_read,
    write=_write,
    models=INI_MODELS,
)
