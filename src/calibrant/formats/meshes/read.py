"""Triangles of an STL file (binary or text) or of a Wavefront OBJ file, vertices that are the same merged.

Neither format says its unit. A binary STL is 80 bytes of anything, the number of triangles as uint32, and 50 bytes a
triangle: normal and three vertices as float32, two bytes of anything. It may begin with "solid" as the text form does,
so that its length decides. Of an OBJ, lines `v` and `f` count; faces of more corners are cut into fans.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.reading.files import Most, decoded, read_bytes

MESH = Most(200_000_000, "four million triangles")


@dataclass(frozen=True, eq=False)
class Triangles:
    """vertices (n, 3) in the file's own unit; triangles (m, 3), indices of vertices, counterclockwise from outside."""

    vertices: Array
    triangles: NDArray[np.int64]


def read_mesh(path: str | Path) -> Triangles:
    """The triangles of a file. Raises: InputError for another kind of file, or one with no triangle or NaN in it."""
    data = read_bytes(path, most=MESH, what="mesh")
    if Path(path).suffix.lower() == ".obj":
        corners = _obj(decoded(data, path, what="mesh", expected="a Wavefront OBJ file", latin=True), path)
    elif Path(path).suffix.lower() == ".stl":
        corners = _binary_stl(data) if _is_binary(data) else _text_stl(data, path)
    else:
        raise InputError(f"mesh {path}: expected a file .stl or .obj; export it so")
    if len(corners) == 0:
        raise InputError(f"mesh {path} has no triangles")
    if not np.all(np.isfinite(corners)):
        raise InputError(f"mesh {path} has vertices that are NaN or infinite")
    vertices, index = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    triangles = index.reshape(-1, 3).astype(np.int64)
    flat = (np.diff(np.sort(triangles, axis=1), axis=1) == 0).any(axis=1)
    if flat.all():
        raise InputError(f"mesh {path} has only triangles without area")
    triangles = triangles[~flat]
    # A triangle that stands twice (the quad and its halves) would count double.
    _, once = np.unique(np.sort(triangles, axis=1), axis=0, return_index=True)
    return Triangles(vertices, triangles[np.sort(once)])


def _is_binary(data: bytes) -> bool:
    return len(data) >= 84 and len(data) == 84 + 50 * int.from_bytes(data[80:84], "little")


def _binary_stl(data: bytes) -> Array:
    kind = np.dtype([("numbers", "<f4", (4, 3)), ("more", "<u2")])
    return np.frombuffer(data, kind, offset=84)["numbers"][:, 1:].astype(np.float64)


def _text_stl(data: bytes, path: str | Path) -> Array:
    if not data.lstrip().lower().startswith(b"solid"):
        raise InputError(
            f"mesh {path} is no STL: {len(data)} bytes do not fit the number of triangles it names, and it does not "
            'begin with "solid"; is it cut off?'
        )
    words = decoded(data, path, what="mesh", expected="an STL file", latin=True).split()
    at = [i for i, w in enumerate(words) if w.lower() == "vertex"]
    try:
        rows = [[float(w) for w in words[i + 1 : i + 4]] for i in at]
        return np.array(rows, dtype=np.float64).reshape(-1, 3, 3)
    except ValueError:
        raise InputError(f"mesh {path}: expected three numbers after each vertex, three vertices a facet") from None


def _obj(text: str, path: str | Path) -> Array:
    vertices: list[list[float]] = []
    faces: list[tuple[int, int, int]] = []
    for number, line in enumerate(text.splitlines(), 1):
        words = line.split("#")[0].split()
        try:
            if words[:1] == ["v"]:
                vertices.append([float(w) for w in words[1:4]])
            elif words[:1] == ["f"]:
                given = [int(w.split("/")[0]) for w in words[1:]]
                index = [i - 1 if i > 0 else len(vertices) + i for i in given]
                if not all(0 <= i < len(vertices) for i in index):
                    raise ValueError
                faces += [(index[0], index[k], index[k + 1]) for k in range(1, len(index) - 1)]
        except ValueError:
            raise InputError(f"mesh {path}, line {number}: {line.strip()!r} is no vertex or face of it") from None
    if any(len(v) != 3 for v in vertices):
        raise InputError(f"mesh {path}: a vertex has fewer than three numbers")
    return np.array(vertices, dtype=np.float64).reshape(-1, 3)[np.array(faces, dtype=np.int64).reshape(-1, 3)]
