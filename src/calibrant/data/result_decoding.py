"""A result from JSON: every key checked, every message naming the key, what was found and what was expected."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from typing import Any, NoReturn, TypeVar

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.data.cell_layout import CellLayout
from calibrant.data.details import DETAILS
from calibrant.data.format_one import FORMAT_ONE, from_format_one
from calibrant.data.observations import DEFAULT_CAMERA, Carried, Missed, Observations, View
from calibrant.data.poses import RobotPoses
from calibrant.data.result_encoding import FORMAT
from calibrant.data.results import (
    CalibrationResult,
    Check,
    HeldOut,
    JointCovariance,
    Measured,
    MethodResult,
    SigmaRobot,
    TransformEstimate,
    ViewResult,
)
from calibrant.data.typed_json import Json, from_json
from calibrant.errors import InputError
from calibrant.version import __version__

T = TypeVar("T")
_MOST_PIXELS_A_SIDE = 1_000_000
"""No picture has more."""
KEYS = frozenset(
    (
        *("format", "kind", "version", "created", "verdict", "cameras", "transforms", "joint_covariance", "rms_px"),
        *("sigma_px", "sigma_robot", "target_scale", "figures", "decided", "cell", "details", "held_out", "checks"),
        *("methods", "views", "options", "inputs", "notes", "robot_poses", "T_camera_target", "observations"),
    )
)
"""Keys of a file."""


def refuse_constant(name: str) -> NoReturn:
    raise InputError(f"holds {name}; a result file holds finite numbers only")


_KINDS: dict[type, str] = {str: "text", bool: "true or false", int: "an integer", dict: "an object", list: "a list"}


def _get(data: Any, key: str, kind: type[T], where: str) -> T:
    """The value of a key that must be there. Raises: InputError: the key, what was found, what was expected."""
    if _object(data, where).get(key) is None:
        raise InputError(f"{where} has no key {key!r}; it has: {', '.join(data) or 'none'}")
    value = data[key]
    # In Python a bool is an int; in a file it is not.
    if not isinstance(value, kind) or (kind is int and isinstance(value, bool)):
        raise InputError(f"{where}.{key} is {json.dumps(value)[:60]}, expected {_KINDS[kind]}")
    return value


def _object(data: Any, where: str) -> Json:
    if not isinstance(data, dict):
        raise InputError(f"{where} is {json.dumps(data)[:60]}, expected {_KINDS[dict]}")
    return data


def _maybe(data: Json, key: str, kind: type[T], where: str) -> T | None:
    return None if _object(data, where).get(key) is None else _get(data, key, kind, where)


def _number(data: Json, key: str, where: str) -> float:
    value = _object(data, where).get(key)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"{where}.{key} is {json.dumps(value)[:60]}, expected a number")
    if not math.isfinite(value):
        raise InputError(f"{where}.{key} is beyond all numbers; a result file holds finite numbers only")
    return float(value)


def _maybe_number(data: Json, key: str, where: str) -> float | None:
    return None if _object(data, where).get(key) is None else _number(data, key, where)


def _array(data: Json, key: str, shape: tuple[int, ...], where: str) -> Array:
    """An array of numbers; -1 in `shape` stands for any length."""
    rows = _get(data, key, list, where)
    try:
        array = np.array(rows, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{where}.{key} is not an array of numbers ({error})") from error
    if not np.all(np.isfinite(array)):
        raise InputError(f"{where}.{key} holds a number beyond all numbers; a result file holds finite numbers only")
    if len(rows) == 0 and -1 in shape:
        array = array.reshape(tuple(0 if n == -1 else n for n in shape))
    if array.ndim != len(shape) or any(n not in (-1, m) for n, m in zip(shape, array.shape)):
        wanted = ", ".join("n" if n == -1 else str(n) for n in shape)
        raise InputError(f"{where}.{key} has shape {array.shape}, expected ({wanted})")
    return array


def _maybe_array(data: Json, key: str, shape: tuple[int, ...], where: str) -> Array | None:
    return None if _object(data, where).get(key) is None else _array(data, key, shape, where)


def _size(data: Json, key: str, where: str) -> tuple[int, int]:
    """Width and height in whole pixels."""
    width, height = _array(data, key, (2,), where).tolist()
    if not all(1 <= n <= _MOST_PIXELS_A_SIDE and n == int(n) for n in (width, height)):
        raise InputError(f"{where}.{key} is [{width:g}, {height:g}], expected width and height in whole pixels")
    return int(width), int(height)


def _records(data: Json, key: str, decode: Callable[[Json, str], T]) -> tuple[T, ...]:
    return tuple(decode(item, f"{key}[{i}]") for i, item in enumerate(_maybe(data, key, list, "file") or []))


def _named(data: Json, key: str, decode: Callable[[Json, str], T]) -> dict[str, T]:
    return {name: decode(item, f"{key}.{name}") for name, item in (_maybe(data, key, dict, "file") or {}).items()}


def decode(data: Any) -> CalibrationResult:
    if not isinstance(data, dict) or "format" not in data:
        raise InputError(f"not a calibrant file: expected a JSON object with the key 'format', {FORMAT!r}")
    if data["format"] == FORMAT_ONE:
        data = from_format_one(data)
    elif data["format"] != FORMAT:
        raise InputError(
            f"the format is {data['format']!r}; this version ({__version__}) reads {FORMAT!r} and {FORMAT_ONE!r}: "
            "update calibrant"
        )
    verdict = _get(data, "verdict", str, "file")
    if verdict not in ("ok", "warn", "refused"):
        raise InputError(f"file.verdict is {verdict!r}, expected 'ok', 'warn' or 'refused'")
    robot, scale, held = (_maybe(data, key, dict, "file") for key in ("sigma_robot", "target_scale", "held_out"))
    cell = _maybe(data, "cell", dict, "file")
    poses, seen, joint = (_maybe(data, k, dict, "file") for k in ("robot_poses", "observations", "joint_covariance"))
    return CalibrationResult(
        kind=_get(data, "kind", str, "file"),
        verdict=verdict,  # type: ignore[arg-type]
        checks=_records(data, "checks", _decode_check),
        cameras=_named(data, "cameras", _decode_camera),
        transforms=_records(data, "transforms", _decode_transform),
        joint_covariance=None if joint is None else _decode_joint(joint),
        rms_px=_maybe_number(data, "rms_px", "file"),
        sigma_px=_maybe_number(data, "sigma_px", "file"),
        sigma_robot=None if robot is None else _decode_sigma_robot(robot),
        views=_records(data, "views", _decode_view),
        methods=_named(data, "methods", _decode_method),
        target_scale=None if scale is None else from_json(Measured, scale, "target_scale"),
        held_out=None
        if held is None
        else HeldOut(**{k: _maybe_number(held, k, "held_out") for k in ("mm", "deg", "px")}),
        options=_maybe(data, "options", dict, "file") or {},
        figures=from_json(Mapping[str, Measured], _maybe(data, "figures", dict, "file") or {}, "figures"),
        decided=from_json(Mapping[str, str], _maybe(data, "decided", dict, "file") or {}, "decided"),
        cell=None if cell is None else from_json(CellLayout, cell, "cell"),
        details=_decode_details(_maybe(data, "details", dict, "file") or {}),
        inputs=_decode_inputs(data),
        notes=tuple(str(note) for note in _maybe(data, "notes", list, "file") or ()),
        observations=None if seen is None else _decode_observations(seen),
        robot_poses=None if poses is None else _decode_poses(poses),
        T_camera_target=_maybe_array(data, "T_camera_target", (-1, 4, 4), "file"),
        created=_get(data, "created", str, "file"),
        version=_get(data, "version", str, "file"),
    )


def _decode_details(data: Json) -> tuple[Any, ...]:
    unknown = [name for name in data if name not in DETAILS]
    if unknown:
        raise InputError(f"details has the key {unknown[0]!r}; expected: {', '.join(DETAILS)}")
    return tuple(from_json(DETAILS[name], record, f"details.{name}") for name, record in data.items())


def _decode_inputs(data: Json) -> tuple[dict[str, str], ...]:
    out = []
    for i, item in enumerate(_maybe(data, "inputs", list, "file") or ()):
        record = _object(item, f"inputs[{i}]")
        out.append({key: _get(record, key, str, f"inputs[{i}]") for key in record})
    return tuple(out)


def _decode_camera(data: Json, where: str) -> Camera:
    parameters = _get(data, "parameters", dict, where)
    size = _size(data, "image_size", where)
    return Camera.create(
        _get(data, "model", str, where),
        {name: _number(parameters, name, f"{where}.parameters") for name in parameters},
        image_size=size,
        covariance=_maybe_array(data, "covariance", (-1, -1), where),
    )


def _decode_transform(data: Json, where: str) -> TransformEstimate:
    return TransformEstimate(
        _get(data, "parent", str, where),
        _get(data, "child", str, where),
        _array(data, "matrix", (4, 4), where),
        _maybe_array(data, "covariance", (6, 6), where),
    )


def _decode_joint(data: Json) -> JointCovariance:
    where = "joint_covariance"
    frames = []
    for i, pair in enumerate(_get(data, "frames", list, where)):
        if not isinstance(pair, list) or len(pair) != 2:
            raise InputError(f"{where}.frames[{i}] is {json.dumps(pair)[:60]}, expected [parent, child]")
        frames.append((str(pair[0]), str(pair[1])))
    cameras = tuple(str(name) for name in _maybe(data, "cameras", list, where) or ())
    across, lenses = (_maybe_array(data, key, (-1, -1), where) for key in ("across", "lenses"))
    return JointCovariance(tuple(frames), _array(data, "matrix", (-1, -1), where), cameras, across, lenses)


def _decode_check(data: Json, where: str) -> Check:
    status = _get(data, "status", str, where)
    if status not in ("ok", "warn", "fail"):
        raise InputError(f"{where}.status is {status!r}, expected 'ok', 'warn' or 'fail'")
    name, message = _get(data, "name", str, where), _get(data, "message", str, where)
    return Check(name, status, message, _maybe_number(data, "value", where))  # type: ignore[arg-type]


def _decode_method(data: Json, where: str) -> MethodResult:
    loop_mm, loop_deg = (_maybe_number(data, key, where) for key in ("loop_rms_mm", "loop_rms_deg"))
    return MethodResult(
        _maybe_array(data, "matrix", (4, 4), where), loop_mm, loop_deg, _maybe(data, "message", str, where) or ""
    )


def _decode_sigma_robot(data: Json) -> SigmaRobot:
    where = "sigma_robot"
    return SigmaRobot(
        _number(data, "mm", where),
        _number(data, "deg", where),
        _maybe_number(data, "mm_sigma", where),
        _maybe_number(data, "deg_sigma", where),
    )


def _decode_view(data: Json, where: str) -> ViewResult:
    return ViewResult(
        id=_get(data, "id", str, where),
        used=_get(data, "used", bool, where),
        points=_get(data, "points", int, where),
        rms_px=_maybe_number(data, "rms_px", where),
        reason=_maybe(data, "reason", str, where),
        camera=_maybe(data, "camera", str, where),
        points_left_out=_maybe(data, "points_left_out", int, where) or 0,
        T_camera_target=_maybe_array(data, "T_camera_target", (4, 4), where),
        min_px=_maybe_number(data, "min_px", where),
        max_px=_maybe_number(data, "max_px", where),
    )


def _decode_poses(data: Json) -> RobotPoses:
    where = "robot_poses"
    ids = tuple(str(name) for name in _get(data, "ids", list, where))
    return RobotPoses(ids, _array(data, "T_base_gripper", (-1, 4, 4), where), _maybe(data, "source", str, where) or "")


def _decode_carried(view: Json, where: str) -> Carried | None:
    data, at = _maybe(view, "carried", dict, where), f"{where}.carried"
    if data is None:
        return None
    return Carried(
        _get(data, "camera", str, at), _array(data, "uv", (-1, 2), at), _array(data, "slope", (-1, 2, 2), at)
    )


def _decode_observations(data: Json) -> Observations:
    where = "observations"
    views = []
    for i, item in enumerate(_get(data, "views", list, where)):
        at = f"{where}.views[{i}]"
        name = _get(item, "id", str, at)
        views.append(
            View(
                id=name,
                points=_array(item, "points", (-1, 3), at),
                uv=_array(item, "uv", (-1, 2), at),
                point_ids=_array(item, "point_ids", (-1,), at).astype(np.int64),
                camera=_maybe(item, "camera", str, at) or DEFAULT_CAMERA,
                moment=_maybe(item, "moment", str, at) or name,
                sigma_px=_maybe_array(item, "sigma_px", (-1,), at),
                covariance_px=_maybe_array(item, "covariance_px", (-1, 2, 2), at),
                file=_maybe(item, "file", str, at),
                carried=_decode_carried(item, at),
            )
        )
    sizes = _get(data, "image_sizes", dict, where)
    image_sizes = {}
    for camera in sizes:
        image_sizes[camera] = _size(sizes, camera, f"{where}.image_sizes")
    missed = []
    for i, item in enumerate(_maybe(data, "missed", list, where) or []):
        at = f"{where}.missed[{i}]"
        camera = _maybe(item, "camera", str, at) or DEFAULT_CAMERA
        missed.append(
            Missed(_get(item, "id", str, at), _get(item, "reason", str, at), camera, _maybe(item, "file", str, at))
        )
    notes = tuple(str(note) for note in _maybe(data, "notes", list, where) or ())
    return Observations(tuple(views), image_sizes, _maybe(data, "target", str, where), tuple(missed), notes)
