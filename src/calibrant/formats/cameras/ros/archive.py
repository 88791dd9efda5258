"""camera_calibration's archive, calibrationdata.tar.gz: ost.yaml, or left.yaml and right.yaml, ost.txt, and pictures.

It is read as a stream, nothing is unpacked: members are known by their names alone, wherever they would be put, and no
more is decompressed than an archive of pictures holds (they hardly shrink).
"""

from __future__ import annotations

import gzip
import tarfile
import zlib
from collections.abc import Iterator
from contextlib import closing
from io import BufferedIOBase

from calibrant.data import CalibrationResult
from calibrant.errors import InputError
from calibrant.formats.cameras.ros.camera_info import Info, info_of, is_camera_info
from calibrant.formats.cameras.ros.ini import infos_in
from calibrant.formats.cameras.ros.pairs import cameras_of
from calibrant.formats.documents.document import CONTENT, Document
from calibrant.formats.documents.opencv_storage import read_yaml_documents
from calibrant.formats.exchange.exchange_format import ExchangeFormat, ReadOptions
from calibrant.reading.files import DOCUMENT, decoded, open_file
from calibrant.reading.notes import note

_GZIP = b"\x1f\x8b"
_TAR, _TAR_AT = b"ustar", 257
_SIDES = ("left.yaml", "right.yaml")
_ONE, _INI = "ost.yaml", "ost.txt"
_WANTED = (*_SIDES, _ONE, _INI)
_PICTURES = (".png", ".jpg", ".jpeg", ".pgm", ".ppm")
_SWELLS = 8
_SPARE = 4_000_000
"""Bytes that may come out of an archive: so many times its own, and these."""
_MOST_MEMBERS = 20_000


class _Bounded:
    """A stream that refuses to give more than so many bytes."""

    def __init__(self, stream: BufferedIOBase, most: int) -> None:
        self._stream, self._left = stream, most

    def read(self, size: int) -> bytes:
        data = self._stream.read(size)
        self._left -= len(data)
        if self._left < 0:
            raise InputError(f"the archive swells to more than {_SWELLS} times its size; pictures do not")
        return data


def _matches(document: Document) -> bool:
    return document.head.startswith(_GZIP) or document.head[_TAR_AT : _TAR_AT + len(_TAR)] == _TAR


def _read(document: Document, options: ReadOptions) -> CalibrationResult:
    source = str(document.path)
    parts = _parts(document)
    names = _SIDES if all(side in parts for side in _SIDES) else (_ONE,) if _ONE in parts else ()
    if names:
        infos = [_info(parts[name], name, options, source) for name in names]
        fallback = [name.removesuffix(".yaml") for name in names]
    elif _INI in parts:
        infos = infos_in(parts[_INI], source, options)
        fallback = ["left", "right"] if len(infos) == 2 else [f"camera{i}" for i in range(1, len(infos) + 1)]
    else:
        raise InputError(
            f"an archive without {_ONE}, {' and '.join(_SIDES)} or {_INI}: not one of camera_calibration's"
        )
    return cameras_of(infos, fallback, options, source)


def _info(text: str, name: str, options: ReadOptions, source: str) -> Info:
    documents = read_yaml_documents(text, f"{source}: {name}")
    data = documents[0] if len(documents) == 1 else None
    if not isinstance(data, dict) or not is_camera_info(data):
        raise InputError(f"{name} in the archive is no camera_info")
    return info_of(data, options.image_size, f"{source}: {name}", name=name.removesuffix(".yaml"))


def _parts(document: Document) -> dict[str, str]:
    """The texts that are read, by name. Raises: InputError where the archive is damaged, or swells."""
    parts: dict[str, str] = {}
    others: list[str] = []
    pictures = 0
    try:
        for name, data in _members(document):
            if data is not None:
                if name in parts:
                    raise InputError(f"the archive holds {name} twice")
                parts[name] = decoded(data, f"{document.path}: {name}")
            elif name.lower().endswith(_PICTURES):
                pictures += 1
            else:
                others.append(name)
    except (tarfile.TarError, EOFError, OSError, zlib.error, ValueError) as error:
        if parts:
            raise InputError(f"the archive is damaged after {', '.join(parts)} ({error}); make it once more") from None
        raise InputError(f"no archive of camera_calibration, or a damaged one ({error})") from None
    if pictures:
        note(f"{document.path}: {pictures} pictures in it are not read; unpack it to calibrate from them")
    if others:
        note(f"{document.path}: not used: {', '.join(others[:5])}{' …' if len(others) > 5 else ''}")
    return parts


def _members(document: Document) -> Iterator[tuple[str, bytes | None]]:
    """Last part of every file's name, and the content of those that are read."""
    with open_file(document.path, most=CONTENT) as raw:
        most = _SWELLS * document.path.stat().st_size + _SPARE
        stream = gzip.GzipFile(fileobj=raw) if document.head.startswith(_GZIP) else raw
        with closing(tarfile.open(fileobj=_Bounded(stream, most), mode="r|")) as archive:  # type: ignore[call-overload]
            for count, member in enumerate(archive):
                if count >= _MOST_MEMBERS:
                    raise InputError(f"the archive holds more than {_MOST_MEMBERS:,} files; a calibration some hundred")
                if not member.isfile():
                    continue
                name = member.name.rsplit("/", 1)[-1]
                if name not in _WANTED:
                    yield name, None
                    continue
                if member.size > DOCUMENT.size:
                    raise InputError(f"{name} has {member.size / 1e6:,.0f} MB; {DOCUMENT.words} at most")
                content = archive.extractfile(member)
                yield name, b"" if content is None else content.read()


FORMAT = ExchangeFormat(
    name="camera-calibration",
    title="ROS camera_calibration's archive (calibrationdata.tar.gz)",
    suffix=".tar.gz",
    matches=_matches,
    read=_read,
)
