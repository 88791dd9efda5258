"""ROS camera_info: the YAML of camera_calibration_parsers, and the fields of the message itself."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from calibrant.cameras import Camera
from calibrant.errors import InputError
from calibrant.formats.camera_format import CameraFormat, Size, camera_from_opencv, numbers, size_or_refuse, whole_size

_MODELS = ("plumb_bob", "rational_polynomial", "none", "")
"""Names whose first five coefficients are OpenCV's k1 k2 p1 p2 k3 (sensor_msgs/distortion_models.h)."""


def _matches(data: Mapping[str, Any]) -> bool:
    matrix = data.get("camera_matrix")
    file = isinstance(matrix, Mapping) and "data" in matrix
    message = any(k in data for k in ("K", "k")) and any(k in data for k in ("D", "d")) and "distortion_model" in data
    return file or message


def _read(data: Mapping[str, Any], image_size: Size | None) -> Camera:
    model = str(data.get("distortion_model", "plumb_bob"))
    if model not in _MODELS:
        raise InputError(f"the distortion model is {model!r}; expected plumb_bob")
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
    size = whole_size(width, height) if width and height else None
    terms = numbers(distortion, "distortion coefficients")
    return camera_from_opencv(np.reshape(K, (3, 3)), terms.tolist(), size_or_refuse(size, image_size))


ROS_CAMERA_INFO = CameraFormat("ROS camera_info YAML", _matches, _read)
