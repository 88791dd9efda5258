"""Cameras of Blender: matrix_world with lens, sensor and shift, as JSON or as Python prints them there.

A camera looks along its -z, y up. The sensor's size is of the side that is fitted: the width for HORIZONTAL, and for
AUTO where the image is wider than high; the height for VERTICAL; for AUTO of a high image sensor_width too. n is that
side in pixels, a = pixel_aspect_y / pixel_aspect_x:

    fx = lens / sensor n,  fy = fx / a,   u = W/2 - shift_x n - 1/2,   v = H/2 + shift_y n / a - 1/2

n = a H where the height is fitted. Sources: Blender manual, "Cameras" (Lens, Sensor Fit, Shift); Blender Python API,
bpy.types.Camera, RenderSettings; DLR-RM/BlenderProc, CameraUtility.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult
from calibrant.errors import InputError
from calibrant.formats.cameras.fields import Fields
from calibrant.formats.documents.document import Document
from calibrant.formats.exchange.exchange_format import ExchangeFormat, ReadOptions, Size, WriteOptions
from calibrant.formats.exchange.places import places_in, world_of
from calibrant.formats.exchange.rotation_numbers import finite
from calibrant.formats.scenes.entries import entries, has_camera, number, numbers, placed_cameras, rigid, size_in
from calibrant.formats.scenes.looking import TURNED, focal_of, pinhole, shift_of
from calibrant.geometry import rotations, se3
from calibrant.reading.notes import note_unused

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_PRINTED = re.compile(r"Matrix(?: 4x4)?\s{0,20}\(")
_FOUND_NUMBER = re.compile(_NUMBER)
_NAMED = re.compile(
    r"\b(lens|angle|sensor_width|sensor_height|sensor_fit|shift_x|shift_y|resolution_x|resolution_y"
    rf"|resolution_percentage|pixel_aspect_x|pixel_aspect_y|scale_length)\b[\s:=,'\"]{{1,9}}([A-Z]{{4,10}}|{_NUMBER})"
)
_FITS = ("AUTO", "HORIZONTAL", "VERTICAL")
_LENGTHS = ("lens", "sensor_width", "sensor_height")
_ASKED = (*_LENGTHS, "sensor_fit")
_SENSOR_MM = 36.0
_LONGEST = 1_000_000


def _is_camera(keys: set[str]) -> bool:
    return "matrixworld" in keys or ("location" in keys and bool({"lens", "sensorwidth"} & keys))


def _matches(document: Document) -> bool:
    if document.data is not None:
        return has_camera(document.data, _is_camera)
    return _PRINTED.search(document.text or "") is not None


def _read(document: Document, options: ReadOptions) -> CalibrationResult:
    source = str(document.path)
    data = document.data if document.data is not None else _printed(document.text or "", source)
    found: dict[str, tuple[Camera, Array | None]] = {}
    for name, fields in entries(data, _is_camera, source).items():
        where = f"{source}: {name}"
        said = {
            key: value
            for key, value in options.answers.items()
            if key in _ASKED and fields.peek(key.replace("_", "")) is None
        }
        fields.spread(said)
        scale = number(fields, "scalelength", where)
        T = _pose(fields, where) @ TURNED
        T[:3, 3] *= options.unit_m or (1.0 if scale is None else scale)
        found[name] = _lens(fields, size_in(fields, options.image_size, where), where), T
        fields.get("name")
        note_unused(where, fields.unused())
    if not found:
        raise InputError(f"{source}: no camera with matrix_world in it")
    return placed_cameras(found)


def _printed(text: str, source: str) -> Mapping[str, Any]:
    """What a print says: the one matrix in it, and the numbers behind the names of Blender's properties."""
    if len(text) > _LONGEST:
        raise InputError(f"{source}: {len(text):,} characters; a print of one camera has some hundred")
    starts = list(_PRINTED.finditer(text))
    if len(starts) != 1:
        raise InputError(f"{source}: {len(starts)} matrices printed; expected that of one camera")
    numbers_behind = [m[0] for m, _ in zip(_FOUND_NUMBER.finditer(text, starts[0].end()), range(16))]
    return {
        **{key: value if value in _FITS else float(value) for key, value in _NAMED.findall(text) if _is_value(value)},
        "matrix_world": finite(numbers_behind, 16, f"{source}: the printed matrix").reshape(4, 4).tolist(),
    }


def _is_value(text: str) -> bool:
    return text in _FITS or _FOUND_NUMBER.fullmatch(text) is not None


