"""Cameras of Unity as JSON: position, rotation, field of view or a physical lens; left-handed, y up, z ahead.

    X_world = S (R_u M X_optical + t_u)     S mirrors one axis of Unity's world, M = diag(1, -1, 1)

R_u is Unity's rotation: of a quaternion x, y, z, w, or of Euler angles in degrees turned about z, then x, then y
(R = Ry Rx Rz). Both mirrors together keep a board's text readable: det(S) det(M) = 1. fieldOfView is the vertical angle
of view; a lens shift moves the view by that share of the sensor, so that the principal point goes left and down:

    u = W/2 - shift_x W - 1/2,   v = H/2 + shift_y H - 1/2

Sources: Unity scripting reference, Camera.fieldOfView, Camera.lensShift, Camera.sensorSize, Camera.gateFit,
Transform.eulerAngles.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult
from calibrant.errors import InputError
from calibrant.formats.cameras.fields import Fields
from calibrant.formats.documents.document import Document
from calibrant.formats.exchange.exchange_format import ExchangeFormat, ReadOptions, Size, WriteOptions, answer
from calibrant.formats.exchange.places import places_in, world_of
from calibrant.formats.exchange.rotation_numbers import pose_of
from calibrant.formats.scenes.entries import entries, has_camera, number, numbers, placed_cameras, size_in
from calibrant.formats.scenes.looking import angle_of, focal_of, pinhole, shift_of
from calibrant.geometry import rotations, se3
from calibrant.reading.notes import note, note_unused

_M = np.diag([1.0, -1.0, 1.0, 1.0])
_AXES = ("x", "y", "z")
_DEFAULT_AXIS = "z"
_NO_FIT = ("none", "0")
_SENSOR_MM = 36.0
"""Width of a written sensor; what it is does not change a picture."""
_ASKS = {"axis": "the axis of Unity's world that is mirrored, x, y or z (z where nothing is said)"}


def _is_camera(keys: set[str]) -> bool:
    lens = bool({"fieldofview", "lensshift"} & keys) or {"focallength", "sensorsize"} <= keys
    return lens and "position" in keys and bool({"rotation", "eulerangles"} & keys)


def _matches(document: Document) -> bool:
    return has_camera(document.data, _is_camera)


def _mirror(axis: str | None) -> Array:
    """S (4, 4) of an axis."""
    signs = np.ones(4)
    signs[_AXES.index(axis or _DEFAULT_AXIS)] = -1
    return np.diag(signs)


def _read(document: Document, options: ReadOptions) -> CalibrationResult:
    source = str(document.path)
    said = answer(options.answers, "axis", _AXES)
    S = _mirror(said)
    found: dict[str, tuple[Camera, Array | None]] = {}
    for name, fields in entries(document.data, _is_camera, source).items():
        where = f"{source}: {name}"
        T = S @ _pose(fields, options.unit_m or 1.0, where) @ _M
        found[name] = _lens(fields, size_in(fields, options.image_size, where), where), T
        fields.get("name")
        note_unused(where, fields.unused())
    if not found:
        raise InputError(f"{source}: no camera with fieldOfView, position and rotation in it")
    if said is None:
        note(f"{source}: Unity's world is left-handed; its {_DEFAULT_AXIS} was mirrored (--answer axis=x, y or z)")
    return placed_cameras(found)


def _pose(fields: Fields, unit_m: float, where: str) -> Array:
    """Unity's own pose (4, 4), left-handed, lengths in metres."""
    position = unit_m * numbers(fields.get("position"), "xyz", f"{where}: position")
    turn, euler = fields.get("rotation"), fields.get("eulerangles")
    if "w" in turn if isinstance(turn, Mapping) else isinstance(turn, list) and len(turn) == 4:
        return pose_of(position, numbers(turn, "xyzw", f"{where}: rotation"), where)
    degrees = numbers(euler if euler is not None else turn, "xyz", f"{where}: eulerAngles")
    # About z, then x, then y, all of the fixed frame; the formulas are the same in a left-handed one.
    R = rotations.matrix_from_euler(degrees[[2, 0, 1]], order="zxy", unit="deg")
    return se3.make(R, position)


def _lens(fields: Fields, size: Size, where: str) -> Camera:
    if fields.get("orthographic") is True:
        raise InputError(f"{where} is orthographic: it has no focal length")
    width, height = size
    moved = fields.get("lensshift")
    shift = np.zeros(2) if moved is None else numbers(moved, "xy", f"{where}: lensShift")
    vertical = number(fields, "fieldofview", where)
    lens, sensor = number(fields, "focallength", where), fields.get("sensorsize")
    fit = str(fields.get("gatefit") or "").lower()
    physical = fields.get("usephysicalproperties")
    if lens is not None and sensor is not None and physical is not False and (fit in _NO_FIT or vertical is None):
        sides = numbers(sensor, "xy", f"{where}: sensorSize")
        if not np.all(sides > 0):
            raise InputError(f"{where}: a sensor of {sides[0]:g} x {sides[1]:g} mm; expected lengths above 0")
        if fit not in _NO_FIT and abs(sides[0] * height / (sides[1] * width) - 1) > 1e-4:
            raise InputError(
                f"{where}: the sensor is {sides[0]:g} x {sides[1]:g} mm, the image {width}x{height} px, and how one is "
                "fitted into the other is not said; give fieldOfView, or gateFit None"
            )
        focal = lens / sides[0] * width, lens / sides[1] * height
    elif vertical is not None:
        focal = (focal_of(height, vertical, where),) * 2
        if fit not in ("", *_NO_FIT) and np.any(shift):
            raise InputError(
                f"{where}: a lensShift with gateFit {fit} depends on the sensor; save it with gateFit None"
            )
    else:
        raise InputError(f"{where}: neither fieldOfView nor focalLength with sensorSize")
    return pinhole(size, focal, (-shift[0] * width, shift[1] * height), where)


def _entry(camera: Camera, T_world_optical: Array, S: Array) -> dict[str, Any]:
    T = S @ T_world_optical @ _M
    p, (width, height) = camera.parameters, camera.image_size
    right, down = shift_of(camera)
    quaternion = rotations.quaternion_xyzw_from_matrix(T[:3, :3]) + 0.0
    return {
        "position": dict(zip("xyz", (T[:3, 3] + 0.0).tolist())),
        "rotation": dict(zip("xyzw", quaternion.tolist())),
        "fieldOfView": angle_of(height, p["fy"]),
        "usePhysicalProperties": True,
        "gateFit": "None",
        "sensorSize": {"x": _SENSOR_MM, "y": _SENSOR_MM * p["fx"] * height / (p["fy"] * width)},
        "focalLength": _SENSOR_MM * p["fx"] / width,
        "lensShift": {"x": -right / width, "y": down / height},
        "pixelWidth": width,
        "pixelHeight": height,
    }


def _write(result: CalibrationResult, options: WriteOptions) -> bytes:
    world = world_of(result, options.answers.get("world"))
    S = _mirror(answer(options.answers, "axis", _AXES))
    places = places_in(result, world, tuple(result.cameras))
    listed = [{"name": name, **_entry(result.cameras[name], T, S)} for name, T in places.items()]
    return (json.dumps({"cameras": listed}, indent=2) + "\n").encode()


FORMAT = ExchangeFormat(
    name="unity",
    title="Unity cameras (JSON)",
    suffix=".unity.json",
    matches=_matches,
    read=_read,
    write=_write,
    models=("pinhole",),
    asks=_ASKS | {"world": "the frame that is Unity's world"},
)
