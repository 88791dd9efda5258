"""Reading a camera from any known file. A format is a file of its own and a line in FORMATS."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from calibrant.cameras import Camera
from calibrant.data.result_encoding import FORMAT
from calibrant.data.result_file import read_result
from calibrant.errors import InputError
from calibrant.formats.cameras.camera_format import CameraFormat, Size, size_or_refuse
from calibrant.formats.cameras.named import NAMED_INTRINSICS
from calibrant.formats.cameras.opencv import OPENCV
from calibrant.formats.cameras.opencv_storage import read_json, read_xml, read_yaml
from calibrant.formats.cameras.ros import ROS_CAMERA_INFO

FORMATS: tuple[CameraFormat, ...] = (ROS_CAMERA_INFO, OPENCV, NAMED_INTRINSICS)
"""Formats of other programs, tried in this order."""


def read_camera(path: str | Path, *, image_size: Size | None = None) -> Camera:
    """The camera in a file: a result of calibrant, OpenCV YAML, XML or JSON, ROS camera_info, or named intrinsics.

    image_size (width, height) px, where the caller knows it: needed by files that do not hold it, checked on others.
    Raises: InputError naming the file, what it holds and which formats are read.
    """
    path = Path(path)
    data = _data(path)
    try:
        if str(data.get("format", "")).startswith(FORMAT.partition("/")[0]):
            camera = read_result(path).camera
            size_or_refuse(camera.image_size, image_size)
            return camera
        for form in FORMATS:
            if form.matches(data):
                return form.read(data, image_size)
    except InputError as error:
        text = str(error)
        raise InputError(text if text.startswith(str(path)) else f"{path}: {text}") from error
    listed = ", ".join(repr(str(key)) for key in list(data)[:8]) or "(none)"
    known = ", ".join(("calibrant result (JSON)", *(form.name for form in FORMATS)))
    raise InputError(f"{path}: no camera in it; its keys are {listed}; formats read: {known}")


def _data(path: Path) -> Mapping[str, Any]:
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise InputError(f"cannot read the camera {path}: {(error.strerror or str(error)).lower()}") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not a text file; a camera is read from JSON, YAML or XML") from error
    start = text.lstrip()
    read = read_json if start.startswith("{") else read_xml if start.startswith("<") else read_yaml
    data = read(text, str(path))
    if not isinstance(data, Mapping):
        raise InputError(f"{path}: {type(data).__name__}, expected keys and values that describe a camera")
    return data