def _pose(fields: Fields, where: str) -> Array:
    matrix = fields.get("matrixworld")
    if matrix is not None:
        flat = numbers_of(matrix, f"{where}: matrix_world")
        return rigid(flat.reshape(4, 4), f"{where}: matrix_world")
    position = numbers(fields.get("location"), "xyz", f"{where}: location")
    quaternion, euler = fields.get("rotationquaternion"), fields.get("rotationeuler")
    if quaternion is not None:
        wxyz = numbers(quaternion, "wxyz", f"{where}: rotation_quaternion")
        return se3.make(rotations.matrix_from_quaternion_wxyz(wxyz), position)
    if euler is None:
        raise InputError(f"{where}: location without rotation_euler or rotation_quaternion")
    order = str(fields.get("rotationmode") or "XYZ")
    if order not in rotations.INTRINSIC_EULER_ORDERS:
        raise InputError(f"{where}: rotation_mode {order[:20]!r} with rotation_euler; expected XYZ or its like")
    # Blender's XYZ turns about the fixed x, then y, then z; its numbers stay by axis.
    angles = numbers(euler, "xyz", f"{where}: rotation_euler")[["XYZ".index(letter) for letter in order]]
    return se3.make(rotations.matrix_from_euler(angles, order=order.lower(), unit="rad"), position)


def numbers_of(value: Any, where: str) -> Array:
    """Sixteen numbers of a matrix by rows, nested or flat, or as Python prints it."""
    if isinstance(value, str):
        return finite(_FOUND_NUMBER.findall(value.replace("4x4", "")), 16, where)
    rows = value if isinstance(value, list) else []
    flat = [v for row in rows for v in (row if isinstance(row, list) else [row])]
    return finite(flat, 16, where)


def _lens(fields: Fields, size: Size, where: str) -> Camera:
    kind = str(fields.get("type") or "PERSP")
    if kind != "PERSP":
        raise InputError(f"{where} is a {kind[:20]} camera; expected PERSP")
    fit = str(fields.get("sensorfit") or "AUTO").upper()
    if fit not in _FITS:
        raise InputError(f"{where}: sensor_fit {fit[:20]!r}, expected {', '.join(_FITS)}")
    ax, ay = (number(fields, f"pixelaspect{axis}", where, 1.0) or 0.0 for axis in "xy")
    if not (ax > 0 and ay > 0):
        raise InputError(f"{where}: pixel_aspect {ax:g} to {ay:g}; expected numbers above 0")
    (width, height), aspect = size, ay / ax
    across = fit == "HORIZONTAL" or (fit == "AUTO" and width >= aspect * height)
    n = width if across else aspect * height
    fx = n * _lens_over_sensor(fields, "sensorheight" if fit == "VERTICAL" else "sensorwidth", where)
    shift = [number(fields, f"shift{axis}", where, 0.0) or 0.0 for axis in "xy"]
    for key in ("sensorwidth", "sensorheight", "lens", "angle", "lensunit"):
        fields.get(key)
    return pinhole(size, (fx, fx / aspect), (-shift[0] * n, shift[1] * n / aspect), where)


def _lens_over_sensor(fields: Fields, sensor_key: str, where: str) -> float:
    """lens / sensor, or half the cotangent of half the angle of view over the fitted side."""
    lens, sensor = number(fields, "lens", where), number(fields, sensor_key, where)
    angle = number(fields, "angle", where)
    if lens is not None and sensor is not None:
        if not (lens > 0 and sensor > 0):
            raise InputError(f"{where}: a lens of {lens:g} mm over a sensor of {sensor:g} mm; expected lengths above 0")
        return lens / sensor
    if angle is not None:
        return focal_of(1.0, float(np.rad2deg(angle)), f"{where}: angle")
    name = sensor_key.replace("sensor", "sensor_")
    missing = " and ".join(key for key, value in (("lens", lens), (name, sensor)) if value is None)
    raise InputError(f"{where}: {missing} (mm) is not in the file; say it: --answer lens=50 --answer {name}=36")


def _entry(camera: Camera, T_world_optical: Array) -> dict[str, Any]:
    p, (width, height) = camera.parameters, camera.image_size
    right, down = shift_of(camera)
    aspect = p["fx"] / p["fy"]
    return {
        "matrix_world": (T_world_optical @ TURNED + 0.0).tolist(),
        "lens": _SENSOR_MM * p["fx"] / width,
        "sensor_fit": "HORIZONTAL",
        "sensor_width": _SENSOR_MM,
        "shift_x": -right / width + 0.0,
        "shift_y": down * aspect / width + 0.0,
        "resolution_x": width,
        "resolution_y": height,
        "resolution_percentage": 100,
        # Blender takes no aspect below 1.
        "pixel_aspect_x": max(1.0, 1 / aspect),
        "pixel_aspect_y": max(1.0, aspect),
    }


def _write(result: CalibrationResult, options: WriteOptions) -> bytes:
    world = world_of(result, options.answers.get("world"))
    places = places_in(result, world, tuple(result.cameras))
    listed = [{"name": name, **_entry(result.cameras[name], T)} for name, T in places.items()]
    return (json.dumps({"cameras": listed}, indent=2) + "\n").encode()


FORMAT = ExchangeFormat(
    name="blender",
    title="Blender cameras (JSON, or a print of matrix_world)",
    suffix=".blender.json",
    matches=_matches,
    read=_read,
    write=_write,
    models=("pinhole",),
    asks={
        **dict.fromkeys(_LENGTHS, "millimetres, where the file does not say it"),
        "sensor_fit": ", ".join(_FITS),
        "world": "the frame that is Blender's world",
    },
)
