"""CamOdoCal's camera files, which the VINS programs use too, and its folders of several with their places.

    model_type       here            projection_parameters  distortion_parameters
    PINHOLE          brown           fx fy cx cy            k1 k2 p1 p2
    PINHOLE_FULL     rational        fx fy cx cy            k1 to k6, p1 p2
    MEI              unified         gamma1 gamma2 u0 v0    k1 k2 p1 p2, mirror_parameters xi
    KANNALA_BRANDT   kannala_brandt  mu mv u0 v0            k2 k3 k4 k5, which are k1 to k4 here (in one mapping)
    SCARAMUZZA       the nearest     poly_parameters p0 …   affine_parameters ac ad ae cx cy

A folder holds extrinsic.txt (a name, then [R | t] of 3 lines: X_rig = R X_cam + t, metres) beside NAME_calib.yaml; or,
of a pair, camera_left.yaml, camera_right.yaml and extrinsics.yaml (X_right = q X_left + t). extrinsicRotation and
extrinsicTranslation of VINS-Mono's files are the camera's place on the IMU, X_imu = R X_cam + t. Pixels are OpenCV's.
Source: CamOdoCal's camera_models/*.cc, CameraSystem.cc, CameraRigExtrinsics.h, StereoCameraCalibration.cc.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, TransformEstimate, as_transform
from calibrant.errors import InputError
from calibrant.formats.cameras.calibrators.polynomial import polynomial_camera
from calibrant.formats.cameras.calibrators.rigid import finite, from_matrix, from_quaternion, quoted
from calibrant.formats.cameras.camera_format import placed_camera, single, whole_size
from calibrant.formats.cameras.foreign_lens import ASKS
from calibrant.formats.documents.document import Document
from calibrant.formats.documents.number_text import digits
from calibrant.formats.exchange.exchange_format import (
    ExchangeFormat,
    ReadOptions,
    WriteOptions,
    Written,
    read_cameras,
)
from calibrant.formats.exchange.places import IMU, places_in, world_of
from calibrant.geometry import se3
from calibrant.reading.notes import note, note_unused

_RADTAN = ("k1", "k2", "p1", "p2")
_FULL = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
_PARAMETERS = {
    "PINHOLE": ("brown", ("fx", "fy", "cx", "cy"), dict(zip(_RADTAN, _RADTAN))),
    "PINHOLE_FULL": ("rational", ("fx", "fy", "cx", "cy"), dict(zip(_FULL, _FULL))),
    "MEI": ("unified", ("gamma1", "gamma2", "u0", "v0"), dict(zip(("xi", *_RADTAN), ("xi", *_RADTAN)))),
    "KANNALA_BRANDT": ("kannala_brandt", ("mu", "mv", "u0", "v0"), {f"k{n + 1}": f"k{n}" for n in (1, 2, 3, 4)}),
}
"""Their names of the focal lengths and the principal point, and of each term (with ours)."""
WRITTEN = {"pinhole": "PINHOLE"} | {ours: word for word, (ours, *_) in _PARAMETERS.items()}
LACKS: Mapping[str, tuple[str, ...]] = {"brown": ("k3",), "unified": ("skew",)}
_GROUPS = ("mirror_parameters", "distortion_parameters", "projection_parameters")
_POLYNOMIAL = ("poly_parameters", "affine_parameters")
_ON_IMU = ("extrinsicRotation", "extrinsicTranslation")
_USED = (
    "model_type",
    "camera_name",
    "image_width",
    "image_height",
    *_GROUPS,
    *_POLYNOMIAL,
    *_ON_IMU,
    "inv_poly_parameters",
)
_RIG = "rig"
_PAIR = ("camera_left", "camera_right")
_POSES = "extrinsic.txt"


def _is_camera(data: Mapping[str, Any]) -> bool:
    return isinstance(data.get("projection_parameters"), Mapping) or all(
        isinstance(data.get(key), Mapping) for key in _POLYNOMIAL
    )


def _matches(document: Document) -> bool:
    if document.is_folder:
        pair = {f"{name}.yaml" for name in _PAIR} | {"extrinsics.yaml"}
        return pair <= document.names or (
            _POSES in document.names and any(name.endswith("_calib.yaml") for name in document.names)
        )
    return _is_camera(document.mapping)


def _read(document: Document, options: ReadOptions) -> CalibrationResult:
    if document.is_folder:
        return _pair(document, options) if _POSES not in document.names else _system(document, options)
    camera = camodocal_camera(document, options)
    name = str(document.mapping.get("camera_name") or document.path.name.partition(".")[0])
    places: tuple[TransformEstimate, ...] = ()
    if all(key in document.mapping for key in _ON_IMU):
        R, t = (finite(document.mapping[key], key) for key in _ON_IMU)
        if R.size != 9 or t.size != 3:
            raise InputError(
                f"extrinsicRotation of {R.size} and extrinsicTranslation of {t.size} numbers, expected 9, 3"
            )
        T = from_matrix(np.hstack([R.reshape(3, 3), t.reshape(3, 1)]), _ON_IMU[0])
        places = (as_transform(IMU, name, _right_handed(document, T, options)),)
    note_unused(str(document.path), (str(key) for key in document.mapping if key not in _USED))
    return read_cameras({name: camera}, transforms=places)


def _system(folder: Document, options: ReadOptions) -> CalibrationResult:
    """extrinsic.txt: a name and three rows of four numbers, again and again."""
    lines = [line.split() for line in (Document(folder.path / _POSES).text or "").splitlines() if line.strip()]
    if not lines or len(lines) % 4:
        raise InputError(f"{_POSES} has {len(lines)} lines, expected a name and three rows for each camera")
    cameras: dict[str, Camera] = {}
    places: list[TransformEstimate] = []
    for i in range(0, len(lines), 4):
        name = " ".join(lines[i])
        if f"{name}_calib.yaml" not in folder.names:
            raise InputError(f"{_POSES} names the camera {name[:60]!r}, and there is no {name[:60]}_calib.yaml")
        file = Document(folder.path / f"{name}_calib.yaml")
        T = from_matrix([n for row in lines[i + 1 : i + 4] for n in row], f"{_POSES}: {name}")
        places.append(as_transform(_RIG, name, _right_handed(file, T, options)))
        cameras[name] = camodocal_camera(file, options)
    return read_cameras(cameras, transforms=tuple(places))


def _pair(folder: Document, options: ReadOptions) -> CalibrationResult:
    files = {name: Document(folder.path / f"{name}.yaml") for name in _PAIR}
    cameras = {name: camodocal_camera(file, options) for name, file in files.items()}
    found = Document(folder.path / "extrinsics.yaml").mapping.get("transform")
    if not isinstance(found, Mapping):
        raise InputError("extrinsics.yaml holds no transform")
    q, t = ([single(found, f"{part}_{axis}") for axis in axes] for part, axes in (("q", "xyzw"), ("t", "xyz")))
    T_right_left = from_quaternion(q, t, "extrinsics.yaml")
    for file in files.values():
        _right_handed(file, T_right_left, options)
    return read_cameras(cameras, transforms=(as_transform(*_PAIR, se3.inverse(T_right_left)),))


def _right_handed(document: Document, T: Array, options: ReadOptions) -> Array:
    """The pose as it is. Raises: InputError where it is one of a frame that has x right, y down and z backwards."""
    poly = document.mapping.get("poly_parameters")
    if options.places and isinstance(poly, Mapping) and single(poly, "p0") < 0:
        raise InputError(
            f"{document.path.name}: p0 below 0 has the image's middle look along -z, which with x right and y down "
            "is a left-handed frame; its pose cannot be read. Take the camera alone"
        )
    return T


def camodocal_camera(document: Document, options: ReadOptions) -> Camera:
    """The camera of one of its files. Raises: InputError for unknown models, and terms that are not the model's."""
    data, source = document.mapping, str(document.path)
    if not _is_camera(data):
        raise InputError(f"{source}: no projection_parameters in it")
    found = None
    if "image_width" in data:
        found = whole_size(data["image_width"], data.get("image_height"))
    if "poly_parameters" in data:
        return _polynomial(data, found or options.image_size, source, options.answers)
    mappings = [data.get(group) or {} for group in _GROUPS]
    if not all(isinstance(found, Mapping) for found in mappings):
        raise InputError(f"{source}: expected numbers by name under {', '.join(_GROUPS)}")
    groups = {str(key): value for found in mappings for key, value in found.items()}
    word = str(data.get("model_type", "MEI" if "xi" in groups else "PINHOLE")).upper()
    if word not in _PARAMETERS:
        known = ", ".join((*_PARAMETERS, "SCARAMUZZA"))
        raise InputError(f"{source}: model_type is {word[:40]!r}, expected one of {known}")
    ours, four, terms = _PARAMETERS[word]
    values = {name: single(groups, key) for name, key in zip(("fx", "fy", "cx", "cy"), four)}
    if not (word == "PINHOLE" and "distortion_parameters" not in data):
        values |= {name: single(groups, key) for key, name in terms.items()}
    left = sorted(set(groups) - {*four, *terms})
    if left:
        raise InputError(
            f"{source}: {', '.join(left)} is no parameter of {word}, which has {', '.join((*four, *terms))}"
        )
    return placed_camera(ours, values, found, options.image_size)


