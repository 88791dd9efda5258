"""A stereo pair in OpenCV's own file format: `stereo.yml`, as its stereo samples and calibration programs write it.

K1 D1, K2 D2 (OpenCV's samples call the former M1, M2: both stand there), R and T with X_right = R X_left + T, T in
millimetres (`T_unit`), E = [T]x R and F of undistorted pixels.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from calibrant.arrays import Array
from calibrant.data import CalibrationResult
from calibrant.data.details import StereoGeometry
from calibrant.errors import InputError
from calibrant.formats.cameras.opencv import distortion_coefficients, is_opencvs
from calibrant.formats.documents.opencv_storage import Storable, yaml_text
from calibrant.formats.exchange.places import places_in
from calibrant.formats.exchange.rotation_numbers import rotation_in
from calibrant.geometry import se3
from calibrant.geometry.projective import essential_from_transform, fundamental_from_transform
from calibrant.targets.lengths import parse_length

_MM = 1e3
_SIDES = ("left", "right")
"""What the first and the second camera are called where the file does not say."""
PAIR_SUFFIXES = (".yml", ".yaml", ".xml")
_SECOND = ("K2", "M2", "cameraMatrix2", "camera_matrix_2")
"""Keys that only files of two cameras have."""
_SHARED = ("image_width", "image_height", "image_size", "imageSize")
"""What both cameras of a pair may have in common."""


def is_opencvs_pair(result: CalibrationResult) -> bool:
    """Whether OpenCV has the models of both cameras."""
    return all(is_opencvs(camera) for camera in result.cameras.values())


def stereo_text(result: CalibrationResult) -> str:
    """A pair: of a result of kind "stereo", or any two cameras that transforms connect, in their order.

    Raises: InputError where there are not two, or none leads from one to the other, or OpenCV lacks a model.
    """
    left, right = _sides(result)
    T = se3.inverse(places_in(result, left, (right,))[right])
    a, b = result.cameras[left], result.cameras[right]
    values: dict[str, Storable] = {"calibration_time": result.created}
    for number, name in ((1, left), (2, right)):
        camera = result.cameras[name]
        if not is_opencvs(camera):
            raise InputError(
                f"the {camera.model.name} camera {name} cannot be written as OpenCV YAML, which has no such model; "
                "write the JSON result instead"
            )
        values |= {
            f"camera_{number}": name,
            f"camera_model_{number}": camera.model.name,
            f"image_width_{number}": camera.image_size[0],
            f"image_height_{number}": camera.image_size[1],
            f"K{number}": camera.K,
            f"D{number}": distortion_coefficients(camera),
            f"M{number}": camera.K,
        }
        if "xi" in camera.parameters:
            values[f"xi{number}"] = camera.parameters["xi"]
    values |= {
        "R": T[:3, :3],
        "T": _MM * T[:3, 3:],
        "T_unit": "mm",
        "E": _MM * essential_from_transform(T),
        "F": fundamental_from_transform(T, K_a=a.K, K_b=b.K),
    }
    if result.rms_px is not None:
        values["avg_reprojection_error"] = float(result.rms_px)
    return yaml_text(values)


def _sides(result: CalibrationResult) -> tuple[str, str]:
    pair = result.detail(StereoGeometry)
    if pair is not None:
        return pair.left, pair.right
    if len(result.cameras) != 2:
        listed = ", ".join(result.cameras) or "none"
        raise InputError(f"OpenCV's stereo file holds two cameras, there are {len(result.cameras)} ({listed})")
    left, right = result.cameras
    return left, right


def is_pair(data: Mapping[str, Any]) -> bool:
    """Whether there are two cameras in the file."""
    return any(key in data for key in _SECOND)


def pair_names(data: Mapping[str, Any]) -> tuple[str, str]:
    """What a stereo file calls its cameras. Raises: InputError for a file of one camera, or of none."""
    if not is_pair(data):
        keys = ", ".join(repr(str(key)) for key in list(data)[:8]) or "(none)"
        raise InputError(f"no stereo pair in it; its keys are {keys}; expected K1, D1, K2, D2, R and T")
    left, right = (str(data.get(f"camera_{number}", side)) for number, side in enumerate(_SIDES, start=1))
    return left, right


def T_left_right(data: Mapping[str, Any], *, unit_m: float | None = None) -> Array:
    """Coordinates of the right camera into the left one, metres, from X_right = R X_left + T in `T_unit`.

    Args: unit_m: metres per unit of T, where the file does not say it.
    Raises: InputError where R, T or its unit is missing, or R is no rotation.
    """
    missing = [key for key in ("R", "T", "T_unit") if key not in data and (key != "T_unit" or unit_m is None)]
    if missing:
        what = (
            "; OpenCV's own programs leave the unit out: add a line such as T_unit: mm" if "T_unit" in missing else ""
        )
        raise InputError(f"a stereo file without {' and '.join(missing)}{what}")
    R, t = (np.asarray(data[key], dtype=np.float64) for key in ("R", "T"))
    turn = rotation_in(R) if R.shape == (3, 3) else None
    if turn is None or t.size != 3:
        raise InputError(f"R {R.shape} and T {t.shape} are no rotation (3, 3) and translation of three numbers")
    metre = parse_length(f"1{data['T_unit']}", what="T_unit") if "T_unit" in data else unit_m or 1.0
    return se3.inverse(se3.make(turn, metre * t.ravel()))


def of_pair(data: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    """What a stereo file says of one of its cameras, under keys without its number; other files' data as they are.

    name: as the file calls it (camera_1, camera_2), else left or right. Raises: InputError for any other.
    """
    if not is_pair(data):
        return data
    names = [str(data.get(f"camera_{number}", side)) for number, side in enumerate(_SIDES, start=1)]
    if name not in names:
        raise InputError(f"a stereo file with the cameras {' and '.join(names)}, none of them {name!r}")
    mine = str(names.index(name) + 1)
    found = {key: data[key] for key in _SHARED if key in data}
    found |= {key[:-1].rstrip("_"): value for key, value in data.items() if key.endswith(mine)}
    found.pop("camera", None)
    matrix = found.pop("M", None)  # OpenCV's samples call K so
    return found if matrix is None else {"K": matrix, **found}
