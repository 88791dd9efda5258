"""MATLAB's cameraParameters and stereoParameters, saved as structs (toStruct), cameraIntrinsics as well.

    [u v 1] ~ [X Y Z] R^T + t, IntrinsicMatrix = K^T (to R2022a), K since;   X2 = R X1 + t, RotationOfCamera2 = R^T

MATLAB's pixel (1, 1) is the middle of the first one. RotationVectors and TranslationVectors of the boards become views.
Sources: MathWorks' documentation of cameraParameters, stereoParameters and toStruct; which way a matrix lies is seen
from its numbers, and which way the pair's rotation goes from the boards that both cameras saw, where they are kept.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, as_transform
from calibrant.data.results import ViewResult
from calibrant.errors import InputError
from calibrant.formats.cameras.camera_format import (
    Size,
    matrix_parameters,
    placed_camera,
    smallest_model,
    whole_size,
)
from calibrant.formats.cameras.matlab.mat_file import CURE_OBJECT, MARK, MARK_73, Opaque, variables, written
from calibrant.formats.documents.document import Document
from calibrant.formats.exchange.exchange_format import ExchangeFormat, ReadOptions, WriteOptions, read_cameras
from calibrant.formats.exchange.places import places_in
from calibrant.geometry import se3, so3
from calibrant.reading.notes import note, note_unused

_FIRST = 1.0
"""Of the first pixel's middle."""
_UNITS = {
    **dict.fromkeys(("mm", "millimeters", "millimeter", "millimetres", "millimetre"), 1e-3),
    **dict.fromkeys(("cm", "centimeters", "centimeter"), 1e-2),
    **dict.fromkeys(("m", "meters", "meter", "metres", "metre"), 1.0),
    **dict.fromkeys(("in", "inch", "inches"), 0.0254),
}
_USED = {
    *("RadialDistortion", "TangentialDistortion", "ImageSize", "IntrinsicMatrix", "K", "FocalLength", "PrincipalPoint"),
    *("Skew", "WorldUnits", "RotationVectors", "TranslationVectors", "CameraParameters1", "CameraParameters2"),
    *("RotationOfCamera2", "TranslationOfCamera2", "PoseCamera2", "Version"),
}
_SAME = 1e-3
"""How far the pair's pose may be from the boards' to be theirs, rad and parts of its length."""


def _matches(document: Document) -> bool:
    return document.head.startswith((MARK, MARK_73))


def is_camera(value: Any) -> bool:
    """Whether a struct is a camera of MATLAB's."""
    if not isinstance(value, Mapping) or "RadialDistortion" not in value:
        return False
    return "IntrinsicMatrix" in value or "K" in value or {"FocalLength", "PrincipalPoint"} <= set(value)


def _is_pair(value: Any) -> bool:
    return isinstance(value, Mapping) and all(is_camera(value.get(f"CameraParameters{i}")) for i in (1, 2))


def _structs(values: Mapping[str, Any]) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """All structs with their names, those within others as well, as a calibration's session holds them."""
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield name, value
            if not (is_camera(value) or _is_pair(value)):
                yield from _structs(value)


def _read(document: Document, options: ReadOptions) -> CalibrationResult:
    source = str(document.path)
    values = variables(document.content)
    structs = list(_structs(values))
    pair = next((value for _, value in structs if _is_pair(value)), None)
    if pair is not None:
        return _pair(pair, options, source)
    found = {name: value for name, value in structs if is_camera(value)}
    if not found:
        raise InputError(_nothing(values))
    if options.camera in found:
        found = {str(options.camera): found[str(options.camera)]}
    cameras = {name: _camera(value, options.image_size) for name, value in found.items()}
    views = tuple(view for name, value in found.items() for view in _views(value, name, options, source))
    for name, value in found.items():
        note_unused(f"{source}: {name}", _left(value))
    return read_cameras(cameras, views=views)


def _nothing(values: Mapping[str, Any]) -> str:
    """What the file holds instead of a camera."""
    objects = [name for name, value in values.items() if isinstance(value, Opaque)]
    if objects:
        return f"{objects[0]} {CURE_OBJECT.format(objects[0])}"
    listed = ", ".join(list(values)[:8]) or "nothing"
    return (
        f"no camera in it; its variables are {listed}; expected a struct of cameraParameters or stereoParameters "
        "(toStruct), or Bouguet's Calib_Results"
    )


