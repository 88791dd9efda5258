"""NeRF's transforms.json: one camera or one a frame, frames with T_world_camera in OpenGL's axes (y up, z behind).

fl_x, fl_y, cx, cy in pixels from the image's corner, k1 … as OpenCV has them; or camera_angle_x, the field of view, and
the principal point in the middle. Sources: instant-ngp's docs/nerf_dataset_tips.md and scripts/colmap2nerf.py,
nerfstudio's "Data conventions", the synthetic scenes of the first paper. Frames become views; a file without w and h
needs them said, and its lengths have no unit but the one that is said.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult
from calibrant.errors import InputError
from calibrant.formats.cameras.camera_format import Size, placed_camera, single, size_or_refuse, whole_size
from calibrant.formats.cameras.photogrammetry.pictures import FLIP, Picture, pictures_of, result_of, unit_of
from calibrant.formats.documents.document import Document
from calibrant.formats.exchange.exchange_format import ExchangeFormat, ReadOptions, WriteOptions
from calibrant.geometry import se3
from calibrant.reading.notes import note, note_unused

_CORNER = 0.5
_TERMS = ("k1", "k2", "k3", "k4", "p1", "p2")
_LENS = (
    *("fl_x", "fl_y", "cx", "cy", "w", "h", "camera_angle_x", "camera_angle_y", "camera_model", "is_fisheye"),
    *("fx", "fy", "width", "height"),
    *_TERMS,
)
_FISHEYE = ("OPENCV_FISHEYE", "FISHEYE", "SIMPLE_FISHEYE", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE")
_PERSPECTIVE = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "PERSPECTIVE", "FULL_OPENCV")
_USED = {*_LENS, "frames", "file_path", "transform_matrix"}
_ROUNDED = 1e-3
"""Matrices as float32 and six decimals leave them."""
_WRITTEN = {"pinhole": "PINHOLE", "brown": "OPENCV", "kannala_brandt": "OPENCV_FISHEYE"}


def _matches(document: Document) -> bool:
    frames = document.mapping.get("frames")
    return (
        isinstance(frames, list) and bool(frames) and isinstance(frames[0], Mapping) and "transform_matrix" in frames[0]
    )


def _read(document: Document, options: ReadOptions) -> CalibrationResult:
    data, source = document.mapping, str(document.path)
    frames = [_frame(frame, i) for i, frame in enumerate(data["frames"])]
    unused = [str(key) for key in data if key not in _USED]
    unused += dict.fromkeys(f"frames.{key}" for frame in frames for key in frame if key not in _USED)
    note_unused(source, unused)
    shared = {key: data[key] for key in _LENS if data.get(key) is not None}
    cameras: dict[str, Camera] = {}
    known: dict[str, str] = {}
    pictures: list[Picture] = []
    unit = unit_of(options, source) if options.places else 1.0
    places = _places(frames, unit, source) if options.places else None
    for i, frame in enumerate(frames):
        lens = shared | {key: frame[key] for key in _LENS if frame.get(key) is not None}
        key = json.dumps(lens, sort_keys=True, default=str)
        if key not in known:
            known[key] = f"camera_{len(known)}" if known else "camera"
            cameras[known[key]] = _camera(lens, options.image_size)
        if places is not None:
            pictures.append(Picture(str(frame.get("file_path", i)), known[key], places[i]))
    return result_of(cameras, pictures, options)


def _frame(frame: Any, i: int) -> Mapping[str, Any]:
    if not isinstance(frame, Mapping) or "transform_matrix" not in frame:
        raise InputError(f"frame {i} has no transform_matrix")
    return frame


def _places(frames: list[Mapping[str, Any]], unit: float, source: str) -> Array:
    """T_camera_world (n, 4, 4) of optical frames. Raises: InputError naming a frame without a pose."""
    out = []
    for i, frame in enumerate(frames):
        try:
            M = np.array(frame["transform_matrix"], dtype=np.float64)
        except (TypeError, ValueError):
            raise InputError(f"frame {i}: its transform_matrix is none of numbers") from None
        if M.shape == (3, 4):
            M = np.vstack([M, [0.0, 0.0, 0.0, 1.0]])
        if M.shape != (4, 4):
            raise InputError(f"frame {i}: its transform_matrix has shape {M.shape}, expected 4x4")
        out.append(M)
    T = se3.check(_homogeneous(np.array(out), source), name="transform_matrix", tolerance=_ROUNDED) @ FLIP
    T[:, :3, 3] *= unit
    return se3.inverse(T)


def _homogeneous(M: Array, source: str) -> Array:
    """Matrices (n, 4, 4) whose last number is 1: who scales a scene may have divided the whole matrix."""
    last = M[:, 3, 3]
    if np.all((last > 0) & np.isfinite(last)) and np.any(np.abs(last - 1) > _ROUNDED):
        note(f"{source}: the transform_matrix ends in {last[0]:g} where 1 belongs; each was divided by its last number")
        return M / last[:, None, None]
    return M


def _camera(lens: Mapping[str, Any], image_size: Size | None) -> Camera:
    """Raises: InputError: no focal length, no size, a model or terms that are none of ours."""
    size = _size(lens, image_size)
    fisheye = _is_fisheye(lens)
    f = _focal(lens, size, fisheye)
    middle = {name: (single(lens, name) if name in lens else n / 2) - _CORNER for name, n in zip(("cx", "cy"), size)}
    terms = {name: single(lens, name) for name in _TERMS if name in lens}
    given = {name: value for name, value in terms.items() if value != 0}
    strange = {"p1", "p2"} if fisheye else {"k4"}
    wrong = [f"{name} {given[name]:g}" for name in given if name in strange]
    if wrong:
        kind = "a fisheye has k1 to k4" if fisheye else "OPENCV has k1, k2, p1, p2 and k3"
        raise InputError(f"{', '.join(wrong)}: {kind}; is camera_model right?")
    kept = {name: value for name, value in terms.items() if name not in strange}
    model = "kannala_brandt" if fisheye else "brown" if given else "pinhole"
    return placed_camera(model, f | middle | (kept if model != "pinhole" else {}), size, None)


def _size(lens: Mapping[str, Any], image_size: Size | None) -> Size:
    """w, h of the file, else what was said. Raises: InputError."""
    for w, h in (("w", "h"), ("width", "height")):
        if w in lens and h in lens:
            return whole_size(lens[w], lens[h])
    return size_or_refuse(None, image_size)


def _is_fisheye(lens: Mapping[str, Any]) -> bool:
    model = str(lens.get("camera_model", "")).upper()
    if model and model not in (*_FISHEYE, *_PERSPECTIVE):
        raise InputError(f"camera_model is {model[:40]!r}; read are {', '.join((*_PERSPECTIVE, *_FISHEYE))}")
    if model in _PERSPECTIVE and lens.get("is_fisheye") is True and model != "OPENCV":
        raise InputError(f"camera_model is {model}, and is_fisheye is true; keep one")
    return model in _FISHEYE or lens.get("is_fisheye") is True


def _focal(lens: Mapping[str, Any], size: Size, fisheye: bool) -> dict[str, float]:
    """fx, fy, pixels. Raises: InputError where neither they nor the field of view stand there."""
    out: dict[str, float] = {}
    for axis, n in zip("xy", size):
        key = next((k for k in (f"fl_{axis}", f"f{axis}") if k in lens), None)
        if key is not None:
            out[f"f{axis}"] = single(lens, key)
        elif f"camera_angle_{axis}" in lens and not fisheye:
            angle = single(lens, f"camera_angle_{axis}")
            if not 0 < angle < math.pi:
                raise InputError(f"camera_angle_{axis} is {angle:g}, expected radians between 0 and pi")
            out[f"f{axis}"] = n / 2 / math.tan(angle / 2)
    if not out:
        raise InputError("no focal length: expected fl_x and fl_y, or camera_angle_x")
    one = next(iter(out.values()))
    return {"fx": one, "fy": one} | out


def _write(result: CalibrationResult, options: WriteOptions) -> bytes:
    pictures = pictures_of(result)
    if not pictures:
        raise InputError("no picture with a known place: transforms.json holds where pictures were taken")
    lens = {name: _lens(camera) for name, camera in result.cameras.items()}
    used = dict.fromkeys(p.camera for p in pictures)
    shared = lens[next(iter(used))] if len(used) == 1 else {}
    frames = []
    for p in pictures:
        T = se3.inverse(p.T_camera_world) @ FLIP
        T[:3, 3] /= options.unit_m or 1.0
        own = {} if shared else lens[p.camera]
        frames.append({"file_path": p.name, **own, "transform_matrix": (T + 0.0).tolist()})
    return (json.dumps({**shared, "frames": frames}, indent=1) + "\n").encode()


def _lens(camera: Camera) -> dict[str, Any]:
    p = camera.parameters
    terms = {name: p[name] for name in _TERMS if name in p}
    width, height = camera.image_size
    return {
        "camera_model": _WRITTEN[camera.model.name],
        "fl_x": p["fx"],
        "fl_y": p["fy"],
        "cx": p["cx"] + _CORNER,
        "cy": p["cy"] + _CORNER,
        "w": width,
        "h": height,
    } | terms


FORMAT = ExchangeFormat(
    name="nerf",
    title="NeRF transforms.json (instant-ngp, nerfstudio)",
    suffix=".json",
    matches=_matches,
    read=_read,
    write=_write,
    models=tuple(_WRITTEN),
)
