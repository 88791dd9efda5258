"""Values of options that hold for one camera of several or for all: left:k3, right=wide.yml, brown."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from calibrant.errors import InputError

_NAMED = re.compile(r"^(?P<name>[A-Za-z_][\w-]*)=(?P<value>.+)$")


def _of(value: str, names: Sequence[str]) -> tuple[str, str]:
    """The camera that a value names, "" for none, and the value."""
    match = re.match(rf"^(?P<name>{'|'.join(map(re.escape, names))})[:=](?P<value>.+)$", value)
    return (match["name"], match["value"]) if match else ("", value)


def one_by_camera(values: Sequence[str], names: Sequence[str], *, option: str, every: str = "all") -> dict[str, str]:
    """One value a camera: a plain one is that of the cameras that have none of their own.

    Args: names, of the cameras; every, what all of them are called. Raises: InputError for two values of one camera.
    """
    own: dict[str, str] = {}
    plain: str | None = None
    for value in values:
        key, text = ("", value) if Path(value).exists() else _of(value, names)
        if key in own or (not key and plain is not None):
            raise InputError(f"{option} {value}: {'the ' + key + ' camera' if key else every} has one already")
        if key:
            own[key] = text
        else:
            plain = text
    return own if plain is None else {name: own.get(name, plain) for name in names}


def files_by_camera(values: Sequence[str], names: Sequence[str], *, option: str) -> dict[str, Path]:
    """Files of the cameras that are named. Raises: InputError for one without a camera."""
    plain = next((v for v in values if not _of(v, names)[0]), None)
    if plain is not None:
        raise InputError(f"{option} {plain}: say of which camera: {' or '.join(f'{n}={plain}' for n in names[:2])}")
    return {name: Path(file) for name, file in one_by_camera(values, names, option=option).items()}


def several_by_camera(
    values: Sequence[str], names: Sequence[str], *, option: str, every: str = "all"
) -> dict[str, tuple[str, ...]]:
    """Any number of values a camera, separated by commas; a plain one holds on all: left:k3,right:focal, aspect.

    Raises: InputError where a plain one follows one of a camera in the same word, which may be meant either way.
    """
    out: dict[str, list[str]] = {name: [] for name in names}
    for word in values:
        before = ""
        for value in (v.strip() for v in word.split(",") if v.strip()):
            name, text = _of(value, names)
            if not name and before:
                raise InputError(
                    f"{option} {word}: is {value!r} of the {before} camera or of {every}? Write {before}:{value}, or "
                    f"{option} {value} apart"
                )
            before = name
            for camera in [name] if name else names:
                out[camera].append(text)
    return {name: tuple(found) for name, found in out.items()}


def images_by_camera(values: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Images of each camera by the name before them: left=DIR. Raises: InputError for images without a name."""
    out: dict[str, tuple[str, ...]] = {}
    for value in values:
        match = None if Path(value).exists() else _NAMED.match(value)
        if match is None:
            raise InputError(f"--images {value}: say of which camera, such as left={value}")
        out[match["name"]] = (*out.get(match["name"], ()), match["value"])
    return out


def boards_by_name(values: Sequence[str]) -> dict[str, str]:
    """Specs of boards by the name before them: front=SPEC. Raises: InputError for one without, or a name twice."""
    out: dict[str, str] = {}
    for value in values:
        match = _NAMED.match(value)
        if match is None:
            raise InputError(f"--board {value}: a board has a name here, such as front={value}")
        if match["name"] in out:
            raise InputError(f"--board {value}: there is a board {match['name']} already; each has a name of its own")
        out[match["name"]] = match["value"]
    return out