def _pair(value: Mapping[str, Any], options: ReadOptions, source: str) -> CalibrationResult:
    names = ("camera1", "camera2")
    both = dict(zip(names, (value["CameraParameters1"], value["CameraParameters2"])))
    note_unused(source, _left(value))
    kept = both if options.camera not in both else {str(options.camera): both[str(options.camera)]}
    cameras = {name: _camera(one, options.image_size) for name, one in kept.items()}
    if not options.places or len(kept) < 2:
        return read_cameras(cameras)
    views = [_views(one, name, options, source) for name, one in both.items()]
    T = _T_2_1(value, _unit(both["camera1"], options, source), views[0], views[1])
    return read_cameras(cameras, transforms=(as_transform(*names, se3.inverse(T)),), views=(*views[0], *views[1]))


def _T_2_1(
    value: Mapping[str, Any], unit: float, first: tuple[ViewResult, ...], second: tuple[ViewResult, ...]
) -> Array:
    """T_camera2_camera1. Raises: InputError for none, and for one that the boards contradict."""
    if "RotationOfCamera2" in value and "TranslationOfCamera2" in value:
        R, t = _array(value, "RotationOfCamera2", (3, 3)).T, _array(value, "TranslationOfCamera2", (3,))
    else:
        pose = value.get("PoseCamera2")
        if isinstance(pose, Mapping):
            pose = pose.get("A", pose.get("T"))
        M = np.asarray(pose if isinstance(pose, np.ndarray) else [], dtype=np.float64)
        if M.shape != (4, 4):
            raise InputError("the pair has neither RotationOfCamera2 and TranslationOfCamera2, nor PoseCamera2 as 4x4")
        if not np.allclose(M[3, :3], 0):
            M = M.T
        R, t = M[:3, :3], M[:3, 3]
    T = se3.check(se3.make(R, t * unit), name="the pair's pose")
    if not first or len(first) != len(second):
        return T
    boards = se3.mean(
        [np.asarray(b.T_camera_target) @ se3.inverse(np.asarray(a.T_camera_target)) for a, b in zip(first, second)]
    )
    for other in (T, se3.make(T[:3, :3].T, T[:3, 3]), se3.inverse(T)):
        if _near(other, boards):
            return other
    raise InputError("the pair's pose is not the one between the boards that both cameras saw")


def _near(T: Array, other: Array) -> bool:
    d = np.abs(se3.local(other, T))
    return bool(d[:3].max() <= _SAME and d[3:].max() <= _SAME * max(1e-9, float(np.linalg.norm(other[:3, 3]))))


def _array(value: Mapping[str, Any], key: str, shape: tuple[int, ...]) -> Array:
    found = value.get(key)
    size = int(np.prod(shape))
    if not isinstance(found, np.ndarray) or found.size != size or not np.all(np.isfinite(found)):
        raise InputError(f"{key} is no array of {size} finite numbers")
    return np.asarray(found.reshape(shape), dtype=np.float64)


def _camera(value: Mapping[str, Any], image_size: Size | None) -> Camera:
    fx, fy, cx, cy, skew = _matrix(value)
    radial = _row(value, "RadialDistortion", (0, 2, 3))
    tangential = _row(value, "TangentialDistortion", (0, 2))
    terms = dict(zip(("k1", "k2", "k3"), radial)) | dict(zip(("p1", "p2"), tangential))
    given = {name: v for name, v in terms.items() if v != 0}
    model = smallest_model(given, skew)
    lens = given | ({"skew": skew} if skew else {})
    size = value.get("ImageSize")
    found = None
    if isinstance(size, np.ndarray) and size.size:
        if size.size != 2:
            raise InputError(f"ImageSize holds {size.size} numbers, expected rows and columns")
        found = whole_size(*size.ravel()[::-1])
    parameters = {"fx": fx, "fy": fy, "cx": cx - _FIRST, "cy": cy - _FIRST} | lens
    return placed_camera(model, parameters, found, image_size)


def _matrix(value: Mapping[str, Any]) -> tuple[float, float, float, float, float]:
    """fx, fy, cx, cy, skew in MATLAB's pixels: its matrix lies transposed in older versions."""
    key = next((k for k in ("K", "IntrinsicMatrix") if isinstance(value.get(k), np.ndarray)), None)
    if key is not None:
        M = _array(value, key, (3, 3))
        return matrix_parameters(M.T if np.any(M[2, :2]) else M)
    f, c = _array(value, "FocalLength", (2,)), _array(value, "PrincipalPoint", (2,))
    skew = value.get("Skew")
    return *f.tolist(), *c.tolist(), float(skew.ravel()[0]) if isinstance(skew, np.ndarray) and skew.size else 0.0


