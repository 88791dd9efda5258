"""Cameras of scenes as people save them in JSON or YAML: one, a list, or by name, under any spelling of their keys."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult
from calibrant.data.results import as_transform
from calibrant.errors import InputError
from calibrant.formats.cameras.camera_format import size_or_refuse, whole_size
from calibrant.formats.cameras.fields import Fields, spelled
from calibrant.formats.exchange.exchange_format import Size, read_cameras
from calibrant.formats.exchange.rotation_numbers import finite
from calibrant.geometry import se3, so3
from calibrant.reading.notes import note

WORLD = "world"
_ROUNDED = 2e-3
"""How far printed axes, four digits each, are from a rotation's."""
_EXACT = 1e-6
_MOST = 10_000
_SIZES = (("pixelwidth", "pixelheight"), ("resolutionx", "resolutiony"), ("width", "height"), ("w", "h"))


def has_camera(data: Any, is_camera: Callable[[set[str]], bool]) -> bool:
    """Whether a document holds a camera. Args: is_camera: whether the spelled keys of a mapping are those of one."""
    return any(True for _ in _candidates(data, is_camera))


def entries(data: Any, is_camera: Callable[[set[str]], bool], source: str) -> dict[str, Fields]:
    """The cameras of a document by name; what stands beside their list holds for each of them too.

    Raises: InputError for two of a name, keys of one that mean the same and differ.
    """
    found: dict[str, Fields] = {}
    for name, values in _candidates(data, is_camera):
        if name in found:
            raise InputError(f"{source}: two cameras are called {name!r}")
        if len(found) >= _MOST:
            raise InputError(f"{source}: more than {_MOST:,} cameras")
        found[name] = Fields(values, above=_beside(data) if values is not data else None)
    return found


def _beside(data: Any) -> Fields | None:
    """Words and numbers that stand beside a list of cameras."""
    if not isinstance(data, Mapping):
        return None
    lone = {key: value for key, value in data.items() if not isinstance(value, Mapping | list)}
    return Fields({key: value for key, value in lone.items() if spelled(key) != "name"})


def _candidates(data: Any, is_camera: Callable[[set[str]], bool]) -> Iterable[tuple[str, Mapping[Any, Any]]]:
    """The document itself where it is a camera, else those of its list, or by name."""
    if isinstance(data, Mapping):
        if is_camera({spelled(key) for key in data}):
            yield str(data.get("name") or "camera"), data
            return
        data = next((value for key, value in data.items() if spelled(key) == "cameras"), data)
    for name, value in _named(data):
        if isinstance(value, Mapping) and is_camera({spelled(key) for key in value}):
            yield name, value


def _named(data: Any) -> Iterable[tuple[str, Any]]:
    if isinstance(data, Mapping):
        for key, value in data.items():
            yield str(key), value
    elif isinstance(data, list):
        for i, value in enumerate(data):
            said = value.get("name") if isinstance(value, Mapping) else None
            yield str(said or ("camera" if len(data) == 1 else f"camera_{i}")), value


def number(fields: Fields, key: str, where: str, default: float | None = None) -> float | None:
    """The number of a key, the default where there is none. Raises: InputError for what is none."""
    value = fields.get(key)
    return default if value is None else float(finite([value], 1, f"{where}: {fields.name(key)}")[0])


def numbers(value: Any, names: str, where: str) -> Array:
    """As many numbers as there are names, from a list of them or by name: {"x": …}. Raises: InputError."""
    if isinstance(value, Mapping):
        by_name = {spelled(key): v for key, v in value.items()}
        return finite((by_name.get(name) for name in names), len(names), where)
    return finite(np.ravel(value).tolist() if isinstance(value, list | np.ndarray) else [value], len(names), where)


def size_in(fields: Fields, image_size: Size | None, where: str) -> Size:
    """The image size of an entry, or the caller's. Raises: InputError where neither is there, or both and different."""
    found: Size | None = None
    pair = next(((w, h) for w, h in _SIZES if fields.peek(w) is not None and fields.peek(h) is not None), None)
    if pair is not None:
        share = (number(fields, "resolutionpercentage", where, 100.0) or 100.0) / 100 if pair[0] == "resolutionx" else 1
        sides = [number(fields, key, where, 0.0) or 0.0 for key in pair]
        found = whole_size(*(int(side * share) if share != 1 else side for side in sides))
    else:
        listed = fields.first(("resolution", "imagesize"))
        if listed is not None:
            found = whole_size(*numbers(listed[1], "xy", f"{where}: {listed[0]}"))
    try:
        return size_or_refuse(found, image_size)
    except InputError as error:
        raise InputError(f"{where}: {error} (--image-size)") from None


def rigid(matrix: Array, where: str) -> Array:
    """A pose (4, 4) freed of scale and of the rounding of a print. Raises: InputError for mirrors and sheared axes."""
    lengths = np.linalg.norm(matrix[:3, :3], axis=0)
    if not np.all(lengths > 1e-9):
        raise InputError(f"{where}: the matrix has an axis of length 0")
    R = matrix[:3, :3] / lengths
    if np.linalg.det(R) < 0:
        raise InputError(f"{where}: the matrix is a mirror; expected right-handed axes")
    off = float(np.abs(R.T @ R - np.eye(3)).max())
    if off > _ROUNDED or np.abs(matrix[3] - [0, 0, 0, 1]).max() > _EXACT:
        raise InputError(f"{where}: the matrix is no pose: its axes are {off:.2g} off right angles")
    if off > _EXACT:
        note(f"{where}: the matrix is rounded; the rotation nearest to it, within {off:.1g} rad, is taken")
    if np.abs(lengths - 1).max() > _ROUNDED:
        note(f"{where}: the matrix scales by {', '.join(f'{v:.4g}' for v in lengths)}; cameras have no scale, left out")
    return se3.make(so3.nearest(R), matrix[:3, 3])


def placed_cameras(found: Mapping[str, tuple[Camera, Array | None]]) -> CalibrationResult:
    """The result of cameras by name, each with T_world_optical (4, 4) where it is known."""
    places = tuple(as_transform(WORLD, name, T) for name, (_, T) in found.items() if T is not None)
    return read_cameras({name: camera for name, (camera, _) in found.items()}, transforms=places)
