"""Bundler's bundle.out: every picture with a camera of its own, f k1 k2 R t, without principal point and image size.

    P = R X + t,  p = -P_xy / P_z,  pixel = f (1 + k1 |p|^2 + k2 |p|^4) p

from the image's middle, y up: the camera looks along -z (https://www.cs.cornell.edu/~snavely/bundler, "Output format").
Pictures that share f, k1 and k2 share a camera here; f = 0 is a picture that was not placed.
"""

from __future__ import annotations

import re

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult
from calibrant.errors import InputError
from calibrant.formats.cameras.camera_format import placed_camera, size_or_refuse
from calibrant.formats.cameras.photogrammetry.pictures import FLIP, Picture, pictures_of, result_of, unit_of
from calibrant.formats.documents.document import Document
from calibrant.formats.documents.number_text import row_of
from calibrant.formats.exchange.exchange_format import ExchangeFormat, ReadOptions, Size, WriteOptions
from calibrant.formats.exchange.rotation_numbers import ROUNDED
from calibrant.geometry import se3
from calibrant.reading.notes import note

_MARK = re.compile(r"^#\s*Bundle file v[\d.]+")
_NUMBERS = 15
"""Of a picture: f k1 k2, R row by row, t."""
_HELD = {"fx", "fy", "cx", "cy", "k1", "k2"}
_SAME = 1e-9


def _matches(document: Document) -> bool:
    return _MARK.match(document.text or "") is not None


def _read(document: Document, options: ReadOptions) -> CalibrationResult:
    source = str(document.path)
    rows = _rows(document.text or "")
    size = size_or_refuse(None, options.image_size)
    cameras: dict[str, Camera] = {}
    known: dict[tuple[float, ...], str] = {}
    pictures: list[Picture] = []
    unit = unit_of(options, source) if options.places else 1.0
    placed = [int(i) for i in np.flatnonzero(rows[:, 0])]
    if not placed:
        raise InputError(f"none of its {len(rows)} pictures was placed: f is 0 for all of them")
    if len(placed) < len(rows):
        note(f"{source}: {len(rows) - len(placed)} of {len(rows)} pictures were not placed (f = 0), and are left out")
    for i in placed:
        lens = (float(rows[i, 0]), float(rows[i, 1]), float(rows[i, 2]))
        if lens not in known:
            known[lens] = f"camera_{len(known)}"
            cameras[known[lens]] = _camera(lens, size)
        T = se3.make(rows[i, 3:12].reshape(3, 3), rows[i, 12:])
        T = FLIP @ se3.check(T, name=f"picture {i}", tolerance=ROUNDED)
        T[:3, 3] *= unit
        pictures.append(Picture(str(i), known[lens], T))
    return result_of(cameras, pictures if options.places else (), options)


def _rows(text: str) -> Array:
    """(n, 15), one row a picture. Raises: InputError for counts that do not fit, and for what is no number."""
    body = text.split("\n", 1)[1] if "\n" in text else ""
    head = body.split(None, 2)
    try:
        count = int(head[0])
        int(head[1])
    except (IndexError, ValueError):
        raise InputError("the second line is not: number of pictures, number of points") from None
    if not 0 < count <= len(text):
        raise InputError(f"{count} pictures, expected at least one")
    words = (head[2] if len(head) > 2 else "").split(None, count * _NUMBERS)[: count * _NUMBERS]
    if len(words) < count * _NUMBERS:
        raise InputError(f"{count} pictures have {_NUMBERS * count} numbers, the file ends after {len(words)}")
    try:
        rows = np.array(words, dtype=np.float64).reshape(count, _NUMBERS)
    except ValueError as error:
        raise InputError(f"expected numbers of pictures ({error})") from None
    bad = ~np.isfinite(rows).all(axis=1)
    if bad.any():
        raise InputError(f"picture {int(np.flatnonzero(bad)[0])} holds numbers that are not finite")
    return rows


def _camera(lens: tuple[float, ...], size: Size) -> Camera:
    f, k1, k2 = lens
    cx, cy = ((n - 1) / 2 for n in size)
    return placed_camera("brown", {"fx": f, "fy": f, "cx": cx, "cy": cy, "k1": k1, "k2": k2}, None, size)


def _lens(name: str, camera: Camera) -> tuple[float, float, float]:
    """f, k1, k2. Raises: InputError for a camera of which they do not say all."""
    p = camera.parameters
    if abs(p["fx"] - p["fy"]) > _SAME * p["fx"]:
        raise InputError(f"Bundler has one focal length, {name} has fx {p['fx']:g} and fy {p['fy']:g} px")
    away = [p[c] - (n - 1) / 2 for c, n in zip(("cx", "cy"), camera.image_size)]
    if max(map(abs, away)) > _SAME * max(camera.image_size):
        raise InputError(
            f"Bundler has the principal point in the image's middle, that of {name} lies {away[0]:g}, {away[1]:g} px "
            "from it; write another format, such as colmap"
        )
    more = [f"{term} {value:g}" for term, value in p.items() if term not in _HELD and value != 0]
    if more:
        raise InputError(f"Bundler has k1 and k2 alone, {name} has {', '.join(more)}")
    return p["fx"], p.get("k1", 0.0), p.get("k2", 0.0)


def _write(result: CalibrationResult, options: WriteOptions) -> bytes:
    lens = {name: _lens(name, camera) for name, camera in result.cameras.items()}
    pictures = pictures_of(result)
    if not pictures:
        raise InputError("no picture with a known place: a bundle holds cameras where pictures were taken")
    lines = ["# Bundle file v0.3", f"{len(pictures)} 0"]
    for picture in pictures:
        T = FLIP @ picture.T_camera_world
        rows = (lens[picture.camera], *T[:3, :3], T[:3, 3] / (options.unit_m or 1.0))
        lines += [row_of(row) for row in rows]
    note(f"a bundle has no names for pictures: they are {', '.join(p.name for p in pictures[:8])}, … in this order")
    return ("\n".join(lines) + "\n").encode()


FORMAT = ExchangeFormat(
    name="bundler",
    title="Bundler reconstruction (bundle.out)",
    suffix=".out",
    matches=_matches,
    read=_read,
    write=_write,
    models=("pinhole", "brown"),
)
