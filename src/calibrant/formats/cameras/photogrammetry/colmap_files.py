"""The files of COLMAP's sparse model, text and binary, as plain rows (https://colmap.github.io/format.html).

Numbers of the binary form are little-endian. Points are passed over, their counts checked.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

from calibrant.errors import InputError
from calibrant.formats.cameras.photogrammetry.colmap_models import BY_NUMBER, Model
from calibrant.formats.documents.number_text import row_of

_LONGEST_NAME = 4096


class CameraRow(NamedTuple):
    """A camera as it stands in the file."""

    number: int
    model: str
    width: int
    height: int
    values: tuple[float, ...]


class ImageRow(NamedTuple):
    """A picture as it stands in the file: q (w, x, y, z) and t of T_camera_world."""

    number: int
    q: tuple[float, ...]
    t: tuple[float, ...]
    camera: int
    name: str


class SensorRow(NamedTuple):
    """A camera of a rig: q, t of T_camera_reference, None for the reference itself or where it is not known."""

    rig: int
    reference: int
    camera: int
    q: tuple[float, ...] | None
    t: tuple[float, ...] | None


class _Bytes:
    """Bytes taken one after the other. Raises: InputError where they end too soon."""

    def __init__(self, data: bytes) -> None:
        self.data, self.at = data, 0

    def take(self, form: str) -> tuple[Any, ...]:
        form = "<" + form
        size = struct.calcsize(form)
        if self.at + size > len(self.data):
            raise InputError("the file ends in the middle of an entry")
        out = struct.unpack_from(form, self.data, self.at)
        self.at += size
        return out

    def name(self) -> str:
        end = self.data.find(b"\0", self.at, self.at + _LONGEST_NAME)
        if end < 0:
            raise InputError("a name without an end")
        text = self.data[self.at : end].decode("utf-8", "replace")
        self.at = end + 1
        return text

    def skip(self, size: int) -> None:
        if size > len(self.data) - self.at:
            raise InputError("the file ends in the middle of an entry")
        self.at += size

    def count(self, least: int) -> int:
        """How many entries follow, each of `least` bytes or more."""
        (n,) = self.take("Q")
        if n * least > len(self.data) - self.at:
            raise InputError(f"{n} entries are announced, the file is too short for them")
        return int(n)

    def end(self) -> None:
        if self.at != len(self.data):
            raise InputError(f"{len(self.data) - self.at} bytes are left over")


def cameras_of_bytes(data: bytes) -> list[CameraRow]:
    """cameras.bin."""
    stream, rows = _Bytes(data), []
    for _ in range(stream.count(24)):
        number, model, width, height = stream.take("IiQQ")
        if model not in BY_NUMBER:
            raise InputError(f"camera {number}: a model of the number {model}, which is none of COLMAP's")
        values = stream.take(f"{len(BY_NUMBER[model].terms)}d")
        rows.append(CameraRow(number, BY_NUMBER[model].name, width, height, values))
    stream.end()
    return rows


def images_of_bytes(data: bytes) -> list[ImageRow]:
    """images.bin."""
    stream, rows = _Bytes(data), []
    for _ in range(stream.count(73)):
        number, *pose, camera = stream.take("I7dI")
        name = stream.name()
        stream.skip(24 * stream.count(24))
        rows.append(ImageRow(number, tuple(pose[:4]), tuple(pose[4:]), camera, name))
    stream.end()
    return rows


def rigs_of_bytes(data: bytes) -> list[SensorRow]:
    """rigs.bin: of the sensors its cameras (kind 0)."""
    stream, rows = _Bytes(data), []
    for _ in range(stream.count(8)):
        rig, sensors = stream.take("II")
        kind, reference = stream.take("iI") if sensors else (-1, 0)
        for _ in range(max(0, sensors - 1)):
            kind_of, camera, known = stream.take("iIB")
            pose = stream.take("7d") if known else ()
            if kind == kind_of == 0:
                rows.append(SensorRow(rig, reference, camera, pose[:4] or None, pose[4:] or None))
    stream.end()
    return rows


def _lines(text: str) -> Iterator[tuple[int, str]]:
    for number, line in enumerate(text.splitlines(), 1):
        if not line.startswith("#"):
            yield number, line.strip()


def _row(line: str, number: int, what: str, parse: Callable[[list[str]], Any], parts: int = -1) -> Any:
    try:
        return parse(line.split(maxsplit=parts))
    except (ValueError, IndexError):
        raise InputError(f"line {number} is no {what}: {line[:80]!r}") from None


def cameras_of_text(text: str) -> list[CameraRow]:
    """cameras.txt: CAMERA_ID MODEL WIDTH HEIGHT PARAMS…"""

    def parse(words: list[str]) -> CameraRow:
        return CameraRow(int(words[0]), words[1], int(words[2]), int(words[3]), tuple(map(float, words[4:])))

    return [_row(line, n, "camera (ID MODEL WIDTH HEIGHT PARAMS)", parse) for n, line in _lines(text) if line]


def images_of_text(text: str) -> list[ImageRow]:
    """images.txt: IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, each followed by a line of its points, or an empty one.

    Files without these second lines are read as well.
    """
    rows, after = [], False
    for number, line in _lines(text):
        if after and _are_points(line):
            after = False
        elif line:
            rows.append(_row(line, number, "image (ID QW QX QY QZ TX TY TZ CAMERA_ID NAME)", _image, 9))
            after = True
    return rows


def _image(words: list[str]) -> ImageRow:
    pose = tuple(map(float, words[1:8]))
    return ImageRow(int(words[0]), pose[:4], pose[4:], int(words[8]), words[9])


def _are_points(line: str) -> bool:
    """Whether a line holds X Y POINT3D_ID by the three; an image's has a name in the tenth place."""
    words = line.split(maxsplit=9)
    if not words:
        return True
    try:
        [float(word) for word in (*words[:9], *(words[9].split(maxsplit=1)[:1] if len(words) > 9 else ()))]
    except ValueError:
        return False
    return len(words) % 3 == 0 or len(words) > 9


