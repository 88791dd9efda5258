"""Azure Kinect's and Femto's calibration: the JSON that the device keeps (k4a_device_get_raw_calibration).

    ModelParameters: cx cy fx fy k1 … k6 codx cody p2 p1 [metric radius], the first four in parts of the sensor's size
    u = fx W x' + cx W - 0.5,  X_camera = Rt.Rotation X_depth + Rt.Translation, metres

OpenCV's rational model in the kind BrownConrady; Rational6KT takes p1 x y and p2 x y once, not twice. With the size of
a mode (--image-size) its part of the sensor is taken: cut and scaled as the SDK does. Sources: Azure Kinect Sensor
SDK's src/calibration/calibration.c, src/transformation/intrinsic_transformation.c and mode_specific_calibration.c.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, TransformEstimate, as_transform
from calibrant.errors import InputError
from calibrant.formats.cameras.camera_format import Size, numbers, placed_camera, whole_size
from calibrant.formats.cameras.foreign_lens import ASKS, nearest_by_projection
from calibrant.formats.documents.document import Document
from calibrant.formats.exchange.exchange_format import ExchangeFormat, ReadOptions, read_cameras
from calibrant.formats.exchange.rotation_numbers import ROUNDED
from calibrant.geometry import se3
from calibrant.reading.notes import note_unused

_WRAPPER = "CalibrationInformation"
_PURPOSES = {"Depth": "depth", "PhotoVideo": "color"}
_TERMS = ("k1", "k2", "k3", "k4", "k5", "k6", "codx", "cody", "p2", "p1")
_KINDS = ("BrownConrady", "Rational6KT")
_MODES: Mapping[tuple[str, Size], tuple[Size, tuple[int, int]]] = {
    ("depth", (640, 576)): ((1024, 1024), (192, 180)),
    ("depth", (320, 288)): ((512, 512), (96, 90)),
    ("depth", (1024, 1024)): ((1024, 1024), (0, 0)),
    ("depth", (512, 512)): ((512, 512), (0, 0)),
    **{("color", (16 * n, 9 * n)): ((16 * n, 12 * n), (0, 3 * n // 2)) for n in (80, 120, 160, 240)},
    **{("color", (4 * n, 3 * n)): ((4 * n, 3 * n), (0, 0)) for n in (512, 1024)},
}
"""Of a camera and the size of its pictures: to which size the sensor is scaled, and what is cut off left and above."""


def _cameras(data: Mapping[str, Any]) -> list[Any]:
    inner = data.get(_WRAPPER, data)
    found = inner.get("Cameras") if isinstance(inner, Mapping) else None
    return found if isinstance(found, list) else []


def _matches(document: Document) -> bool:
    found = _cameras(document.mapping)
    return bool(found) and isinstance(found[0], Mapping) and isinstance(found[0].get("Intrinsics"), Mapping)


def _read(document: Document, options: ReadOptions) -> CalibrationResult:
    source = str(document.path)
    named: dict[str, Mapping[str, Any]] = {}
    for i, item in enumerate(_cameras(document.mapping)):
        name = _name(item, i)
        if name in named:
            raise InputError(f"two cameras are called {name}")
        named[name] = item
    kept = named if options.camera not in named else {str(options.camera): named[str(options.camera)]}
    sizes = {name: _mode(name, options.image_size, alone=len(kept) == 1) for name in kept}
    if options.image_size is not None and not any(sizes.values()):
        raise InputError(f"no camera has pictures of {options.image_size[0]}x{options.image_size[1]} px; {_listed()}")
    cameras = {name: _camera(name, item, sizes[name], options) for name, item in kept.items()}
    inner = document.mapping.get(_WRAPPER, document.mapping)
    unused = [str(key) for key in inner if key != "Cameras"]
    unused += [f"{name}.MetricRadius" for name, item in kept.items() if item.get("MetricRadius")]
    note_unused(source, unused)
    if not options.places or len(kept) < 2:
        return read_cameras(cameras)
    return read_cameras(cameras, transforms=_places(named))


def _listed() -> str:
    return "its modes: " + ", ".join(f"{name} {w}x{h}" for name, (w, h) in _MODES)


def _name(item: Any, i: int) -> str:
    if not isinstance(item, Mapping) or not isinstance(item.get("Intrinsics"), Mapping):
        raise InputError(f"camera {i} has no Intrinsics")
    purpose = str(item.get("Purpose", "")).rpartition("Purpose")[2]
    place = str(item.get("Location", "")).rpartition("Location")[2]
    return _PURPOSES.get(purpose) or place or f"camera {i}"


def _mode(name: str, size: Size | None, *, alone: bool) -> Size | None:
    """The size asked for, where this camera has pictures of it."""
    if size is None:
        return None
    if (name, size) not in _MODES and alone and name in _PURPOSES.values():
        raise InputError(f"{name} has no pictures of {size[0]}x{size[1]} px; {_listed()}")
    return size if (name, size) in _MODES else None


def _camera(name: str, item: Mapping[str, Any], size: Size | None, options: ReadOptions) -> Camera:
    """Raises: InputError for a model that is not known, a count that does not fit."""
    lens = item["Intrinsics"]
    kind = str(lens.get("ModelType", "")).rpartition("LensDistortionModel")[2]
    if kind not in _KINDS:
        raise InputError(f"{name}: ModelType is {str(lens.get('ModelType'))[:60]!r}, expected {' or '.join(_KINDS)}")
    values = numbers(lens.get("ModelParameters", []), f"{name}: ModelParameters")
    if len(values) not in (14, 15) or not np.all(np.isfinite(values)):
        raise InputError(f"{name}: ModelParameters holds {len(values)} numbers, expected 14 or 15 finite ones")
    sensor = whole_size(item.get("SensorWidth"), item.get("SensorHeight"))
    scaled, cut = (sensor, (0, 0)) if size is None else _MODES[name, size]
    cx, cy, fx, fy = (float(v) for v in values[:4])
    plain = {
        "fx": fx * scaled[0],
        "fy": fy * scaled[1],
        "cx": cx * scaled[0] - cut[0] - 0.5,
        "cy": cy * scaled[1] - cut[1] - 0.5,
    }
    terms = {term: float(v) for term, v in zip(_TERMS, values[4:14])}
    moved = terms.pop("codx"), terms.pop("cody")
    once = kind == "Rational6KT" and (terms["p1"] != 0 or terms["p2"] != 0)
    if not once and not any(moved):
        return placed_camera("rational", plain | terms, size or sensor, None)
    what = f"{name}: {kind} with p1, p2" + (", codx, cody" if any(moved) else "")

    def project(rays: Array) -> Array:
        x, y = (rays[:, i] / rays[:, 2] - moved[i] for i in (0, 1))
        r2 = x * x + y * y
        top = 1 + r2 * (terms["k1"] + r2 * (terms["k2"] + r2 * terms["k3"]))
        g = top / (1 + r2 * (terms["k4"] + r2 * (terms["k5"] + r2 * terms["k6"])))
        twice = 1 if kind == "Rational6KT" else 2
        u = x * g + (r2 + 2 * x * x) * terms["p2"] + twice * x * y * terms["p1"] + moved[0]
        v = y * g + (r2 + 2 * y * y) * terms["p1"] + twice * x * y * terms["p2"] + moved[1]
        return np.stack([plain["fx"] * u + plain["cx"], plain["fy"] * v + plain["cy"]], axis=-1)

    return nearest_by_projection(project, ("rational",), plain | terms, size or sensor, options.answers, what=what)


def _places(named: Mapping[str, Mapping[str, Any]]) -> tuple[TransformEstimate, ...]:
    """T_depth_camera of each other camera, depth being where Rt is none."""
    T = {}
    for name, item in named.items():
        at = item.get("Rt")
        if not isinstance(at, Mapping):
            raise InputError(f"{name} has no Rt")
        R, t = (numbers(at.get(key, []), f"{name}: Rt.{key}") for key in ("Rotation", "Translation"))
        if R.size != 9 or t.size != 3:
            raise InputError(f"{name}: Rt holds {R.size} and {t.size} numbers, expected a rotation of 9, 3 metres")
        T[name] = se3.check(se3.make(R.reshape(3, 3), t), name=f"{name}: Rt", tolerance=ROUNDED)
    first = next((name for name in T if np.allclose(T[name], np.eye(4))), next(iter(T)))
    return tuple(as_transform(first, name, T[first] @ se3.inverse(T[name])) for name in T if name != first)


FORMAT = ExchangeFormat(
    name="azure-kinect",
    title="Azure Kinect or Femto calibration (JSON)",
    suffix=".json",
    matches=_matches,
    read=_read,
    asks=ASKS,
)
