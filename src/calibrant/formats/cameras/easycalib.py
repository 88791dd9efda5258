"""3D-EasyCalib's project file, YAML and JSON: sensors, the world they are placed in, K_i, kc_i, R_i, T_i.

    X_C = R_i X_W + T_i,   T in millimetres, kc = [k1 k2 p1 p2 k3]

(its manual, 4.1 to 4.3; chapter 4 (1), "Save Project", says that a project's poses go the other way, from the camera to
the world: who has such a file says so with `--answer direction=camera-to-world`). i counts from 0 or from 1. A sensor
without K_i is a frame: a coordinate system or a robot. The world, where it is a sensor, lies at itself.
"""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, TransformEstimate, as_transform
from calibrant.errors import InputError
from calibrant.formats.cameras.camera_format import numbers
from calibrant.formats.cameras.described import described_camera
from calibrant.formats.cameras.opencv import distortion_coefficients
from calibrant.formats.documents.document import Document
from calibrant.formats.documents.opencv_storage import Storable, json_text, yaml_text
from calibrant.formats.exchange.exchange_format import (
    ExchangeFormat,
    ReadOptions,
    Size,
    WriteOptions,
    answer,
    read_cameras,
)
from calibrant.formats.exchange.places import places_in, world_of
from calibrant.formats.exchange.rotation_numbers import rotation_in
from calibrant.geometry import se3
from calibrant.reading.notes import note, note_unused

_MM = 1e3
_AT_ITSELF = 1e-6
"""How far from the identity the world may lie from itself: rounding, in radians and millimetres."""
_DIRECTIONS = ("world-to-camera", "camera-to-world")
_INDICES = ("0", "1")
_PARTS = ("K", "kc", "R", "T", "image_width", "image_height")
_ASKS = {
    "index": "what i of K_i counts from, 0 or 1, where the file's keys fit both",
    "direction": f"which way R_i, T_i go: {' or '.join(_DIRECTIONS)}",
}


def _matches(document: Document) -> bool:
    return {"Sensors", "World"} <= set(document.mapping)


def _read(document: Document, options: ReadOptions) -> CalibrationResult:
    data, source = document.mapping, str(document.path)
    sensors, world = _sensors(data), str(data["World"])
    direction = answer(options.answers, "direction", _DIRECTIONS)
    first = _first_index(data, sensors, world, answer(options.answers, "index", _INDICES))
    number = {name: first + k for k, name in enumerate(sensors)}
    cameras = {
        name: _camera(data, i, options.image_size, f"{source}: {name}")
        for name, i in number.items()
        if f"K_{i}" in data
    }
    places = _places(data, number, world, inverse=direction == "camera-to-world")
    if direction is None and len(places):
        note(f"{source}: R_i, T_i are read as X_camera = R X_world + T, as section 4.3 of its manual has them")
    used = {"Sensors", "World", "ISODate", *(f"{part}_{i}" for part in _PARTS for i in number.values())}
    note_unused(source, (str(key) for key in data if key not in used))
    return read_cameras(cameras, transforms=places, created=str(data.get("ISODate", "")))


def _sensors(data: Mapping[str, Any]) -> list[str]:
    """Their names. Raises: InputError for none, or one name twice."""
    found = data["Sensors"]
    names = [str(name) for name in (found if isinstance(found, list) else str(found).split(",") if found else [])]
    names = [name.strip() for name in names]
    if not names or not all(names):
        raise InputError(f"Sensors is {str(found)[:60]!r}, expected a list of names")
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise InputError(f"two sensors are called {twice!r}; give each a name of its own")
    return names


def _first_index(data: Mapping[str, Any], sensors: list[str], world: str, asked: str | None) -> int:
    """What i counts from: what the keys fit and, where they fit both, the pose of the world at itself.

    Raises: InputError where neither fits, or both do.
    """
    has = {
        int(i): part
        for key in data
        for part, _, i in [str(key).rpartition("_")]
        if part in ("K", "R") and i.isdecimal() and len(i) < 5
    }
    fits = [first for first in (0, 1) if set(has) <= set(range(first, first + len(sensors)))]
    # Where all sensors have their numbers one start alone is left; where some have none the world's own pose may tell.
    if len(fits) > 1 and world in sensors:
        at_itself = [first for first in fits if _is_at_itself(data, first + sensors.index(world))]
        fits = at_itself or fits
    if asked is not None:
        return int(asked)
    if len(fits) == 1:
        return fits[0]
    keys = ", ".join(f"{part}_{i}" for i, part in sorted(has.items())) or "none"
    if not fits:
        raise InputError(f"{len(sensors)} sensors, but the numbers of their keys do not fit them: {keys}")
    raise InputError(
        f"the keys ({keys}) fit {len(sensors)} sensors counted from 0 and from 1: say --answer index=0 or index=1"
    )


