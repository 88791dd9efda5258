"""Vision sensors of CoppeliaSim, as PyRep and RLBench save them: a pose of seven numbers, an angle, a resolution.

    T_world_optical = T_world_sensor diag(-1, -1, 1, 1)     a sensor looks along its z; x is left, y up

pose is x y z qx qy qz qw (metres; CoppeliaSim's order, scalar last). The perspective angle is that of the image's
longer side. RLBench's observations hold *_camera_extrinsics, T_world_sensor, and *_camera_intrinsics, whose focal
lengths are negative because of the axes. Seven numbers alone are read where it is said that they are such a pose
(`--read-as coppelia`), with `--answer perspective_angle=60`. Sources: CoppeliaSim manual, "Vision sensor properties",
sim.getObjectPose; stepjam/PyRep, pyrep/objects/vision_sensor.py (get_intrinsic_matrix).
"""

from __future__ import annotations

import json
import math
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
from calibrant.formats.exchange.exchange_format import ExchangeFormat, ReadOptions, Size, WriteOptions, answer
from calibrant.formats.exchange.places import places_in, world_of
from calibrant.formats.exchange.rotation_numbers import finite, pose_of
from calibrant.formats.scenes.entries import entries, has_camera, number, numbers, placed_cameras, rigid, size_in
from calibrant.formats.scenes.looking import angle_of, focal_of, pinhole, shift_of
from calibrant.geometry import rotations
from calibrant.reading.notes import note, note_unused

_TURNED = np.diag([-1.0, -1.0, 1.0, 1.0])
_ANGLES = ("perspectiveangle", "perspectiveangledeg", "perspectiveanglerad", "viewangle")
_UNITS = ("deg", "rad")
_MISC = re.compile(r"^(.{1,60})_camera_(extrinsics|intrinsics)$")
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_LONGEST = 1000
_EXACT_PX = 1e-6


def _is_camera(keys: set[str]) -> bool:
    return bool(set(_ANGLES) & keys) and bool({"pose", "position", "matrix"} & keys)


def _misc(document: Document) -> dict[str, dict[str, Any]]:
    """RLBench's pairs of matrices by camera."""
    found: dict[str, dict[str, Any]] = {}
    for key, value in document.mapping.items():
        parts = _MISC.match(str(key))
        if parts:
            found.setdefault(parts[1], {})[parts[2]] = value
    return {name: value for name, value in found.items() if len(value) == 2}


def _matches(document: Document) -> bool:
    return bool(_misc(document)) or has_camera(document.data, _is_camera)


def _read(document: Document, options: ReadOptions) -> CalibrationResult:
    source = str(document.path)
    unit = answer(options.answers, "angle", _UNITS)
    found: dict[str, tuple[Camera, Array | None]] = {}
    for name, matrices in _misc(document).items():
        found[name] = _of_matrices(matrices, options.image_size, f"{source}: {name}_camera")
    for name, fields in (entries(document.data, _is_camera, source) or _bare(document, options)).items():
        where = f"{source}: {name}"
        size = size_in(fields, options.image_size, where)
        f = focal_of(max(size), _degrees(fields, unit, where), where)
        found[name] = pinhole(size, (f, f), (0.0, 0.0), where), _pose(fields, where) @ _TURNED
        fields.get("name")
        note_unused(where, fields.unused())
    if not found:
        raise InputError(f"{source}: no camera with a perspective angle and a pose, or RLBench's two matrices, in it")
    return placed_cameras(found)


def _bare(document: Document, options: ReadOptions) -> dict[str, Fields]:
    """The camera of a text of seven numbers, and of the angle that was said; none of another text."""
    found = _NUMBER.findall(document.text or "") if len(document.text or "") < _LONGEST else []
    angle = options.answers.get("perspective_angle")
    if len(found) != 7:
        return {}
    if angle is None:
        raise InputError(f"{document.path}: a pose, and no angle of view; say it: --answer perspective_angle=60")
    return {"camera": Fields({"pose": [float(v) for v in found], "perspective_angle_deg": angle})}


def _degrees(fields: Fields, unit: str | None, where: str) -> float:
    """The angle. Raises: InputError where its unit could be both: CoppeliaSim has radians, PyRep degrees."""
    key = next(key for key in _ANGLES if key in fields)
    value = number(fields, key, where) or 0.0
    named = key[-3:] if key[-3:] in _UNITS else None
    unit = unit or named or ("deg" if abs(value) > math.pi else None)
    if unit is None:
        raise InputError(
            f"{where}: an angle of {value:g} may be degrees or radians: say --answer angle=deg or angle=rad"
        )
    return value if unit == "deg" else math.degrees(value)


