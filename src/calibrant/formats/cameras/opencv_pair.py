"""OpenCV's file of a stereo pair as a format of exchange; what is in it says `opencv_stereo`."""

from __future__ import annotations

from calibrant.data import CalibrationResult, as_transform
from calibrant.errors import InputError
from calibrant.formats.cameras.described import described_camera
from calibrant.formats.cameras.opencv import MODELS
from calibrant.formats.cameras.opencv_stereo import T_left_right, is_pair, of_pair, pair_names, stereo_text
from calibrant.formats.documents.document import Document
from calibrant.formats.exchange.exchange_format import ExchangeFormat, ReadOptions, WriteOptions, read_cameras


def _read(document: Document, options: ReadOptions) -> CalibrationResult:
    data = document.mapping
    names = pair_names(data)
    wanted = names if options.camera is None else (options.camera,)
    cameras = {name: described_camera(of_pair(data, name), options.image_size, str(document.path)) for name in wanted}
    if len(wanted) == 1 or not options.places:
        return read_cameras(cameras)
    place = T_left_right(data, unit_m=options.unit_m)
    return read_cameras(cameras, transforms=(as_transform(*names, place),))


def _write(result: CalibrationResult, options: WriteOptions) -> bytes:
    if len(result.cameras) != 2:
        raise InputError(f"OpenCV's stereo file holds two cameras, the result has {len(result.cameras)}")
    return stereo_text(result).encode()


FORMAT = ExchangeFormat(
    name="opencv-stereo",
    title="OpenCV stereo pair (FileStorage)",
    suffix=".yml",
    matches=lambda document: is_pair(document.mapping),
    read=_read,
    write=_write,
    models=MODELS,
)