def _pose(data: Mapping[str, Any], i: int) -> Array | None:
    """[R_i, T_i] as it stands, T in metres; None where there is none. Raises: InputError for what is no pose."""
    if f"R_{i}" not in data and f"T_{i}" not in data:
        return None
    missing = next((f"{part}_{i}" for part in "RT" if f"{part}_{i}" not in data), None)
    if missing is not None:
        raise InputError(f"{missing} is missing beside its other half")
    R, t = (numbers(data[f"{part}_{i}"], f"{part}_{i}") for part in "RT")
    sizes = R.size == 9 and t.size == 3 and bool(np.all(np.isfinite(t)))
    turn = rotation_in(R.reshape(3, 3)) if sizes else None
    if turn is None:
        raise InputError(
            f"R_{i} ({R.size} numbers) and T_{i} ({t.size}) are no rotation of nine numbers and translation of three"
        )
    return se3.make(turn, t / _MM)


def _is_at_itself(data: Mapping[str, Any], i: int) -> bool:
    pose = _pose(data, i)
    return pose is not None and float(np.abs(se3.log(pose)).max()) <= _AT_ITSELF


def _places(
    data: Mapping[str, Any], number: Mapping[str, int], world: str, *, inverse: bool
) -> tuple[TransformEstimate, ...]:
    """T_world_sensor of every sensor but the world. Raises: InputError where the world does not lie at itself."""
    found: list[TransformEstimate] = []
    for name, i in number.items():
        pose = _pose(data, i)
        if name == world:
            if pose is not None and not _is_at_itself(data, i):
                raise InputError(
                    f"the world is the sensor {world!r}, and its own R_{i}, T_{i} are not the identity: another sensor "
                    "is the world, or i counts from elsewhere (--answer index=0 or index=1)"
                )
        elif pose is not None:
            found.append(as_transform(world, name, pose if inverse else se3.inverse(pose)))
    return tuple(found)


def _camera(data: Mapping[str, Any], i: int, image_size: Size | None, source: str) -> Camera:
    """K_i and kc_i. The format holds no image size: without one it is taken as twice the principal point, and said."""
    K, kc = (numbers(data.get(f"{part}_{i}", []), f"{part}_{i}") for part in ("K", "kc"))
    if K.size != 9:
        raise InputError(f"K_{i} holds {K.size} numbers, expected 9, row by row")
    keys: dict[str, Any] = {"K": K.reshape(3, 3)} | ({"kc": kc} if kc.size else {})
    if f"image_width_{i}" in data:
        keys |= {"image_width": data[f"image_width_{i}"], "image_height": data.get(f"image_height_{i}")}
    elif image_size is None:
        width, height = _size_by_principal_point(K.reshape(3, 3))
        note(
            f"{source}: no image size in the project; twice the principal point, {width}x{height} px, stands for it: "
            "--image-size says it"
        )
        image_size = (width, height)
    return described_camera(keys, image_size, source)


def _size_by_principal_point(K: Array) -> Size:
    """The size of images in whose middle the principal point lies, whole pixels."""
    width, height = (max(1, round(2 * float(c) + 1)) for c in K[:2, 2])
    return width, height


def _values(result: CalibrationResult, options: WriteOptions) -> dict[str, Storable]:
    world = world_of(result, options.answers.get("world"))
    first = int(answer(options.answers, "index", _INDICES) or 0)
    frames = dict.fromkeys(name for t in result.transforms for name in (t.parent, t.child))
    sensors = [*result.cameras, *(n for n in frames if n not in result.cameras and n != world)]
    inverse = answer(options.answers, "direction", _DIRECTIONS) == "camera-to-world"
    values: dict[str, Storable] = {
        "ISODate": result.created or datetime.now(UTC).isoformat(timespec="seconds"),
        "Sensors": sensors,
        "World": world,
    }
    for i, (name, T) in enumerate(places_in(result, world, tuple(sensors)).items(), start=first):
        camera = result.cameras.get(name)
        if camera is not None:
            values |= {f"K_{i}": camera.K, f"kc_{i}": distortion_coefficients(camera).T}
            # A size that only stood in for one stays unsaid; whoever reads the file finds the same.
            if camera.image_size != _size_by_principal_point(camera.K):
                values |= {f"image_width_{i}": camera.image_size[0], f"image_height_{i}": camera.image_size[1]}
        pose = (T if inverse else se3.inverse(T)) + 0.0  # no zero below zero
        values |= {f"R_{i}": pose[:3, :3], f"T_{i}": _MM * pose[:3, 3:]}
    return values


def _write_yaml(result: CalibrationResult, options: WriteOptions) -> bytes:
    return yaml_text(_values(result, options)).encode()


def _write_json(result: CalibrationResult, options: WriteOptions) -> bytes:
    return json_text(_values(result, options)).encode()


_MODELS = ("pinhole", "brown")
FORMAT = ExchangeFormat(
    name="easycalib",
    title="3D-EasyCalib project (YAML)",
    suffix=".yml",
    matches=_matches,
    read=_read,
    write=_write_yaml,
    models=_MODELS,
    asks=_ASKS | {"world": "the frame that all others are placed in"},
)
JSON_FORMAT = ExchangeFormat(
    name="easycalib-json",
    title="3D-EasyCalib project (JSON)",
    suffix=".json",
    matches=lambda document: False,  # the first reads both
    write=_write_json,
    models=_MODELS,
    asks=FORMAT.asks,
)
