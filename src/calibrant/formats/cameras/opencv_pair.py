"""OpenCV's file of a stereo pair as a format of exchange; what is in it says `opencv_stereo`.

Its stereo sample leaves two files in a folder, `intrinsics.yml` (M1 D1 M2 D2) and `extrinsics.yml` (R T R1 …): the
folder is read as the pair.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from calibrant.data import CalibrationResult, as_transform
from calibrant.errors import InputError
from calibrant.formats.cameras.described import described_camera
from calibrant.formats.cameras.opencv import MODELS
from calibrant.formats.cameras.opencv_stereo import T_left_right, is_pair, of_pair, pair_names, stereo_text
from calibrant.formats.documents.document import Document
from calibrant.formats.exchange.exchange_format import ExchangeFormat, ReadOptions, WriteOptions, read_cameras

_SAMPLE = ("intrinsics", "extrinsics")
_ENDINGS = (".yml", ".yaml", ".xml")


def _parts(document: Document) -> list[str]:
    """The sample's two files, by name; none where the folder does not hold both."""
    found = [[n for n in sorted(document.names) if n in {f"{stem}{e}" for e in _ENDINGS}] for stem in _SAMPLE]
    return [names[0] for names in found] if all(len(names) == 1 for names in found) else []


def _matches(document: Document) -> bool:
    return is_pair(document.mapping) or bool(_parts(document))


def _data(document: Document) -> Mapping[str, Any]:
    """What the file says, or the folder's two files together. Raises: InputError for a file that is none."""
    if not document.is_folder:
        return document.mapping
    out: dict[str, Any] = {}
    for name in _parts(document):
        part = Document(document.path / name)
        if not part.mapping:
            raise InputError(part.trouble or f"{part.path}: no keys and values in it")
        out |= part.mapping
    return out


def _read(document: Document, options: ReadOptions) -> CalibrationResult:
    data = _data(document)
    names = pair_names(data)
    wanted = names if options.camera is None else (options.camera,)
    cameras = {name: described_camera(of_pair(data, name), options.image_size, str(document.path)) for name in wanted}
    if len(wanted) == 1 or not options.places:
        return read_cameras(cameras)
    place = T_left_right(data, unit_m=options.unit_m)
    return read_cameras(cameras, transforms=(as_transform(*names, place),))


def _write(result: CalibrationResult, options: WriteOptions) -> bytes:
    return stereo_text(result).encode()


FORMAT = ExchangeFormat(
    name="opencv-stereo",
    title="OpenCV stereo pair (FileStorage)",
    suffix=".yml",
    matches=_matches,
    read=_read,
    write=_write,
    models=MODELS,
)
