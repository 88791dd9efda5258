"""basalt's calibration.json: cameras on an IMU, as cereal writes `basalt::Calibration`.

    X_imu = T_imu_cam X_cam,   px py pz m, qx qy qz qw;   t_imu = t_cam + cam_time_offset_ns

    camera_type       here                        terms
    pinhole           pinhole
    kb4               kannala_brandt              k1 k2 k3 k4
    ds                double_sphere               xi alpha
    eucm              extended_unified            alpha beta
    ucm               extended_unified, beta = 1  alpha
    pinhole-radtan8   rational                    k1 k2 p1 p2 k3 k4 k5 k6 (and rpmax, beyond which it sees nothing)
    fov               the nearest                 w

Pixels are counted from the middle of the first one: corners of its AprilGrids are OpenCV's. What a rig lacks for
basalt's IMU (noise, biases, rate) is written as basalt's own defaults, and said. Source: basalt-headers'
serialization/headers_serialization.h, camera/*_camera.hpp (eq. of each model) and calibration/calibration.hpp.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, as_transform
from calibrant.data.results import Measured
from calibrant.errors import InputError
from calibrant.formats.cameras.calibrators.chain import fov_camera
from calibrant.formats.cameras.calibrators.kalibr import SHIFT
from calibrant.formats.cameras.calibrators.rigid import finite, from_quaternion
from calibrant.formats.cameras.camera_format import Size, placed_camera, single, whole_size
from calibrant.formats.cameras.foreign_lens import ASKS
from calibrant.formats.documents.document import Document
from calibrant.formats.exchange.exchange_format import (
    ExchangeFormat,
    ReadOptions,
    WriteOptions,
    read_cameras,
)
from calibrant.formats.exchange.places import IMU, imu_frame, places_in, world_of
from calibrant.geometry import so3
from calibrant.reading.notes import note, note_unused

_FOCAL = ("fx", "fy", "cx", "cy")
_RADTAN8 = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
_TYPES: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "pinhole": ("pinhole", ()),
    "kb4": ("kannala_brandt", ("k1", "k2", "k3", "k4")),
    "ds": ("double_sphere", ("xi", "alpha")),
    "eucm": ("extended_unified", ("alpha", "beta")),
    "ucm": ("extended_unified", ("alpha",)),
    "pinhole-radtan8": ("rational", _RADTAN8),
}
_WRITTEN = {ours: (word, terms) for word, (ours, terms) in _TYPES.items() if word != "ucm"}
_NS = 1e9
_DEFAULTS: Mapping[str, Any] = {
    "calib_accel_bias": [0.0] * 9,
    "calib_gyro_bias": [0.0] * 12,
    "imu_update_rate": 200.0,
    "accel_noise_std": [0.016] * 3,
    "gyro_noise_std": [0.000282] * 3,
    "accel_bias_std": [0.001] * 3,
    "gyro_bias_std": [0.0001] * 3,
}
"""What basalt's Calibration() starts with."""
_KEYS = ("T_imu_cam", "intrinsics", "resolution")


def _matches(document: Document) -> bool:
    body = document.mapping.get("value0")
    return isinstance(body, Mapping) and {"T_imu_cam", "intrinsics"} <= set(body)


def _read(document: Document, options: ReadOptions) -> CalibrationResult:
    body, source = document.mapping.get("value0"), str(document.path)
    if not isinstance(body, Mapping):
        raise InputError("no value0 in it, under which basalt writes its calibration")
    poses, entries, sizes = (_listed(body, key) for key in _KEYS)
    if len(poses) != len(entries):
        raise InputError(f"{len(poses)} T_imu_cam and {len(entries)} intrinsics; expected one of each a camera")
    if len(sizes) not in (0, 1, len(entries)):
        raise InputError(f"{len(sizes)} resolutions for {len(entries)} cameras")
    names = [f"cam{i}" for i in range(len(entries))]
    cameras, unused = {}, [str(key) for key in body if key not in (*_KEYS, "cam_time_offset_ns")]
    for i, (name, entry) in enumerate(zip(names, entries)):
        pair = sizes[i if len(sizes) > 1 else 0] if sizes else None
        cameras[name], left = _camera(entry, pair, options.image_size, f"{source}: {name}", options.answers)
        unused += [f"{name}.{key}" for key in left]
    places = tuple(as_transform(IMU, name, _pose(pose, f"T_imu_cam of {name}")) for name, pose in zip(names, poses))
    note_unused(source, unused)
    figures = {}
    if body.get("cam_time_offset_ns"):
        shift = single(body, "cam_time_offset_ns") / _NS
        figures = {f"{SHIFT}{name}": Measured(shift, unit="s") for name in names}
    return read_cameras(cameras, transforms=places, figures=figures)


