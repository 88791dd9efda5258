"""How to make a result again: the command with its options, what it ran on, and how to see that nothing changed."""

from __future__ import annotations

import platform
import shlex
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version

from calibrant.data import CalibrationResult
from calibrant.reports.parts.blocks import Column, TextTable
from calibrant.version import __version__

_PARTS = ("numpy", "scipy", "opencv-python-headless", "numba")
"""Libraries whose version may move the last digits."""
_COMMANDS: Mapping[str, tuple[str, str]] = {
    "intrinsics": ("intrinsics", ""),
    "hand-eye": ("hand-eye", "--images"),
    "pose": ("pose", ""),
    "stereo": ("stereo", ""),
    "rig": ("rig", ""),
    "kinematics": ("kinematics", ""),
    "projector": ("projector calibrate", ""),
}
"""The command of a kind, and the option of its photos; empty where they stand without one."""
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
    """The command with the options that the result keeps; where to get files is what was given then."""
    if result.kind not in _COMMANDS:
        return ""
    words, flag = _COMMANDS[result.kind]
    views = result.observations.views if result.observations else ()
    photos = {v.file for v in views if v.file}
    names = [
        str(i["file"]) for i in result.inputs if str(i.get("file", "")) in photos or _is_photo(str(i.get("file", "")))
    ]
    others = [str(i["file"]) for i in result.inputs if str(i.get("file", "")) not in names]
    parts = ["calibrant", words, *([flag] if flag else []), *_named(names)]
    if result.robot_poses is not None and others:
        parts += ["--poses", *_named(others)]
    if result.observations is not None and result.observations.target:
        parts += ["--target", shlex.quote(result.observations.target)]
    for name, value in result.options.items():
        parts += _option(name, value)
    return " ".join(parts)


def _is_photo(file: str) -> bool:
    return file.lower().endswith((".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".pgm", ".heic"))


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
