"""How to make a result again: the command with its options, what it ran on, and how to see that nothing changed."""

from __future__ import annotations

import platform
import shlex
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import PureWindowsPath

from calibrant.data import CalibrationResult
from calibrant.reports.parts.blocks import Column, TextTable
from calibrant.version import __version__

_PARTS = ("numpy", "scipy", "opencv-python-headless", "numba")
"""Libraries whose version may move the last digits."""
_COMMANDS: Mapping[str, str] = {
    "intrinsics": "{photos}",
    "hand-eye": "--images {photos}",
    "pose": "{photos}",
    "stereo": "--{camera} {photos}",
    "rig": "--images {camera}={photos}",
}
"""The options of a kind's photos, for each camera."""
_NO_OPTIONS = {"stereo": frozenset({"reference"})}
"""What a result keeps beside the options of its command."""
_ENDINGS = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".pgm", ".heic")
_MOST_NAMED = 3


def reproduced(result: CalibrationResult) -> TextTable:
    """Command, versions and hashes, as far as the result knows them."""
    rows = [("command", _command(result))]
    if result.version:
        rows.append(("install", f"pip install calibrant=={result.version}"))
    if result.created:
        rows.append(("made", f"{result.created}, calibrant {result.version}"))
    rows.append(("this page", f"calibrant {__version__}, Python {platform.python_version()}, {_libraries()}"))
    if result.inputs:
        rows.append(
            ("input files", f"{len(result.inputs)}, with their SHA-256 above: sha256sum FILE says whether one changed")
        )
    return TextTable("How to reproduce it", (Column(""), Column("")), tuple(row for row in rows if row[1]))


def _command(result: CalibrationResult) -> str:
    """The command with the options that the result keeps; empty for a kind whose files the result does not tell apart.

    Files stand as the result names them: in which folder they lie is for who runs it to say.
    """
    seen = result.observations
    if result.kind not in _COMMANDS or seen is None:
        return ""
    parts = ["calibrant", result.kind]
    cameras = list(dict.fromkeys(v.camera for v in seen.views))
    given = [str(i["file"]) for i in result.inputs if "file" in i]
    known = {PureWindowsPath(v.file).name for v in seen.views if v.file}
    photos = [f for f in given if PureWindowsPath(f).name in known or f.lower().endswith(_ENDINGS)]
    for camera in cameras:
        mine = {PureWindowsPath(v.file or v.id).name for v in seen.views if v.camera == camera}
        files = photos if len(cameras) == 1 else [f for f in photos if PureWindowsPath(f).name in mine]
        if files:
            parts.append(_COMMANDS[result.kind].format(camera=camera, photos=" ".join(_named(files))))
    others = [f for f in given if f not in photos]
    if result.robot_poses is not None and others:
        parts += ["--poses", *_named(others)]
    if seen.target:
        parts += ["--target", shlex.quote(seen.target)]
    for name, value in result.options.items():
        if name not in _NO_OPTIONS.get(result.kind, ()):
            parts += _option(name, value)
    return " ".join(parts)


def _named(files: list[str]) -> list[str]:
    """The files, or the first and last of many: the table above has all."""
    if len(files) <= _MOST_NAMED:
        return [shlex.quote(f) for f in files]
    return [shlex.quote(files[0]), "…", shlex.quote(files[-1])]


def _option(name: str, value: object) -> list[str]:
    """An option as the command line takes it; nothing for one that was not set, or is no text."""
    flag = f"--{name.replace('_', '-')}"
    if value is None or value is False or value == () or value == []:
        return []
    if value is True:
        return [flag]
    if isinstance(value, (list, tuple)):
        return [flag, *(shlex.quote(str(item)) for item in value)]
    return [] if isinstance(value, Mapping) else [flag, shlex.quote(str(value))]


def _libraries() -> str:
    found = []
    for name in _PARTS:
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            continue
    return ", ".join(found)