def _pose(fields: Fields, where: str) -> Array:
    seven, matrix = fields.get("pose"), fields.get("matrix")
    if seven is not None:
        values = numbers(seven, "xyzabcd", f"{where}: pose (x y z qx qy qz qw)")
        return pose_of(values[:3], values[3:], where)
    if matrix is not None:
        return _pose_matrix(matrix, f"{where}: matrix")
    position = numbers(fields.get("position"), "xyz", f"{where}: position")
    given = fields.first(("quaternion", "orientation", "rotation"))
    if given is None:
        raise InputError(f"{where}: position without quaternion (x y z w)")
    return pose_of(position, numbers(given[1], "xyzw", f"{where}: {given[0]}"), where)


def _pose_matrix(value: Any, where: str) -> Array:
    """T (4, 4) of twelve numbers, as sim.getObjectMatrix has them, or sixteen."""
    flat = np.ravel(np.asarray(value, dtype=object)).tolist() if isinstance(value, list | np.ndarray) else [value]
    flat = [v for row in flat for v in (row if isinstance(row, list) else [row])]
    flat = [*flat, 0, 0, 0, 1] if len(flat) == 12 else flat
    return rigid(finite(flat, 16, where).reshape(4, 4), where)


def _of_matrices(matrices: Mapping[str, Any], image_size: Size | None, where: str) -> tuple[Camera, Array]:
    flat = np.ravel(np.asarray(matrices["intrinsics"], dtype=object)).tolist()
    K = finite([v for row in flat for v in (row if isinstance(row, list) else [row])], 9, f"{where}_intrinsics")
    fx, fy, cx, cy = K[[0, 4, 2, 5]]
    if not (fx < 0 and fy < 0):
        raise InputError(
            f"{where}_intrinsics: focal lengths {fx:g} and {fy:g}; RLBench's are negative, its sensors having x to the "
            "left and y up. Are these matrices of another program?"
        )
    twice = round(2 * cx), round(2 * cy)
    if image_size is None:
        note(f"{where}: no image size in the file; twice the principal point, {twice[0]}x{twice[1]} px, stands for it")
    size = image_size or twice
    camera = pinhole(size, (-fx, -fy), (cx - size[0] / 2, cy - size[1] / 2), where)
    return camera, _pose_matrix(matrices["extrinsics"], f"{where}_extrinsics") @ _TURNED


def _entry(name: str, camera: Camera, T_world_optical: Array, *, nearest: bool) -> dict[str, Any]:
    p, size = camera.parameters, camera.image_size
    f = math.sqrt(p["fx"] * p["fy"])
    right, down = shift_of(camera)
    off = np.hypot(
        abs(right) + abs(p["fx"] / f - 1) * size[0] / 2,
        abs(down) + abs(p["fy"] / f - 1) * size[1] / 2,
    )
    if off > _EXACT_PX:
        text = f"{name}: CoppeliaSim's sensors have square pixels about the image's middle, off by up to {off:.3g} px"
        if not nearest:
            raise InputError(f"{text}. Take that with --choose nearest=yes, or write another format")
        note(text)
    T = T_world_optical @ _TURNED
    quaternion = rotations.quaternion_xyzw_from_matrix(T[:3, :3])
    return {
        "pose": [float(v) + 0.0 for v in (*T[:3, 3], *quaternion)],
        "perspective_angle_deg": angle_of(max(size), f),
        "resolution": list(size),
    }


def _write(result: CalibrationResult, options: WriteOptions) -> bytes:
    world = world_of(result, options.answers.get("world"))
    nearest = answer(options.answers, "nearest", ("yes", "no")) == "yes"
    places = places_in(result, world, tuple(result.cameras))
    values = {name: _entry(name, result.cameras[name], T, nearest=nearest) for name, T in places.items()}
    return (json.dumps({"cameras": values}, indent=2) + "\n").encode()


FORMAT = ExchangeFormat(
    name="coppelia",
    title="CoppeliaSim and RLBench vision sensors (JSON)",
    suffix=".coppelia.json",
    matches=_matches,
    read=_read,
    write=_write,
    models=("pinhole",),
    asks={
        "angle": f"the unit of the perspective angle, {' or '.join(_UNITS)}, where it is below pi",
        "perspective_angle": "the angle of view of the longer side in degrees, for a pose alone",
        "nearest": "yes writes square pixels about the image's middle, and says by how much that is off",
        "world": "the frame that is the scene's world",
    },
)
