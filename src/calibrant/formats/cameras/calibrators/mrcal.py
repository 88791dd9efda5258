"""mrcal's .cameramodel: one camera and where it is, a dictionary in Python's words with comments.

    X_cam = R(r) X_ref + t,   (r, t) under 'extrinsics', which its comments call rt_cam_ref or rt_fromref

    lens_model                         here             intrinsics
    LENSMODEL_PINHOLE                  pinhole          fx fy cx cy
    LENSMODEL_STEREOGRAPHIC            unified, xi = 1  fx fy cx cy (q = f 2 tan(theta / 2), so fx here is 2 fx)
    LENSMODEL_OPENCV4, 5, 8, 12        brown, rational, thin_prism   fx fy cx cy and OpenCV's terms in its order
    LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx=_Ny=_fov_x_deg=  splined   fx fy cx cy, control points (x, y) row by row

The splined surface is ours: cubic B-splines on q = 2 tan(theta / 2), spacing 4 tan(fov / 4) / (Nx - 3). Beyond its
knots mrcal goes on, and this camera sees nothing. CAHVOR and CAHVORE, LATLON and LONLAT are refused by name. Pixels are
counted from the middle of the first one; lengths are those of the calibration, metres by its manual. Source: mrcal's
manual, "Camera model representation", "Lens models", "Splined stereographic lens model"; mrcal.cameramodel.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera, camera_model
from calibrant.cameras.splined import FAMILY, Splined
from calibrant.data import CalibrationResult, as_transform
from calibrant.errors import InputError
from calibrant.formats.cameras.calibrators.rigid import finite, from_vector, quoted
from calibrant.formats.cameras.camera_format import Size, placed_camera, size_or_refuse, whole_size
from calibrant.formats.documents.document import Document
from calibrant.formats.documents.number_text import text_of
from calibrant.formats.exchange.exchange_format import (
    ExchangeFormat,
    ReadOptions,
    WriteOptions,
    one_camera,
    read_cameras,
)
from calibrant.formats.exchange.places import places_in, world_of
from calibrant.geometry import se3, so3
from calibrant.reading.notes import note_unused

REFERENCE = "reference"
_FOCAL = ("fx", "fy", "cx", "cy")
_CV = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4")
_OPENCV: Mapping[str, tuple[str, int]] = {
    "LENSMODEL_PINHOLE": ("pinhole", 0),
    "LENSMODEL_OPENCV4": ("brown", 4),
    "LENSMODEL_OPENCV5": ("brown", 5),
    "LENSMODEL_OPENCV8": ("rational", 8),
    "LENSMODEL_OPENCV12": ("thin_prism", 12),
}
_STEREOGRAPHIC = "LENSMODEL_STEREOGRAPHIC"
_SPLINED = re.compile(r"^LENSMODEL_SPLINED_STEREOGRAPHIC_order=(\d+)_Nx=(\d+)_Ny=(\d+)_fov_x_deg=(\d+)$")
_WRITTEN = {"pinhole": "PINHOLE", "brown": "OPENCV5", "rational": "OPENCV8", "thin_prism": "OPENCV12"}
_EXTRINSICS = ("extrinsics", "rt_cam_ref", "rt_fromref", "extrinsics_rt_fromref")
_LENS = ("lensmodel", "lens_model", "distortion_model")
"""The key's names over the years."""
_MOST = 2_000_000
"""Characters, the packed inputs of the optimisation aside: a spline of 100x100 points has a fifth of it."""
_HEAD = 65_536
"""Characters within which the lens stands, after the comments."""
_PACKED = re.compile(r"b'[^'\\\n]*'")
"""mrcal's own optimization_inputs: base 85 of megabytes, which say nothing of the camera beyond it."""
_SHOWN = 60


def _matches(document: Document) -> bool:
    text = document.text or ""
    start = re.sub(r"^\s*#[^\n]*$", "", text[:4096], flags=re.MULTILINE).lstrip()
    return start.startswith("{") and re.search(r"['\"](?:LENSMODEL|DISTORTION)_[A-Z]", text[:_HEAD]) is not None


def _read(document: Document, options: ReadOptions) -> CalibrationResult:
    data, source = _parsed(document), str(document.path)
    key = next((key for key in _LENS if key in data), None)
    if key is None:
        raise InputError("no lensmodel in it")
    if "imagersize" in data:
        pair = finite(data["imagersize"], "imagersize")
        if pair.size != 2:
            raise InputError(f"imagersize holds {pair.size} numbers, expected width and height")
        found = whole_size(*pair)
    else:
        found = None
    lens = str(data[key]).replace("DISTORTION_", "LENSMODEL_").replace("LENSMODEL_NONE", "LENSMODEL_PINHOLE")
    camera = _camera(lens, finite(data.get("intrinsics"), "intrinsics"), found, options.image_size)
    name = document.path.name.partition(".")[0] or "camera"
    poses = [k for k in _EXTRINSICS if data.get(k) is not None]
    unit = options.unit_m or 1.0
    T = [_pose(data[k], k, unit) for k in poses]
    if len(T) > 1 and not np.allclose(T[0], T[1], rtol=0, atol=1e-9):
        raise InputError(f"{poses[0]} and {poses[1]} say two places; keep one of them")
    places = tuple(as_transform(REFERENCE, name, se3.inverse(pose)) for pose in T[:1])
    used = {key, "intrinsics", "imagersize", *_EXTRINSICS}
    note_unused(source, (str(k) for k in data if k not in used))
    return read_cameras({name: camera}, transforms=places)