def _row(value: Mapping[str, Any], key: str, counts: tuple[int, ...]) -> list[float]:
    found = value.get(key, np.zeros(0))
    if not isinstance(found, np.ndarray) or found.size not in counts or not np.all(np.isfinite(found)):
        raise InputError(f"{key} is no array of {' or '.join(str(n) for n in counts if n)} finite numbers")
    return [float(v) for v in found.ravel()]


def _unit(value: Mapping[str, Any], options: ReadOptions, source: str) -> float:
    """Metres per unit of its lengths: WorldUnits, what was said, else millimetres, the app's own default."""
    said = _UNITS.get(str(value.get("WorldUnits", "")).strip().lower())
    if options.unit_m is not None or said is not None:
        return options.unit_m or said or 1.0
    note(f"{source}: WorldUnits is {str(value.get('WorldUnits', ''))[:20]!r}; its lengths are taken for mm: --unit")
    return 1e-3


def _views(value: Mapping[str, Any], camera: str, options: ReadOptions, source: str) -> tuple[ViewResult, ...]:
    turns, places = value.get("RotationVectors"), value.get("TranslationVectors")
    if not options.places or not isinstance(turns, np.ndarray) or not isinstance(places, np.ndarray) or not turns.size:
        return ()
    if turns.ndim != 2 or turns.shape[1] != 3 or places.shape != turns.shape:
        raise InputError(f"RotationVectors {turns.shape} and TranslationVectors {places.shape} do not belong together")
    if not (np.all(np.isfinite(turns)) and np.all(np.isfinite(places))):
        raise InputError("RotationVectors or TranslationVectors hold numbers that are not finite")
    T = se3.make(so3.exp(turns), places * _unit(value, options, source))
    return tuple(ViewResult(str(i), True, 0, camera=camera, T_camera_target=M) for i, M in enumerate(T, 1))


def _left(value: Mapping[str, Any]) -> list[str]:
    def says(v: Any) -> bool:
        return bool(v.size and v.any()) if isinstance(v, np.ndarray) else bool(v)

    return [name for name, v in value.items() if name not in _USED and says(v)]


def _struct(camera: Camera, views: list[Array]) -> dict[str, Any]:
    p = camera.parameters
    width, height = camera.image_size
    K = camera.K.copy()
    K[:2, 2] += _FIRST
    more = {}
    if views:
        T = np.array(views)
        more = {"RotationVectors": so3.log(T[:, :3, :3]), "TranslationVectors": 1e3 * T[:, :3, 3]}
    return {
        "RadialDistortion": np.array([[p.get("k1", 0.0), p.get("k2", 0.0), p.get("k3", 0.0)]]),
        "TangentialDistortion": np.array([[p.get("p1", 0.0), p.get("p2", 0.0)]]),
        "ImageSize": np.array([[float(height), float(width)]]),
        "WorldUnits": "mm",
        "IntrinsicMatrix": K.T,
        "NumRadialDistortionCoefficients": 3.0,
        **more,
    }


def _write(result: CalibrationResult, options: WriteOptions) -> bytes:
    names = list(result.cameras)
    if len(names) not in (1, 2):
        raise InputError(
            f"MATLAB's structs hold a camera or a pair, there are {len(names)} cameras; name one: --camera"
        )
    views: dict[str, list[Array]] = {name: [] for name in names}
    for view in result.views:
        name = view.camera or names[0]
        if view.T_camera_target is not None and name in views:
            views[name].append(np.asarray(view.T_camera_target))
    structs = {name: _struct(result.cameras[name], views[name]) for name in names}
    if len(names) == 1:
        return written({"cameraParams": structs[names[0]]})
    T = se3.inverse(places_in(result, names[0], tuple(names))[names[1]])
    note(f"MATLAB's CameraParameters1 is {names[0]}, CameraParameters2 is {names[1]}")
    pair = {
        "CameraParameters1": structs[names[0]],
        "CameraParameters2": structs[names[1]],
        "RotationOfCamera2": T[:3, :3].T,
        "TranslationOfCamera2": 1e3 * T[None, :3, 3],
    }
    return written({"stereoParams": pair})


FORMAT = ExchangeFormat(
    name="matlab",
    title="MATLAB cameraParameters or stereoParameters (struct in a .mat file)",
    suffix=".mat",
    matches=_matches,
    read=_read,
    write=_write,
    models=("pinhole", "brown", "pinhole_skew"),
)
