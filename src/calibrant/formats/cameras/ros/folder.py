"""A folder of camera_info files, one a camera, as a format of exchange: left.yaml and right.yaml, in any names."""

from __future__ import annotations

from pathlib import Path

from calibrant.data import CalibrationResult
from calibrant.errors import InputError
from calibrant.formats.cameras.ros.camera_info import MODELS, Info, camera_info_text, info_of, is_camera_info
from calibrant.formats.cameras.ros.pairs import cameras_of, infos_to_write
from calibrant.formats.documents.document import Document
from calibrant.formats.exchange.exchange_format import ExchangeFormat, ReadOptions, WriteOptions

_SUFFIXES = (".yaml", ".yml")
_MOST = 32
"""YAML files that a folder of cameras may hold: each is looked into."""
_SIDES = ("left", "right")


def _files(document: Document) -> list[Document]:
    """The YAML files in the folder, where they are few."""
    names = sorted(name for name in document.names if Path(name).suffix.lower() in _SUFFIXES)
    files = [document.path / name for name in names if (document.path / name).is_file()]
    return [] if len(files) > _MOST else [Document(path) for path in files]


def _infos(document: Document) -> list[Document]:
    return [file for file in _files(document) if is_camera_info(file.mapping)]


def _read(document: Document, options: ReadOptions) -> CalibrationResult:
    files = _infos(document)
    if not files:
        raise InputError("no camera_info in the folder; expected left.yaml and right.yaml, or others alike")
    infos: list[Info] = []
    for file in files:
        try:
            infos.append(info_of(file.mapping, options.image_size, str(file.path), name=file.path.stem))
        except InputError as error:
            raise InputError(f"{file.path.name}: {error}") from error
    return cameras_of(infos, [file.path.stem for file in files], options, str(document.path))


def _write(result: CalibrationResult, options: WriteOptions) -> dict[str, bytes]:
    infos = infos_to_write(result)
    return {
        f"{side}.yaml": camera_info_text(info.camera, name=info.name, rectified=info.rectified).encode()
        for side, info in zip(_SIDES, infos)
    }


FORMAT = ExchangeFormat(
    name="camera-info-pair",
    title="ROS camera_info of a rectified pair (folder with left.yaml, right.yaml)",
    suffix="",
    matches=lambda document: bool(_infos(document)),
    read=_read,
    write=_write,
    models=MODELS,
)
