"""One camera's configuration for the running system: its topics, its frames, the board, and what is to be done with it.

    name: wrist
    ros: 1
    image: /wrist/image_raw
    camera_info: /wrist/camera_info
    tf: base_link:tool0
    target: charuco:5x7:36mm:18mm:DICT_6X6_250
    views: 15
    session: wrist-session

A camera beside the robot that is located through the wrist camera, by the dynamic method, says `through`:

    through: {image: /wrist/image_raw, result: wrist-session/result.json}
    window: 30
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from calibrant.errors import InputError

SETUPS = ("auto", "eye-in-hand", "eye-to-hand")
LEAST_VIEWS = 3
_KEYS = {
    *("name", "ros", "image", "camera_info", "camera", "tf", "target", "setup", "frame", "views", "session", "window"),
    *("through", "python"),
}
_THROUGH = {"image", "result"}


@dataclass(frozen=True, kw_only=True)
class Through:
    """The wrist camera: its image topic, and its hand-eye result."""

    image: str
    result: Path


@dataclass(frozen=True, kw_only=True)
class CameraConfig:
    """name: the camera's, in results and topics. ros: 1 or 2. image, camera_info: topics; camera: a file in place of
    the latter; base, tool: tf frames; frame: the camera's optical frame, by default that of its pictures; views: how
    many samples are taken; session: the folder for them; window: views that the live estimate looks back on; python:
    the interpreter that has ROS."""

    name: str
    ros: int
    image: str
    base: str
    tool: str
    target: str
    session: Path
    camera_info: str | None = None
    camera: Path | None = None
    setup: str = "auto"
    frame: str | None = None
    views: int = 15
    window: int = 30
    through: Through | None = None
    python: str = "/usr/bin/python3"

    @property
    def pictures(self) -> tuple[str, ...]:
        """Every image topic."""
        return (self.image,) if self.through is None else (self.image, self.through.image)


def read_config(path: Path, *, window: int | None = None) -> CameraConfig:
    """The configuration in a YAML file; files in it are beside it. window: in place of the file's.

    Raises: InputError naming the key that is missing, unknown, or of no use.
    """
    from calibrant.formats.documents.document import Document
    from calibrant.reading.files import open_file
    from calibrant.targets.registry import parse_target

    open_file(path, what="configuration").close()
    document = Document(path)
    if document.trouble is not None:
        raise InputError(document.trouble)
    data = document.mapping
    try:
        config = _config(data, path.parent, window)
        parse_target(config.target)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    return config


def _config(data: Mapping[str, Any], folder: Path, window: int | None) -> CameraConfig:
    _known(data, _KEYS, "")
    base, colon, tool = _word(data, "tf").partition(":")
    if not (base and colon and tool):
        raise InputError(f"tf is {data['tf']!r}; expected the frames BASE:TOOL, such as base_link:tool0")
    name = _word(data, "name")
    setup = str(data.get("setup", "auto"))
    if setup not in SETUPS:
        raise InputError(f"setup is {setup!r}; expected {', '.join(SETUPS)}")
    ros = _count(data, "ros", 1, 1)
    if ros > 2:
        raise InputError(f"ros is {ros}; expected 1 or 2")
    config = CameraConfig(
        name=name,
        ros=ros,
        image=_word(data, "image"),
        base=base,
        tool=tool,
        target=_word(data, "target"),
        session=folder / str(data.get("session", f"{name}-session")),
        camera_info=None if data.get("camera_info") is None else _word(data, "camera_info"),
        camera=None if data.get("camera") is None else folder / _word(data, "camera"),
        setup=setup,
        frame=None if data.get("frame") is None else _word(data, "frame"),
        views=_count(data, "views", 15, LEAST_VIEWS),
        window=_count(data, "window", 30, 1) if window is None else window,
        through=_through(data.get("through"), folder),
        python=str(data.get("python", CameraConfig.python)),
    )
    if config.through is not None and config.camera is None and config.camera_info is None:
        raise InputError("a camera that is located through the wrist's needs its lens: camera_info, or camera: FILE")
    return config


def _through(value: Any, folder: Path) -> Through | None:
    if value is None:
        return None
    if not isinstance(value, Mapping):
        raise InputError(f"through is {str(value)[:60]!r}; expected the wrist camera's image and result")
    _known(value, _THROUGH, "through.")
    return Through(image=_word(value, "image"), result=folder / _word(value, "result"))


def _known(data: Mapping[str, Any], keys: set[str], where: str) -> None:
    strange = next((str(key) for key in data if str(key) not in keys), None)
    if strange is not None:
        raise InputError(f"unknown key {where}{strange}; keys: {', '.join(sorted(keys))}")


def _word(data: Mapping[str, Any], key: str) -> str:
    value = data.get(key)
    if not isinstance(value, str) or not value.strip():
        raise InputError(f"{key} is {'missing' if value is None else repr(value)}; expected a text")
    return value.strip()


def _count(data: Mapping[str, Any], key: str, default: int, least: int) -> int:
    value = data.get(key, default)
    if not isinstance(value, int) or isinstance(value, bool) or value < least:
        raise InputError(f"{key} is {value!r}; expected a whole number, {least} or more")
    return value
