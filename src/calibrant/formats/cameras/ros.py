"""ROS camera_info: the YAML of camera_calibration_parsers, and the fields of the message itself.

distortion_model (sensor_msgs/distortion_models.hpp): plumb_bob has OpenCV's five terms, rational_polynomial eight or
more of them, equidistant the four of cv2.fisheye.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from calibrant.cameras import Camera
from calibrant.cameras.plane_distortion import TERMS
from calibrant.data.result_file import write_text
from calibrant.errors import InputError
from calibrant.formats.cameras.camera_format import (
    CameraFormat,
    Size,
    camera_from_opencv,
    matrix_parameters,
    numbers,
    placed_camera,
    whole_size,
)

_EQUIDISTANT = "equidistant"
_PERSPECTIVE = ("plumb_bob", "rational_polynomial", "none", "")
_WRITTEN = {
    "pinhole": ("plumb_bob", TERMS[:5]),
    "brown": ("plumb_bob", TERMS[:5]),
    "rational": ("rational_polynomial", TERMS[:8]),
    "thin_prism": ("rational_polynomial", TERMS[:12]),
    "tilted": ("rational_polynomial", TERMS),
    "kannala_brandt": (_EQUIDISTANT, ("k1", "k2", "k3", "k4")),
}
"""The models that ROS has: its name and its coefficients in order. image_geometry hands rational_polynomial's to OpenCV
as they are, twelve and fourteen as well as eight."""


def write_camera_info(camera: Camera, path: str | Path, *, name: str = "camera", force: bool = False) -> Path:
    """Write a camera as the YAML that camera_info_manager reads; rectification is the identity, P is [K 0].

    Raises: InputError for a model that ROS does not have, or as `write_text`.
    """
    if camera.model.name not in _WRITTEN:
        raise InputError(
            f"a {camera.model.name} camera cannot be written as ROS camera_info, which holds {', '.join(_WRITTEN)}; "
            "write the JSON result instead"
        )
    model, terms = _WRITTEN[camera.model.name]
    p = camera.parameters
    values = {
        "image_width": camera.image_size[0],
        "image_height": camera.image_size[1],
        "camera_name": name,
        "camera_matrix": _matrix_entry(camera.K),
        "distortion_model": model,
        "distortion_coefficients": _matrix_entry(np.array([[p.get(term, 0.0) for term in terms]])),
        "rectification_matrix": _matrix_entry(np.eye(3)),
        "projection_matrix": _matrix_entry(np.concatenate([camera.K, np.zeros((3, 1))], axis=1)),
    }
    return write_text(yaml.safe_dump(values, sort_keys=False, default_flow_style=None), path, force=force)


def _matrix_entry(values: np.ndarray) -> dict[str, object]:
    rows, columns = values.shape
    return {"rows": rows, "cols": columns, "data": values.ravel().tolist()}


def _is_ros(data: Mapping[str, Any]) -> bool:
    matrix = data.get("camera_matrix")
    file = isinstance(matrix, Mapping) and "data" in matrix
    message = any(k in data for k in ("K", "k")) and any(k in data for k in ("D", "d")) and "distortion_model" in data
    return file or message


def _ros_camera(data: Mapping[str, Any], image_size: Size | None) -> Camera:
    model = str(data.get("distortion_model", "plumb_bob"))
    if model not in (*_PERSPECTIVE, _EQUIDISTANT):
        raise InputError(
            f"the distortion model is {model!r}; expected plumb_bob, rational_polynomial or {_EQUIDISTANT}"
        )
    if "camera_matrix" in data:
        matrix = data["camera_matrix"]["data"]
        distortion = (data.get("distortion_coefficients") or {}).get("data", [])
        width, height = data.get("image_width"), data.get("image_height")
    else:
        matrix, distortion = data.get("K", data.get("k")), data.get("D", data.get("d"))
        width, height = data.get("width"), data.get("height")
    K = numbers(matrix, "camera_matrix.data")
    if len(K) != 9:
        raise InputError(f"the camera matrix has {len(K)} numbers, expected 9")
    found = whole_size(width, height) if width and height else None
    terms = numbers(distortion, "distortion coefficients")
    if model == _EQUIDISTANT:
        return _equidistant(K.reshape(3, 3), terms, found, image_size)
    return camera_from_opencv(K.reshape(3, 3), terms.tolist(), found, image_size)


def _equidistant(K: np.ndarray, terms: np.ndarray, found: Size | None, image_size: Size | None) -> Camera:
    if len(terms) != 4:
        raise InputError(f"{len(terms)} distortion coefficients; an {_EQUIDISTANT} camera has k1, k2, k3, k4")
    fx, fy, cx, cy, skew = matrix_parameters(K)
    if skew:
        raise InputError(f"the camera matrix has skew {skew:g}; an {_EQUIDISTANT} camera has none")
    named = {f"k{i}": float(value) for i, value in enumerate(terms, 1)}
    return placed_camera("kannala_brandt", {"fx": fx, "fy": fy, "cx": cx, "cy": cy, **named}, found, image_size)


ROS_CAMERA_INFO = CameraFormat("ROS camera_info YAML", _is_ros, _ros_camera)
