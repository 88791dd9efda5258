"""Reading a camera, or a pair, from any known file: what `--camera FILE` takes."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

from calibrant.cameras import Camera
from calibrant.data import CalibrationResult
from calibrant.errors import InputError
from calibrant.formats.bags.camera_info import camera_info_fields, topic_of
from calibrant.formats.cameras.camera_format import Size, size_or_refuse
from calibrant.formats.cameras.described import described_camera
from calibrant.formats.exchange.exchange_format import ReadOptions
from calibrant.formats.exchange.read import read_any

_ANSWER = re.compile(r"--(?:answer \w+=[\w-]+|unit \w+)")
"""What a refusal tells to say."""


def read_camera(path: str | Path, *, image_size: Size | None = None, name: str | None = None) -> Camera:
    """The camera in a file: a result of calibrant, or one of any other program's (`formats.registry`); or under a topic
    of a bag: bag.mcap/camera/camera_info.

    image_size (width, height) px, where the caller knows it: needed by files that do not hold it, checked on others.
    name: which camera, of a file of several; a file's only camera is taken whatever it is called.
    Raises: InputError naming the file, what it holds and which formats are read.
    """
    inside = topic_of(Path(path))
    if inside is not None:
        camera = described_camera(camera_info_fields(*inside), image_size, str(path))
        size_or_refuse(camera.image_size, image_size)
        return camera
    try:
        found = read_any(path, ReadOptions(image_size=image_size, camera=name, places=False))
    except InputError as error:
        raise InputError(f"{error}{_by_convert(str(error), path)}") from error
    try:
        camera = _of_result(found, name)
        size_or_refuse(camera.image_size, image_size)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    return camera


def _by_convert(words: str, path: str | Path) -> str:
    """The command to run first, where a refusal says what to answer: an option that names a file takes no answers."""
    asked = list(dict.fromkeys(_ANSWER.findall(words)))
    if not asked:
        return ""
    command = shlex.join(["calibrant", "convert", str(path), "camera.json"])
    return f". The answer goes with the command that converts: {command} {asked[0]}; then give camera.json instead"


def read_pair(path: str | Path) -> CalibrationResult:
    """A file of two cameras or more and where they are to each other: a result of calibrant, OpenCV's `stereo.yml`,
    or any other program's.

    Raises: InputError naming the file, and what of a pair it does not hold.
    """
    try:
        found = read_any(path)
    except InputError as error:
        raise InputError(f"{error}{_by_convert(str(error), path)}") from error
    if len(found.cameras) > 1 and not found.transforms:
        raise InputError(f"{path}: cameras ({', '.join(found.cameras)}) of which the file does not say where they are")
    return found


def _of_result(result: CalibrationResult, name: str | None) -> Camera:
    """The only camera, whatever it is called, or the one of that name."""
    if len(result.cameras) < 2:
        return result.camera
    listed = ", ".join(result.cameras)
    if name is None:
        raise InputError(f"it holds {len(result.cameras)} cameras, {listed}; say which, or give a file of one camera")
    if name not in result.cameras:
        raise InputError(f"it holds the cameras {listed}, none of them {name!r}")
    return result.cameras[name]
