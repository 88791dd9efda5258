"""One camera_info, a YAML file or what a topic prints, as a format of exchange; what is in it says `camera_info`."""

from __future__ import annotations

from calibrant.data import CalibrationResult
from calibrant.formats.cameras.ros.camera_info import (
    MODELS,
    camera_info_text,
    info_of,
    is_camera_info,
    note_rectified,
)
from calibrant.formats.documents.document import Document
from calibrant.formats.exchange.exchange_format import (
    ExchangeFormat,
    ReadOptions,
    WriteOptions,
    one_camera,
    read_cameras,
)


def _read(document: Document, options: ReadOptions) -> CalibrationResult:
    info = info_of(document.mapping, options.image_size, str(document.path))
    note_rectified(info, str(document.path))
    return read_cameras({info.name: info.camera})


def _write(result: CalibrationResult, options: WriteOptions) -> bytes:
    name, camera = one_camera(result)
    return camera_info_text(camera, name=name).encode()


FORMAT = ExchangeFormat(
    name="camera-info",
    title="ROS camera_info (YAML)",
    suffix=".yaml",
    matches=lambda document: is_camera_info(document.mapping),
    read=_read,
    write=_write,
    models=MODELS,
)
