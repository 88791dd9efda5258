"""One camera in OpenCV's FileStorage as a format of exchange: `Intr.yml`, calibration samples."""

from __future__ import annotations

from calibrant.data import CalibrationResult
from calibrant.formats.cameras.described import described_camera
from calibrant.formats.cameras.opencv import MODELS, intrinsics_text
from calibrant.formats.cameras.opencv_stereo import is_pair
from calibrant.formats.documents.document import Document
from calibrant.formats.exchange.exchange_format import (
    ExchangeFormat,
    ReadOptions,
    WriteOptions,
    one_camera,
    read_cameras,
)

_KEYS = ({"camera_matrix", "distortion_coefficients"}, {"cameraMatrix", "distCoeffs"}, {"K", "kc"}, {"K", "D"})


def _matches(document: Document) -> bool:
    keys = {str(key) for key in document.mapping}
    ros = {"distortion_model", "camera_name", "projection_matrix", "P", "R"}
    return any(pair <= keys for pair in _KEYS) and not keys & ros and not is_pair(document.mapping)


def _read(document: Document, options: ReadOptions) -> CalibrationResult:
    return read_cameras({"camera": described_camera(document.mapping, options.image_size, str(document.path))})


def _write(result: CalibrationResult, options: WriteOptions) -> bytes:
    _, camera = one_camera(result)
    return intrinsics_text(camera, rms_px=result.rms_px, created=result.created or None).encode()


FORMAT = ExchangeFormat(
    name="opencv",
    title="OpenCV FileStorage (camera_matrix, distortion_coefficients; K, kc)",
    suffix=".yml",
    matches=_matches,
    read=_read,
    write=_write,
    models=MODELS,
)