def _polynomial(
    data: Mapping[str, Any], size: tuple[int, int] | None, source: str, answers: Mapping[str, str]
) -> Camera:
    poly, affine = (data[key] for key in _POLYNOMIAL)
    if size is None:
        raise InputError(f"{source}: no image_width and image_height; say --image-size")
    coefficients = finite([single(poly, f"p{i}") for i in range(len(poly))], "poly_parameters")
    ac, ad, ae, cx, cy = finite([single(affine, key) for key in ("ac", "ad", "ae", "cx", "cy")], "affine_parameters")
    A = np.array([[ac, ad], [ae, 1.0]])
    return polynomial_camera(coefficients, A, np.array([cx, cy]), size=size, source=source, answers=answers)


def _write(result: CalibrationResult, options: WriteOptions) -> Written:
    if len(result.cameras) == 1:
        return camodocal_text(*next(iter(result.cameras.items())))
    strange = next((name for name in result.cameras if set(name) & set('/\\:"')), None)
    if strange is not None:
        raise InputError(f"the camera {strange!r} gives its file its name, which cannot have / \\ : or quotes in it")
    places = places_in(result, world_of(result, options.answers.get("world")), tuple(result.cameras))
    blocks = ["\n".join([name, *(" ".join(map(digits, row)) for row in T[:3])]) for name, T in places.items()]
    files = {f"{name}_calib.yaml": camodocal_text(name, camera) for name, camera in result.cameras.items()}
    return {_POSES: ("\n\n".join(blocks) + "\n").encode(), **files}


