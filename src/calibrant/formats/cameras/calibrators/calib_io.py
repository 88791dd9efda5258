"""calib.io's Camera Calibrator (libCalib): JSON with a list of cameras, each a model and a transform.

    fx = f, fy = f ar;   rotation rx ry rz (a rotation vector, rad), translation x y z

    polymorphic_name            here                             terms
    CameraModelOpenCV           pinhole, brown, … tilted         k1 to k6, p1 p2, s1 to s4, tauX tauY
    CameraModelOpenCVFisheye    kannala_brandt                   k1 to k4
    CameraModelMatlab           brown, or with skew              k1 k2 k3 p1 p2 skew
    CameraModelEnhancedUnified  extended_unified                 alpha beta

Pixels count from the middle of the first one: its script for MATLAB adds 1 to cx and cy, that for OpenCV nothing. Of
the transforms calib.io publishes the script that hands them to OpenCV as rvecs and tvecs, so X_cam = R X_rig + t is
read, and said; who has them the other way says --answer direction=camera-to-world. The unit is that of the target,
which the file does not say. Source: calib.io's readCalibParameters (C++, Python, MATLAB).
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera, camera_model
from calibrant.cameras.plane_distortion import TERMS
from calibrant.data import CalibrationResult, as_transform
from calibrant.errors import InputError
from calibrant.formats.cameras.calibrators.rigid import from_vector
from calibrant.formats.cameras.camera_format import Size, placed_camera, single, smallest_model, whole_size
from calibrant.formats.documents.document import Document
from calibrant.formats.exchange.exchange_format import (
    ExchangeFormat,
    ReadOptions,
    WriteOptions,
    answer,
    read_cameras,
)
from calibrant.formats.exchange.places import places_in, world_of
from calibrant.geometry import se3, so3
from calibrant.reading.notes import note, note_unused

RIG = "rig"
_DIRECTIONS = ("world-to-camera", "camera-to-world")
_PREFIX = "libCalib::CameraModel"
_PINHOLE = {name: name for name in TERMS[:-2]} | {"tauX": TERMS[-2], "tauY": TERMS[-1]}
"""Its names of OpenCV's terms, and ours."""
_TERMS = {
    "OpenCV": _PINHOLE,
    "Matlab": {name: name for name in ("k1", "k2", "k3", "p1", "p2", "skew")},
    "OpenCVFisheye": {name: name for name in ("k1", "k2", "k3", "k4")},
    "EnhancedUnified": {name: name for name in ("alpha", "beta")},
}
_OWN = {"OpenCVFisheye": "kannala_brandt", "EnhancedUnified": "extended_unified"}
_FOCAL = ("f", "ar", "cx", "cy")
_FREE = 0


def _body(data: Mapping[str, Any]) -> Mapping[str, Any]:
    found = data.get("Calibration", data.get("calibration"))
    return found if isinstance(found, Mapping) else {}


def _matches(document: Document) -> bool:
    cameras = _body(document.mapping).get("cameras")
    return isinstance(cameras, list) and bool(cameras) and isinstance(cameras[0], Mapping) and "model" in cameras[0]


def _read(document: Document, options: ReadOptions) -> CalibrationResult:
    body, source = _body(document.mapping), str(document.path)
    listed = body.get("cameras")
    if not isinstance(listed, list) or not listed:
        raise InputError("no Calibration.cameras in it")
    direction = answer(options.answers, "direction", _DIRECTIONS)
    cameras: dict[str, Camera] = {}
    poses: dict[str, Array] = {}
    for i, entry in enumerate(listed):
        name = str(entry.get("name", f"camera{i}")) if isinstance(entry, Mapping) else f"camera{i}"
        if not isinstance(entry, Mapping) or name in cameras:
            raise InputError(f"{name} is {str(entry)[:60]!r}, expected a model and a transform under a name of its own")
        cameras[name] = _camera(entry.get("model"), options.image_size, f"{source}: {name}")
        if entry.get("transform") is not None:
            poses[name] = _pose(entry["transform"], name)
    metre = _metre(poses, options)
    places = []
    for name, T in poses.items():
        T[:3, 3] *= metre
        if len(poses) > 1 or not np.allclose(T, np.eye(4)):
            places.append(as_transform(RIG, name, T if direction == _DIRECTIONS[1] else se3.inverse(T)))
    if places and direction is None:
        note(f"{source}: transforms are read as X_camera = R X_rig + t, as calib.io's scripts hand them to OpenCV")
    note_unused(source, (str(key) for key in body if key != "cameras"))
    return read_cameras(cameras, transforms=tuple(places))


def _metre(poses: Mapping[str, Array], options: ReadOptions) -> float:
    if options.unit_m is None and options.places and any(T[:3, 3].any() for T in poses.values()):
        raise InputError("calib.io's files do not say their unit, which is that of the target: say --unit m or mm")
    return options.unit_m or 1.0


