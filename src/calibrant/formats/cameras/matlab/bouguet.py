"""Calib_Results.mat and Calib_Results_stereo.mat of Bouguet's Camera Calibration Toolbox for MATLAB, and its scripts.

    K = [fc1 alpha_c fc1 cc1; 0 fc2 cc2; 0 0 1], kc = k1 k2 p1 p2 k3
    X_c = exp(omc_i) X + Tc_i,  X_right = exp(om) X_left + T

Pixels are counted from 0, the middle of the first one. Its errors (fc_error …) are three standard deviations. Lengths
are in the unit of the squares (dX), for which its prompt asks in millimetres. Source: the toolbox's "Description of the
calibration parameters".
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, as_transform
from calibrant.data.results import ViewResult
from calibrant.errors import InputError
from calibrant.formats.cameras.camera_format import Size, placed_camera, smallest_model, whole_size
from calibrant.formats.cameras.matlab.mat_file import MARK, variables, written
from calibrant.formats.documents.document import Document
from calibrant.formats.exchange.exchange_format import ExchangeFormat, ReadOptions, WriteOptions, read_cameras
from calibrant.formats.exchange.places import places_in
from calibrant.geometry import se3, so3
from calibrant.reading.notes import note, note_unused

_SIDES = ("left", "right")
_TERMS = ("k1", "k2", "p1", "p2", "k3")
_SIGMAS = 3.0
_ASSIGNED = re.compile(r"^\s*([A-Za-z]\w*)\s*=\s*(\[[^\]]*\]|[-+.\deE]+)\s*;", re.MULTILINE)
_MOST_VIEWS = 10_000
_USED = re.compile(
    r"^(?:(?:fc|cc|kc|alpha_c|KK)(?:_error)?(?:_(?:left|right))?(?:_error)?|nx|ny|om|T|R|omc_(?:left_)?\d+|Tc_(?:left_)?\d+"
    r"|Rc_\d+|inv_KK|H_\d+)$"
)
"""What is read, and what follows from it."""


def _matches(document: Document) -> bool:
    if document.head.startswith(MARK):
        return _holds(variables(document.content))
    text = document.text
    return text is not None and "cc = [" in text and "kc = [" in text and _holds(_script(text))


def _holds(values: Mapping[str, Any]) -> bool:
    return {"fc", "cc", "kc"} <= set(values) or {"fc_left", "cc_left", "fc_right", "cc_right"} <= set(values)


def _script(text: str) -> dict[str, Any]:
    """What a script assigns: numbers and columns of them."""
    out: dict[str, Any] = {}
    for name, value in _ASSIGNED.findall(text):
        try:
            out[name] = np.array([float(v) for v in re.split(r"[\s;,]+", value.strip("[] \n\t")) if v])
        except ValueError:
            continue
    return out


def _values(document: Document) -> Mapping[str, Any]:
    return variables(document.content) if document.text is None else _script(document.text)


def _read(document: Document, options: ReadOptions) -> CalibrationResult:
    source, values = str(document.path), _values(document)
    note_unused(source, (name for name, value in values.items() if not _USED.match(name) and np.size(value)))
    if "fc_left" not in values:
        camera = _camera(values, "", options.image_size)
        return read_cameras({"camera": camera}, views=_views(values, options, source) if options.places else ())
    cameras = {side: _camera(values, f"_{side}", options.image_size) for side in _SIDES}
    views = _views(values, options, source, "left") if options.places else ()
    if options.camera in cameras:
        cameras = {str(options.camera): cameras[str(options.camera)]}
    if not options.places or len(cameras) < 2:
        return read_cameras(cameras)
    t = _numbers(values, "T", (3,)) * _unit(options, source)
    T = se3.make(so3.exp(_numbers(values, "om", (3,))), t)
    if isinstance(values.get("R"), np.ndarray) and values["R"].shape == (3, 3):
        off = so3.angle(T[:3, :3].T @ so3.nearest(values["R"]))
        if not off < 1e-6:
            raise InputError(f"om and R differ by {np.rad2deg(off):.3g} degrees; keep one")
    return read_cameras(cameras, transforms=(as_transform(*_SIDES, se3.inverse(T)),), views=views)


def _numbers(values: Mapping[str, Any], name: str, counts: tuple[int, ...]) -> Array:
    found = values.get(name)
    if not isinstance(found, np.ndarray) or found.size not in counts or not np.all(np.isfinite(found)):
        raise InputError(f"{name} is no array of {' or '.join(map(str, counts))} finite numbers")
    return np.asarray(found, dtype=np.float64).ravel()


def _camera(values: Mapping[str, Any], side: str, image_size: Size | None) -> Camera:
    fc, cc = _numbers(values, f"fc{side}", (2,)), _numbers(values, f"cc{side}", (2,))
    kc = _numbers(values, f"kc{side}", (4, 5)) if f"kc{side}" in values else np.zeros(5)
    alpha = float(_numbers(values, f"alpha_c{side}", (1,))[0]) if f"alpha_c{side}" in values else 0.0
    terms = {name: float(v) for name, v in zip(_TERMS, kc) if v != 0}
    skew = float(alpha * fc[0])
    model = smallest_model(terms, skew)
    own = {"fx": fc[0], "fy": fc[1], "cx": cc[0], "cy": cc[1]} | terms | ({"skew": skew} if skew else {})
    size = whole_size(*(_numbers(values, n, (1,))[0] for n in ("nx", "ny"))) if "nx" in values else None
    camera = placed_camera(model, {name: float(v) for name, v in own.items()}, size, image_size)
    errors = [np.ravel(values.get(f"{name}{side}_error", np.zeros(0))) for name in ("fc", "cc", "kc")]
    if skew or any(e.dtype.kind != "f" or e.size < 2 or not np.all(np.isfinite(e)) for e in errors):
        return camera
    three = dict(zip(("fx", "fy", "cx", "cy", *_TERMS), (float(v) for e in errors for v in e)))
    sigma = np.array([abs(three.get(name, 0.0)) / _SIGMAS for name in camera.model.parameter_names])
    covariance = np.diag(sigma**2)
    return Camera.create(model, camera.parameters, image_size=camera.image_size, covariance=covariance)


def _unit(options: ReadOptions, source: str) -> float:
    if options.unit_m is not None:
        return options.unit_m
    note(f"{source}: its lengths are taken for mm, in which the toolbox asks for the size of squares; --unit says it")
    return 1e-3


def _views(values: Mapping[str, Any], options: ReadOptions, source: str, side: str = "") -> tuple[ViewResult, ...]:
    """Places of the boards; a pair's are the left camera's."""
    mark = f"{side}_" if side else ""
    numbers = sorted(int(m[1]) for name in values if (m := re.fullmatch(rf"omc_{mark}(\d{{1,4}})", name)))
    found = []
    for i in numbers:
        turn, place = values.get(f"omc_{mark}{i}"), values.get(f"Tc_{mark}{i}")
        if isinstance(turn, np.ndarray) and isinstance(place, np.ndarray) and turn.size == place.size == 3:
            pose = np.concatenate([turn.ravel(), place.ravel()])
            if np.all(np.isfinite(pose)):  # pictures that were not used have NaN
                found.append((i, pose))
    unit = _unit(options, source) if found else 1.0
    return tuple(
        ViewResult(str(i), True, 0, camera=side or "camera", T_camera_target=se3.make(so3.exp(p[:3]), unit * p[3:]))
        for i, p in found
    )


def _lens(camera: Camera, side: str) -> dict[str, Any]:
    p = camera.parameters
    column = {name: np.array([[v] for v in values]) for name, values in _columns(p).items()}
    out: dict[str, Any] = {f"{name}{side}": value for name, value in column.items()}
    out[f"alpha_c{side}"] = p.get("skew", 0.0) / p["fx"]
    return out | ({"KK": camera.K} if not side else {f"KK{side}": camera.K})


def _columns(p: Mapping[str, float]) -> dict[str, list[float]]:
    return {"fc": [p["fx"], p["fy"]], "cc": [p["cx"], p["cy"]], "kc": [p.get(name, 0.0) for name in _TERMS]}


def _write(result: CalibrationResult, options: WriteOptions) -> bytes:
    names = list(result.cameras)
    if len(names) not in (1, 2):
        raise InputError(f"Bouguet's files hold a camera or a pair, there are {len(names)} cameras; name one: --camera")
    cameras = [result.cameras[name] for name in names]
    width, height = cameras[0].image_size
    values: dict[str, Any] = {"nx": float(width), "ny": float(height)}
    if len(names) == 1:
        values |= _lens(cameras[0], "")
        places = [v.T_camera_target for v in result.views if v.T_camera_target is not None]
        for i, T in enumerate(places[: _MOST_VIEWS - 1], 1):
            values |= {f"omc_{i}": so3.log(T[:3, :3])[:, None], f"Tc_{i}": 1e3 * T[:3, 3:]}
        return written(values)
    if cameras[1].image_size != cameras[0].image_size:
        raise InputError("Bouguet's stereo file has one image size for both cameras, and these differ")
    for camera, side in zip(cameras, _SIDES):
        values |= _lens(camera, f"_{side}")
    T = se3.inverse(places_in(result, names[0], tuple(names))[names[1]])
    note(f"{names[0]} is written as left, {names[1]} as right")
    return written(values | {"om": so3.log(T[:3, :3])[:, None], "T": 1e3 * T[:3, 3:], "R": T[:3, :3]})


FORMAT = ExchangeFormat(
    name="bouguet",
    title="Bouguet's toolbox (Calib_Results.mat, Calib_Results_stereo.mat)",
    suffix=".mat",
    matches=_matches,
    read=_read,
    write=_write,
    models=("pinhole", "brown", "pinhole_skew"),
)