def _parsed(document: Document) -> Mapping[str, Any]:
    """The dictionary. Raises: InputError for text that is none, or is larger than any model's."""
    text = _PACKED.sub("b''", document.text or "")
    if len(text) > _MOST:
        raise InputError(f"{len(text) / 1e6:.0f} MB of text, expected {_MOST / 1e6:.0f} MB at most")
    try:
        data = ast.literal_eval(text.strip())
    except (ValueError, SyntaxError, MemoryError, RecursionError, TypeError) as error:
        raise InputError(f"not a dictionary in Python's words ({str(error)[:_SHOWN]})") from error
    if not isinstance(data, Mapping):
        raise InputError(f"{str(data)[:_SHOWN]!r}, expected a dictionary")
    return data


def _pose(value: Any, key: str, unit_m: float) -> Array:
    rt = finite(value, key)
    if rt.size != 6:
        raise InputError(f"{key} holds {rt.size} numbers, expected 6: rotation vector and translation")
    return from_vector(rt[:3], rt[3:], key, unit_m=unit_m)


def _camera(lens: str, values: Array, found: Size | None, size: Size | None) -> Camera:
    if lens == _STEREOGRAPHIC:
        four = _named(_FOCAL, values, lens)
        doubled = {"fx": 2 * four["fx"], "fy": 2 * four["fy"]}
        return placed_camera("unified", four | doubled | {"xi": 1.0}, found, size)
    splined = _SPLINED.match(lens)
    if splined:
        order, nx, ny, fov = (int(part) for part in splined.groups())
        return _splined(order, (nx, ny), fov, values, size_or_refuse(found, size))
    if lens not in _OPENCV:
        known = ", ".join((*_OPENCV, _STEREOGRAPHIC, "LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_…"))
        raise InputError(
            f"the lens is {lens[:_SHOWN]}, which no model here can say; read are {known}. "
            "mrcal-convert-lensmodel makes one of these of it"
        )
    model, count = _OPENCV[lens]
    return placed_camera(model, _named((*_FOCAL, *_CV[:count]), values, lens), found, size)


def _named(names: tuple[str, ...], values: Array, lens: str) -> dict[str, float]:
    if len(values) != len(names):
        raise InputError(f"intrinsics holds {len(values)} numbers, a {lens} has {len(names)}: {' '.join(names)}")
    return {name: float(value) for name, value in zip(names, values)}


def _splined(order: int, knots: tuple[int, int], fov: int, values: Array, size: Size) -> Camera:
    nx, ny = knots
    if order != 3:
        raise InputError(f"splines of order {order}; this program's surface is of order 3")
    model = camera_model(f"splined:{nx}x{ny}:{fov}deg")
    if len(values) != 4 + 2 * nx * ny:
        raise InputError(f"intrinsics holds {len(values)} numbers, {nx}x{ny} control points have {4 + 2 * nx * ny}")
    points = values[4:].reshape(-1, 2)
    return Camera(model, size, np.concatenate([values[:4], points[:, 0], points[:, 1]]))


def _write(result: CalibrationResult, options: WriteOptions) -> bytes:
    name, camera = one_camera(result)
    lens, values = _words(camera)
    world = world_of(result, options.answers.get("world"))
    pose = se3.inverse(places_in(result, world, (name,))[name])
    rt = np.concatenate([so3.log(pose[:3, :3]), pose[:3, 3] / (options.unit_m or 1.0)]) + 0.0
    width, height = camera.image_size
    lines = [
        "{",
        f"    'lensmodel':  '{lens}',",
        "",
        f"    # fx fy cx cy, then the lens: {quoted(name)}",
        f"    'intrinsics': [ {_numbers(values)}],",
        "",
        f"    # rt_cam_ref, from {quoted(world)} to {quoted(name)}",
        f"    'extrinsics': [ {_numbers(rt)}],",
        "",
        f"    'imagersize': [ {width}, {height},]",
        "}",
    ]
    return ("\n".join(lines) + "\n").encode()


def _words(camera: Camera) -> tuple[str, Array]:
    """mrcal's name of the lens, and its numbers."""
    kind = camera.model
    if isinstance(kind, Splined):
        if kind.fov_deg != round(kind.fov_deg):
            raise InputError(f"mrcal's splines span whole degrees, this one {kind.fov_deg:g}")
        points = camera.values[4:].reshape(2, -1).T.ravel()
        lens = f"SPLINED_STEREOGRAPHIC_order=3_Nx={kind.columns}_Ny={kind.rows_count}_fov_x_deg={kind.fov_deg:.0f}"
        return f"LENSMODEL_{lens}", np.concatenate([camera.values[:4], points])
    return f"LENSMODEL_{_WRITTEN[kind.name]}", camera.values


def _numbers(values: Array) -> str:
    return "".join(f"{text}, " for text in text_of(values))


FORMAT = ExchangeFormat(
    name="mrcal",
    title="mrcal .cameramodel",
    suffix=".cameramodel",
    matches=_matches,
    read=_read,
    write=_write,
    models=(*_WRITTEN, FAMILY),
    asks={"world": "the frame that is mrcal's reference"},
)