def _pose(value: Any, name: str) -> Array:
    parts = [value.get(key) if isinstance(value, Mapping) else None for key in ("rotation", "translation")]
    if not all(isinstance(part, Mapping) for part in parts):
        raise InputError(f"the transform of {name} is {str(value)[:60]!r}, expected rotation and translation")
    r, t = ([single(part, key) for key in keys] for part, keys in zip(parts, (("rx", "ry", "rz"), "xyz")))  # type: ignore[arg-type]
    return from_vector(r, t, name)


def _camera(model: Any, size: Size | None, source: str) -> Camera:
    try:
        word = str(model["polymorphic_name"]).removeprefix(_PREFIX)
        data = model["ptr_wrapper"]["data"]
        listed = {str(key): single(entry, "val") for key, entry in data["parameters"].items()}
    except (KeyError, TypeError, AttributeError) as error:
        raise InputError(
            f"{source}: expected model with polymorphic_name and ptr_wrapper.data.parameters, each with val ({error})"
        ) from error
    if word not in _TERMS:
        known = ", ".join(_PREFIX + name for name in _TERMS)
        raise InputError(f"{source}: the model is {word[:40]!r}, expected one of {known}")
    names = _TERMS[word]
    f, ar, cx, cy = (single(listed, key) if key != "ar" or key in listed else 1.0 for key in _FOCAL)
    strange = [k for k, v in listed.items() if k not in (*_FOCAL, *names) and v]
    if strange:
        raise InputError(f"{source}: {', '.join(strange)} is no parameter of {word} that is known")
    plain = {"fx": f, "fy": f * ar, "cx": cx, "cy": cy}
    terms = {names[key]: value for key, value in listed.items() if key in names}
    ours = _OWN.get(word) or smallest_model([k for k, v in terms.items() if v and k != "skew"], terms.get("skew", 0.0))
    kept = {key: value for key, value in terms.items() if key in camera_model(ours).parameter_names}
    return placed_camera(ours, plain | kept, _size(data, source), size)


def _size(data: Mapping[str, Any], source: str) -> Size | None:
    """imageSize, wherever below CameraModelBase the version has it."""
    base: Any = data.get("CameraModelCRT", data)
    base = base.get("CameraModelBase", base) if isinstance(base, Mapping) else {}
    inner = base.get("imageSize", base) if isinstance(base, Mapping) else {}
    for where, keys in ((inner, ("width", "height")), (base, ("imageWidth", "imageHeight"))):
        if isinstance(where, Mapping) and all(key in where for key in keys):
            return whole_size(*(where[key] for key in keys))
    return None


def _write(result: CalibrationResult, options: WriteOptions) -> bytes:
    if options.unit_m is None and len(result.cameras) > 1:
        note("calib.io's files do not say their unit: written in metres; --unit says another")
    world = world_of(result, options.answers.get("world"))
    inverse = answer(options.answers, "direction", _DIRECTIONS) == _DIRECTIONS[1]
    cameras = []
    for i, (name, T) in enumerate(places_in(result, world, tuple(result.cameras)).items()):
        pose = T if inverse else se3.inverse(T)
        r, t = so3.log(pose[:3, :3]) + 0.0, pose[:3, 3] / (options.unit_m or 1.0) + 0.0
        transform = {
            "rotation": dict(zip(("rx", "ry", "rz"), map(float, r))),
            "translation": dict(zip("xyz", map(float, t))),
        }
        cameras.append({"name": name, "model": _model(result.cameras[name], first=i == 0), "transform": transform})
    return (json.dumps({"Calibration": {"cameras": cameras}}, indent=4) + "\n").encode()


def _model(camera: Camera, *, first: bool) -> dict[str, Any]:
    word = {ours: name for name, ours in _OWN.items()}.get(camera.model.name, "OpenCV")
    p = camera.parameters
    values = {"f": p["fx"], "ar": p["fy"] / p["fx"], "cx": p["cx"], "cy": p["cy"]}
    values |= {name: p.get(ours, 0.0) for name, ours in _TERMS[word].items()}
    width, height = camera.image_size
    return {
        # cereal's mark of a type that is named here for the first time, and of one that was.
        "polymorphic_id": 2147483649 if first else 1,
        "polymorphic_name": _PREFIX + word,
        "ptr_wrapper": {
            "valid": 1,
            "data": {
                "CameraModelCRT": {"CameraModelBase": {"imageSize": {"width": width, "height": height}}},
                "parameters": {name: {"val": value, "state": _FREE} for name, value in values.items()},
            },
        },
    }


FORMAT = ExchangeFormat(
    name="calib-io",
    title="calib.io Camera Calibrator (JSON)",
    suffix=".json",
    matches=_matches,
    read=_read,
    write=_write,
    models=("pinhole", "brown", "rational", "thin_prism", "tilted", "kannala_brandt", "extended_unified"),
    asks={
        "direction": f"which way the transforms go: {' or '.join(_DIRECTIONS)}",
        "world": "the frame that all cameras are placed in",
    },
)
