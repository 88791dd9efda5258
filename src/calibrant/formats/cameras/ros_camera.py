"""ROS camera_info as a format of exchange; what is in it says `ros`."""

from __future__ import annotations

from calibrant.data import CalibrationResult
from calibrant.formats.cameras.described import described_camera
from calibrant.formats.cameras.ros import MODELS, camera_info_text
from calibrant.formats.documents.document import Document
from calibrant.formats.exchange.exchange_format import (
    ExchangeFormat,
    ReadOptions,
    WriteOptions,
    one_camera,
    read_cameras,
)

_MARKS = {"distortion_model", "camera_name", "projection_matrix"}


def _matches(document: Document) -> bool:
    keys = {str(key) for key in document.mapping}
    return bool(keys & _MARKS) and bool(keys & {"camera_matrix", "K", "k"})


def _read(document: Document, options: ReadOptions) -> CalibrationResult:
    name = str(document.mapping.get("camera_name") or "camera")
    return read_cameras({name: described_camera(document.mapping, options.image_size, str(document.path))})


def _write(result: CalibrationResult, options: WriteOptions) -> bytes:
    name, camera = one_camera(result)
    return camera_info_text(camera, name=name).encode()


FORMAT = ExchangeFormat(
    name="camera-info",
    title="ROS camera_info (YAML)",
    suffix=".yaml",
    matches=_matches,
    read=_read,
    write=_write,
    models=MODELS,
)