def _listed(body: Mapping[str, Any], key: str) -> list[Any]:
    found = body.get(key, [])
    if not isinstance(found, list):
        raise InputError(f"{key} is {str(found)[:60]!r}, expected a list, one entry a camera")
    return found


def _pose(pose: Any, what: str) -> np.ndarray:
    if not isinstance(pose, Mapping):
        raise InputError(f"{what} is {str(pose)[:60]!r}, expected px py pz qx qy qz qw")
    q, t = ([single(pose, key) for key in keys] for keys in (("qx", "qy", "qz", "qw"), ("px", "py", "pz")))
    return from_quaternion(q, t, what)


def _camera(
    entry: Any, pair: Any, size: Size | None, source: str, answers: Mapping[str, str]
) -> tuple[Camera, list[str]]:
    """The camera, and which of its keys were not used."""
    word = str(entry.get("camera_type")) if isinstance(entry, Mapping) else ""
    terms = entry.get("intrinsics") if isinstance(entry, Mapping) else None
    if not isinstance(terms, Mapping) or (word not in _TYPES and word != "fov"):
        known = ", ".join((*_TYPES, "fov"))
        raise InputError(f"{source}: camera_type is {word[:40]!r} with intrinsics by name expected; types: {known}")
    found = None
    if pair is not None:
        numbers = finite(pair, f"{source}: resolution")
        if numbers.size != 2:
            raise InputError(f"{source}: resolution holds {numbers.size} numbers, expected width and height")
        found = whole_size(*numbers)
    ours, names = _TYPES.get(word, ("", ("w",)))
    values = {name: single(terms, name) for name in (*_FOCAL, *names)}
    left = [str(key) for key in terms if key not in values]
    if word != "fov":
        return placed_camera(ours, values, found, size), left
    if found is None and size is None:
        raise InputError(f"{source}: no resolution; say --image-size")
    return fov_camera(values, values["w"], size=found or size or (0, 0), source=source, answers=answers), left


def _write(result: CalibrationResult, options: WriteOptions) -> bytes:
    imu = imu_frame(result, options.answers.get("imu"))
    places = places_in(result, imu or world_of(result), tuple(result.cameras))
    poses, entries = [], []
    for name, camera in result.cameras.items():
        T = places[name]
        w, x, y, z = so3.quaternion_wxyz(T[:3, :3])
        values = (*T[:3, 3], x, y, z, w)
        poses.append({k: float(v) for k, v in zip(("px", "py", "pz", "qx", "qy", "qz", "qw"), values)})
        word, terms = _WRITTEN[camera.model.name]
        intrinsics = {key: camera.parameters[key] for key in (*_FOCAL, *terms)}
        if word == "pinhole-radtan8":
            limit = float(camera.model.field_limit(camera.values))
            intrinsics["rpmax"] = limit if np.isfinite(limit) else 0.0
        entries.append({"camera_type": word, "intrinsics": intrinsics})
    shifts = {m.value for name, m in result.figures.items() if name.startswith(SHIFT)}
    if len(shifts) > 1:
        raise InputError(f"basalt has one time shift for all cameras, there are {len(shifts)} different ones")
    note(
        "basalt's file also holds the IMU's noise, biases and rate, which are not known here: written are its defaults"
    )
    body = {
        "T_imu_cam": poses,
        "intrinsics": entries,
        "resolution": [list(camera.image_size) for camera in result.cameras.values()],
        **_DEFAULTS,
        "cam_time_offset_ns": round(_NS * next(iter(shifts), 0.0)),
        "vignette": [],
    }
    return (json.dumps({"value0": body}, indent=4) + "\n").encode()


FORMAT = ExchangeFormat(
    name="basalt",
    title="basalt calibration (JSON)",
    suffix=".json",
    matches=_matches,
    read=_read,
    write=_write,
    models=tuple(_WRITTEN),
    asks=ASKS | {"imu": "the frame that is the IMU, where its name does not begin with imu"},
)
