"""Reading a camera from any known file. A format is a file of its own and a line in FORMATS."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, as_transform
from calibrant.data.result_encoding import FORMAT
from calibrant.data.result_file import read_result
from calibrant.errors import InputError
from calibrant.formats.cameras.camera_format import CameraFormat, Size, size_or_refuse
from calibrant.formats.cameras.described import DESCRIBED
from calibrant.formats.cameras.opencv_stereo import PAIR_SUFFIXES, T_left_right, of_pair, pair_names
from calibrant.formats.cameras.opencv_storage import read_json, read_xml, read_yaml_documents
from calibrant.reading.files import read_text

FORMATS: tuple[CameraFormat, ...] = (DESCRIBED,)
"""Formats of other programs, tried in this order."""


def read_camera(path: str | Path, *, image_size: Size | None = None, name: str | None = None) -> Camera:
    """The camera in a file: a result of calibrant, OpenCV YAML, XML or JSON, ROS camera_info, or named intrinsics.

    image_size (width, height) px, where the caller knows it: needed by files that do not hold it, checked on others.
    name: which camera, of a file of several: one of a result's, or the left or right one of OpenCV's stereo file.
    Raises: InputError naming the file, what it holds and which formats are read.
    """
    path = Path(path)
    data = _data(path)
    try:
        if str(data.get("format", "")).startswith(FORMAT.partition("/")[0]):
            camera = _of_result(read_result(path), name)
            size_or_refuse(camera.image_size, image_size)
            return camera
        mine = data if name is None else of_pair(data, name)
        for form in FORMATS:
            if form.matches(mine):
                return form.read(mine, image_size, str(path))
    except InputError as error:
        text = str(error)
        raise InputError(text if text.startswith(str(path)) else f"{path}: {text}") from error
    listed = ", ".join(repr(str(key)) for key in list(data)[:8]) or "(none)"
    known = ", ".join(("calibrant result (JSON)", *(form.name for form in FORMATS)))
    raise InputError(f"{path}: no camera in it; its keys are {listed}; formats read: {known}")


def read_pair(path: str | Path) -> CalibrationResult:
    """The cameras of a result of calibrant, or the two of OpenCV's stereo file (`stereo.yml`), without covariance.

    Raises: InputError naming the file, and what of a pair it does not hold.
    """
    path = Path(path)
    if path.suffix.lower() not in PAIR_SUFFIXES:
        return read_result(path)
    data = _data(path)
    try:
        names = pair_names(data)
        cameras = {name: read_camera(path, name=name) for name in names}
        place = as_transform(*names, T_left_right(data))
    except InputError as error:
        text = str(error)
        raise InputError(text if text.startswith(str(path)) else f"{path}: {text}") from error
    return CalibrationResult("stereo", "ok", cameras=cameras, transforms=(place,))


def _of_result(result: CalibrationResult, name: str | None) -> Camera:
    """The only camera, whatever it is called, or the one of that name."""
    if len(result.cameras) > 1 and name is not None and name not in result.cameras:
        raise InputError(f"a result with the cameras {', '.join(result.cameras)}, none of them {name!r}")
    return result.cameras[name] if len(result.cameras) > 1 and name is not None else result.camera


def _data(path: Path) -> Mapping[str, Any]:
    text = read_text(path, what="camera file", expected="a camera in JSON, YAML or XML")
    start = text.lstrip()
    if start.startswith("{"):
        data = read_json(text, str(path))
    elif start.startswith("<"):
        data = read_xml(text, str(path))
    else:
        data = _only(read_yaml_documents(text, str(path)), path)
    if not isinstance(data, Mapping):
        raise InputError(f"{path}: {type(data).__name__}, expected keys and values that describe a camera")
    return data


def _only(documents: list[Any], path: Path) -> Any:
    """The one document; of messages that were printed one after the other the first, where all say the same camera."""
    if not documents:
        raise InputError(f"{path}: the file is empty; expected keys and values that describe a camera")
    told = [{k: v for k, v in d.items() if k != "header"} if isinstance(d, Mapping) else d for d in documents]
    if any(repr(other) != repr(told[0]) for other in told[1:]):
        raise InputError(f"{path}: {len(documents)} documents that differ, separated by ---; expected one camera")
    return documents[0]
