"""Clouds as PLY (Stanford polygon file): written in binary, read in binary of either order and as text.

Coordinates are single precision, metres, in the cloud's frame: at 10 m a step is a micrometre. Colours are `red`,
`green`, `blue` as MeshLab, CloudCompare and Open3D read them; further numbers a point keep their names.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from calibrant.data.cloud import Cloud
from calibrant.errors import InputError
from calibrant.reading.files import Most, read_bytes

_MOST = Most(2_000_000_000, "a hundred million points")
_LONGEST_HEADER = 20_000
_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
_FORMATS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_COLOURS = ("red", "green", "blue")
_FRAME = "frame "


def ply_bytes(cloud: Cloud) -> bytes:
    """The cloud as a PLY file: x y z, red green blue where it has colours, then its values by name, little-endian."""
    fields = [(name, "<f4") for name in "xyz"]
    fields += [] if cloud.colours is None else [(name, "u1") for name in _COLOURS]
    fields += [(name, "<f4") for name in cloud.values]
    rows = np.zeros(len(cloud), dtype=fields)
    for i, name in enumerate("xyz"):
        rows[name] = cloud.points[:, i]
    if cloud.colours is not None:
        for i, name in enumerate(_COLOURS):
            rows[name] = cloud.colours[:, i]
    for name, value in cloud.values.items():
        rows[name] = value
    words = {"<f4": "float", "u1": "uchar"}
    header = [
        "ply",
        "format binary_little_endian 1.0",
        "comment metres, written by calibrant",
        f"comment {_FRAME}{cloud.frame}",
        f"element vertex {len(cloud)}",
        *(f"property {words[kind]} {name}" for name, kind in fields),
        "end_header\n",
    ]
    return "\n".join(header).encode() + rows.tobytes()


def read_ply(path: str | Path) -> Cloud:
    """The points of a PLY file with their colours and other numbers; faces are not read.

    Raises: InputError for a file that is no PLY, is cut short, or holds no points; points that are NaN are left out.
    """
    data = read_bytes(path, most=_MOST, what="cloud")
    header, end = _header(data, path)
    order, count, fields, frame = _layout(header, path)
    kind = np.dtype([(name, order + code) for name, code in fields])
    if count > len(data):  # each point takes a byte at least, and more
        raise InputError(f"cloud {path} is cut short: it says {count} points and has {len(data)} bytes")
    if header[1].split()[1] == "ascii":
        rows = _text_rows(data[end:], count, kind, path)
    else:
        if len(data) - end < count * kind.itemsize:
            raise InputError(f"cloud {path} is cut short: {count} points need {count * kind.itemsize} bytes")
        rows = np.frombuffer(data, dtype=kind, count=count, offset=end)
    names = kind.names or ()
    points = np.stack([rows[c].astype(np.float64) for c in "xyz"], axis=1)
    keep = np.isfinite(points).all(axis=1)
    coloured = all(c in names and kind[c].str.endswith("u1") for c in _COLOURS)
    colours = np.stack([rows[c] for c in _COLOURS], axis=1) if coloured else None
    others = [n for n in names if n not in (*"xyz", *_COLOURS) and n.isidentifier()]
    return Cloud(
        points[keep],
        None if colours is None else colours[keep],
        {n: rows[n].astype(np.float64)[keep] for n in others},
        frame,
    )


def _header(data: bytes, path: str | Path) -> tuple[list[str], int]:
    """The header's lines, and where the points begin."""
    head = data[:_LONGEST_HEADER]
    mark = head.find(b"end_header")
    end = head.find(b"\n", mark)
    if not data.startswith(b"ply") or mark < 0 or end < 0:
        raise InputError(f"{path} is no PLY file: expected one that begins with the line ply, and has an end_header")
    lines = [line.strip() for line in head[:mark].decode("latin-1").splitlines()]
    if len(lines) < 2 or lines[1].split()[:1] != ["format"] or lines[1].split()[1] not in _FORMATS:
        raise InputError(f"cloud {path}: expected a format of {', '.join(_FORMATS)}, found {lines[1:2]}")
    return lines, end + 1


def _layout(header: list[str], path: str | Path) -> tuple[str, int, list[tuple[str, str]], str]:
    """Byte order, number of points, their fields as (name, type), and the frame that the comment names."""
    count, fields, frame, element = 0, [], "camera", ""
    seen: list[str] = []
    for line in header:
        words = line.split()
        if line.startswith(f"comment {_FRAME}"):
            frame = line.removeprefix(f"comment {_FRAME}").strip() or frame
        elif words[:1] == ["element"] and len(words) == 3:
            element = words[1]
            seen.append(element)
            if element == "vertex":
                count = int(words[2]) if words[2].isdigit() else 0
        elif words[:1] == ["property"] and element == "vertex":
            if len(words) != 3 or words[1] not in _TYPES:
                raise InputError(f"cloud {path}: cannot read points with {line!r}")
            fields.append((words[2], _TYPES[words[1]]))
    missing = [c for c in "xyz" if c not in dict(fields)]
    if seen[:1] != ["vertex"] or missing:
        raise InputError(f"cloud {path}: expected points with x, y and z first; it has {', '.join(seen) or 'nothing'}")
    return _FORMATS[header[1].split()[1]], count, fields, frame


def _text_rows(data: bytes, count: int, kind: np.dtype[np.void], path: str | Path) -> np.ndarray[tuple[int], np.dtype]:
    lines = data.decode("latin-1").split("\n")[:count]
    names = kind.names or ()
    out = np.zeros(count, dtype=kind)
    if count == 0:
        return out
    try:
        numbers = np.array([line.split()[: len(names)] for line in lines], dtype=np.float64)
    except ValueError:
        numbers = np.zeros((0, 0))
    if numbers.shape != (count, len(names)):
        raise InputError(f"cloud {path} is cut short or damaged: expected {count} rows of {len(names)} numbers")
    for i, name in enumerate(names):
        out[name] = numbers[:, i]
    return out