def rigs_of_text(text: str) -> list[SensorRow]:
    """rigs.txt: RIG_ID NUM_SENSORS REF_TYPE REF_ID, then TYPE ID HAS_POSE [QW QX QY QZ TX TY TZ] of each other."""
    rows: list[SensorRow] = []

    def parse(words: list[str]) -> None:
        rig, sensors = int(words[0]), int(words[1])
        at = 4
        for _ in range(max(0, min(sensors, len(words)) - 1)):
            kind, camera, known = words[at], int(words[at + 1]), int(words[at + 2])
            pose = tuple(map(float, words[at + 3 : at + 10])) if known else ()
            if known and len(pose) != 7:
                raise ValueError
            at += 10 if known else 3
            if kind == words[2] == "CAMERA":
                rows.append(SensorRow(rig, int(words[3]), camera, pose[:4] or None, pose[4:] or None))

    for number, line in _lines(text):
        if line:
            _row(line, number, "rig", parse)
    return rows


def texts(
    cameras: Sequence[tuple[int, Model, int, int, tuple[float, ...]]], images: Sequence[ImageRow]
) -> dict[str, bytes]:
    """cameras.txt, images.txt and points3D.txt."""
    first = ["# Camera list with one line of data per camera:", "#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]"]
    first += [f"{n} {model.name} {w} {h} {row_of(values)}" for n, model, w, h, values in cameras]
    second = [
        "# Image list with two lines of data per image:",
        "#   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME",
        "#   POINTS2D[] as (X, Y, POINT3D_ID)",
    ]
    for image in images:
        second += [f"{image.number} {row_of((*image.q, *image.t))} {image.camera} {image.name}", ""]
    third = ["# 3D point list with one line of data per point:"]
    names = ("cameras.txt", "images.txt", "points3D.txt")
    return {name: ("\n".join(lines) + "\n").encode() for name, lines in zip(names, (first, second, third))}


def binaries(
    cameras: Sequence[tuple[int, Model, int, int, tuple[float, ...]]], images: Sequence[ImageRow]
) -> dict[str, bytes]:
    """cameras.bin, images.bin and points3D.bin."""
    first = [struct.pack("<Q", len(cameras))]
    for n, model, w, h, values in cameras:
        first.append(struct.pack(f"<IiQQ{len(values)}d", n, model.number, w, h, *values))
    second = [struct.pack("<Q", len(images))]
    for image in images:
        second.append(struct.pack("<I7dI", image.number, *image.q, *image.t, image.camera))
        second.append(image.name.encode() + b"\0" + struct.pack("<Q", 0))
    return {
        "cameras.bin": b"".join(first),
        "images.bin": b"".join(second),
        "points3D.bin": struct.pack("<Q", 0),
    }
