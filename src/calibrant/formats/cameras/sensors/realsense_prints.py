"""What rs-enumerate-devices -c and pyrealsense2 print: intrinsics and extrinsics as text."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.formats.exchange.exchange_format import Size

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_BLOCK = re.compile(r"Intrinsic of \"([^\"]{1,40})\"")
_FIELD = re.compile(r"^[\s#]*(Width|Height|PPX|PPY|Fx|Fy|Distortion|Coeffs):[ \t]*(.*?)\s*$", re.MULTILINE)
_EXTRINSIC = re.compile(r"Extrinsic from[ \t]+\"([^\"]{1,40})\"\s+To\s+\"([^\"]{1,40})\"")
_PRINTED = re.compile(
    rf"\[\s*(\d+)x(\d+)\s+p\[\s*({_NUMBER})\s+({_NUMBER})\s*\]\s+f\[\s*({_NUMBER})\s+({_NUMBER})\s*\]\s+"
    r"([A-Za-z0-9 ]{1,40}?)\s*\[([^\]]{0,200})\]\s*\]"
)
_OLD = re.compile(
    rf"width: (\d+), height: (\d+), ppx: ({_NUMBER}), ppy: ({_NUMBER}), fx: ({_NUMBER}), fy: ({_NUMBER}), "
    r"model: ([A-Za-z0-9_. ]{1,40}), coeffs: \[([^\]]{0,200})\]"
)


class Extrinsics(NamedTuple):
    """X_end = R X_start + t, metres."""

    start: str
    end: str
    R: Array
    t: Array


def is_print(text: str) -> bool:
    """Whether the text is such a print."""
    return any(pattern.search(text) is not None for pattern in (_BLOCK, _PRINTED, _OLD))


def cameras_in_text(text: str, size: Size | None) -> Mapping[str, Mapping[str, Any]]:
    """Intrinsics by stream; where a stream has several sizes the one asked for, or each with its size as its name.

    Raises: InputError for a block that is not whole, and where no stream has the size.
    """
    found = [*_blocks(text), *_lines(text)]
    if size is not None and any((lens["width"], lens["height"]) == size for _, lens in found):
        found = [(name, lens) for name, lens in found if (lens["width"], lens["height"]) == size]
    sizes: dict[str, set[tuple[int, int]]] = {}
    for name, lens in found:
        sizes.setdefault(name, set()).add((lens["width"], lens["height"]))
    out: dict[str, Mapping[str, Any]] = {}
    for name, lens in found:
        label = name if len(sizes[name]) == 1 else f"{name} {lens['width']}x{lens['height']}"
        if label in out and out[label] != lens:
            raise InputError(f"two cameras {label} that differ; give a print of one device")
        out[label] = lens
    return out


def _blocks(text: str) -> list[tuple[str, dict[str, Any]]]:
    starts = list(_BLOCK.finditer(text))
    ends = [m.start() for m in starts[1:]] + [len(text)]
    out = []
    for start, end in zip(starts, ends):
        fields: dict[str, str] = {}
        for name, value in _FIELD.findall(text[start.end() : min(end, start.end() + 2000)]):
            fields.setdefault(name.lower(), value)
        missing = [n for n in ("width", "height", "ppx", "ppy", "fx", "fy", "distortion", "coeffs") if n not in fields]
        if missing:
            raise InputError(f"the intrinsics of {start[1]} have no {', '.join(missing)}")
        out.append((start[1], _lens(start[1], *(fields[n] for n in _ORDER))))
    return out


_ORDER = ("width", "height", "ppx", "ppy", "fx", "fy", "distortion", "coeffs")


def _lines(text: str) -> list[tuple[str, dict[str, Any]]]:
    rows = [m.groups() for pattern in (_PRINTED, _OLD) for m in pattern.finditer(text)]
    return [("camera" if len(rows) == 1 else f"camera_{i}", _lens("the print", *row)) for i, row in enumerate(rows)]


def _lens(name: str, *words: str) -> dict[str, Any]:
    width, height, ppx, ppy, fx, fy, model, coeffs = words
    try:
        return {
            "width": int(width),
            "height": int(height),
            **{key: float(word) for key, word in zip(("ppx", "ppy", "fx", "fy"), (ppx, ppy, fx, fy))},
            "model": model,
            "coeffs": [float(word) for word in coeffs.replace(",", " ").split()],
        }
    except ValueError as error:
        raise InputError(f"the intrinsics of {name} hold what is no number ({error})") from None


def extrinsics_in_text(text: str) -> list[Extrinsics]:
    """Extrinsics as rs-enumerate-devices prints them, row by row. Raises: InputError for a block that is not whole."""
    starts = list(_EXTRINSIC.finditer(text))
    ends = [m.start() for m in starts[1:]] + [len(text)]
    out = []
    for start, end in zip(starts, ends):
        block = text[start.end() : min(end, start.end() + 1000)]
        turn, _, shift = block.partition("Translation Vector")
        values = [[float(n) for n in re.findall(_NUMBER, part)] for part in (turn, shift.partition("\n\n")[0])]
        if len(values[0]) != 9 or len(values[1]) < 3:
            raise InputError(f"the extrinsics from {start[1]} to {start[2]} are not whole")
        out.append(Extrinsics(start[1], start[2], np.array(values[0]).reshape(3, 3), np.array(values[1][:3])))
    return out