def camodocal_text(name: str, camera: Camera) -> bytes:
    """The file of a camera of one of `WRITTEN`."""
    word = WRITTEN[camera.model.name]
    if word == "PINHOLE_FULL":
        note(f"{name} is written as PINHOLE_FULL, which VINS-Fusion's camera models know and CamOdoCal's own do not")
    _, four, terms = _PARAMETERS[word]
    p = camera.parameters
    focal = {key: p[ours] for key, ours in zip(four, ("fx", "fy", "cx", "cy"))}
    lens = {key: p.get(ours, 0.0) for key, ours in terms.items() if key != "xi"}
    groups: dict[str, dict[str, float]] = {"mirror_parameters": {"xi": p["xi"]}} if "xi" in terms else {}
    if word == "KANNALA_BRANDT":
        groups |= {"projection_parameters": lens | focal}
    else:
        groups |= {"distortion_parameters": lens, "projection_parameters": focal}
    lines = ["%YAML:1.0", "---", f"model_type: {word}", f"camera_name: {quoted(name)}"]
    lines += [f"image_width: {camera.image_size[0]}", f"image_height: {camera.image_size[1]}"]
    for group, values in groups.items():
        lines += [f"{group}:", *(f"   {key}: {digits(value)}" for key, value in values.items())]
    return ("\n".join(lines) + "\n").encode()


FORMAT = ExchangeFormat(
    name="camodocal",
    title="CamOdoCal camera (YAML), or a folder of several with extrinsic.txt",
    suffix=".yaml",
    matches=_matches,
    read=_read,
    write=_write,
    models=tuple(WRITTEN),
    lacks=LACKS,
    asks=ASKS | {"world": "the frame that all cameras are placed in"},
)
