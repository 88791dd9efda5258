"""COLMAP's sparse model: a folder of cameras and images, text or binary.

    x_camera = R(q) x_world + t,   q = (w, x, y, z);   pixels from the image's corner

(https://colmap.github.io/format.html). A folder that holds `sparse` or `sparse/0` is looked into; so is a lone
cameras.txt or cameras.bin. Pictures become views, the world their target; the rigs of newer versions the transforms
between their cameras. Its lengths have no unit but the one that is said.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, TransformEstimate, as_transform
from calibrant.errors import InputError
from calibrant.formats.cameras.foreign_lens import ASKS
from calibrant.formats.cameras.photogrammetry.colmap_files import (
    CameraRow,
    ImageRow,
    SensorRow,
    binaries,
    cameras_of_bytes,
    cameras_of_text,
    images_of_bytes,
    images_of_text,
    rigs_of_bytes,
    rigs_of_text,
    texts,
)
from calibrant.formats.cameras.photogrammetry.colmap_models import BY_NAME, WRITTEN, Model, camera_of, model_of
from calibrant.formats.cameras.photogrammetry.pictures import (
    Picture,
    check_lengths,
    check_quaternions,
    pictures_of,
    result_of,
    unit_of,
)
from calibrant.formats.documents.document import Document
from calibrant.formats.exchange.exchange_format import ExchangeFormat, ReadOptions, WriteOptions, Written, answer
from calibrant.geometry import se3, so3
from calibrant.reading.notes import note, note_unused

_WITHIN = ("sparse", "sparse/0", "0", "colmap/sparse/0")
"""Where a project of COLMAP, and of those that build on it, keeps its model."""
_UNUSED = ("points3D", "frames")
_FORMS = ("text", "binary")
_READERS: dict[str, tuple[Callable[[str], list[Any]], Callable[[bytes], list[Any]]]] = {
    "cameras": (cameras_of_text, cameras_of_bytes),
    "images": (images_of_text, images_of_bytes),
    "rigs": (rigs_of_text, rigs_of_bytes),
}


def _folder(document: Document) -> Document | None:
    """The folder with the cameras: this one, or the one that COLMAP makes within."""
    if not document.is_folder:
        return None
    for inner in (document, *(Document(document.path / name) for name in _WITHIN)):
        if {"cameras.txt", "cameras.bin"} & inner.names:
            return inner
    return None


def _matches(document: Document) -> bool:
    if document.is_folder:
        return _folder(document) is not None
    if document.path.name == "cameras.bin":
        return document.text is None
    words = (line.split() for line in (document.text or "")[:4096].splitlines() if not line.startswith("#"))
    first = next((w for w in words if w), [])
    return len(first) > 4 and first[0].isdecimal() and first[1] in BY_NAME


def _read(document: Document, options: ReadOptions) -> CalibrationResult:
    source = str(document.path)
    if not document.is_folder:
        rows = cameras_of_text(document.text) if document.text is not None else cameras_of_bytes(document.content)
        return result_of(_cameras(rows, source, options), (), options)
    folder = _folder(document)
    if folder is None:
        raise InputError("no cameras.txt or cameras.bin in it, nor in sparse/0")
    cameras = _cameras(_rows(folder, "cameras"), source, options)
    if not options.places:
        return result_of(cameras, (), options)
    images, rigs = _rows(folder, "images"), _rows(folder, "rigs")
    note_unused(source, sorted(name for name in folder.names if name.partition(".")[0] in _UNUSED))
    unit = unit_of(options, source) if images or rigs else 1.0
    pictures = _pictures(images, cameras, unit)
    return result_of(cameras, pictures, options, transforms=_rig(rigs, cameras, unit))


def _rows(folder: Document, what: str) -> list[Any]:
    """The rows of one file, binary where there are both: it has all digits. Raises: InputError naming the file."""
    for suffix, reader in ((".bin", 1), (".txt", 0)):
        if what + suffix not in folder.names:
            continue
        file = Document(folder.path / (what + suffix))
        try:
            if reader:
                return _READERS[what][1](file.content)
            if file.text is None:
                raise InputError("a binary file; expected text")
            return _READERS[what][0](file.text)
        except InputError as error:
            raise InputError(f"{file.path}: {error}") from error
    return []


def _cameras(rows: Sequence[CameraRow], source: str, options: ReadOptions) -> dict[str, Camera]:
    cameras: dict[str, Camera] = {}
    for row in rows:
        if str(row.number) in cameras:
            raise InputError(f"two cameras have the number {row.number}")
        try:
            cameras[str(row.number)] = camera_of(row.model, row.width, row.height, row.values, options)
        except InputError as error:
            raise InputError(f"camera {row.number}: {error}") from error
    if not cameras:
        raise InputError(f"{source}: no camera in it")
    return cameras


def _pictures(rows: Sequence[ImageRow], cameras: dict[str, Camera], unit: float) -> list[Picture]:
    if not rows:
        return []
    missing = next((row for row in rows if str(row.camera) not in cameras), None)
    if missing is not None:
        raise InputError(f"{missing.name} is of camera {missing.camera}; cameras: {', '.join(cameras)}")
    names = [row.name for row in rows]
    q, t = np.array([row.q for row in rows]), np.array([row.t for row in rows])
    check_quaternions(q, names)
    check_lengths(t, names)
    places = se3.make(so3.from_quaternion_wxyz(q), unit * t)
    return [Picture(row.name, str(row.camera), T) for row, T in zip(rows, places)]


def _rig(rows: Sequence[SensorRow], cameras: dict[str, Camera], unit: float) -> tuple[TransformEstimate, ...]:
    """T_reference_camera of each camera of a rig."""
    found: list[TransformEstimate] = []
    for row in rows:
        parent, child = str(row.reference), str(row.camera)
        if row.q is None or row.t is None or not {parent, child} <= set(cameras):
            continue
        name = f"camera {child} of rig {row.rig}"
        check_quaternions(np.array([row.q]), (name,))
        check_lengths(np.array([row.t]), (name,))
        T = se3.make(so3.from_quaternion_wxyz(row.q), unit * np.array(row.t))
        found.append(as_transform(parent, child, se3.inverse(T)))
    return tuple(found)


def _write(result: CalibrationResult, options: WriteOptions) -> Written:
    if not result.cameras:
        raise InputError("no camera to write")
    number = _numbers(list(result.cameras))
    cameras = [(number[name], *_row_of(camera)) for name, camera in result.cameras.items()]
    unit = options.unit_m or 1.0
    binary = answer(options.answers, "form", _FORMS) == "binary"
    images = [
        ImageRow(
            i,
            tuple(so3.quaternion_wxyz(p.T_camera_world[:3, :3]).tolist()),
            tuple((p.T_camera_world[:3, 3] / unit).tolist()),
            number[p.camera],
            p.name if binary else _word(p.name),
        )
        for i, p in enumerate(pictures_of(result), 1)
    ]
    return binaries(cameras, images) if binary else texts(cameras, images)


def _word(name: str) -> str:
    """COLMAP reads no blank within a name of its text form."""
    word = "_".join(name.split())
    if word != name:
        note(f"COLMAP's text form has no blanks in names: {name!r} is written {word!r}; --choose form=binary keeps it")
    return word


def _row_of(camera: Camera) -> tuple[Model, int, int, tuple[float, ...]]:
    model, values = model_of(camera)
    width, height = camera.image_size
    return model, width, height, values


def _numbers(names: list[str]) -> dict[str, int]:
    """COLMAP's cameras have numbers, from 1."""
    if all(name.isdecimal() and name == str(int(name)) and 0 < int(name) < 2**32 - 1 for name in names):
        return {name: int(name) for name in names}
    number = {name: i for i, name in enumerate(names, 1)}
    note(f"COLMAP's cameras have numbers for names: {', '.join(f'{i} is {name}' for name, i in number.items())}")
    return number


FORMAT = ExchangeFormat(
    name="colmap",
    title="COLMAP sparse model (folder of cameras and images)",
    suffix="",
    matches=_matches,
    read=_read,
    write=_write,
    models=tuple(WRITTEN),
    asks={**ASKS, "form": f"what is written: {' or '.join(_FORMS)}"},
)
