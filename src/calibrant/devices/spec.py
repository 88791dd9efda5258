"""What names a device: `cell:seed=3,arm=ur5e`, `folder:DIR`, `opencv:0`, `ur:192.168.0.10`.

    NAME[:[PLACE][,KEY=VALUE …]]

NAME is a driver's, PLACE a folder, a file, a number or an address; keys are the driver's own.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from typing import TypeVar

from calibrant.errors import InputError

T = TypeVar("T")
_KEY = re.compile(r"(?P<key>[a-z][a-z-]*)=(?P<value>.*)", re.DOTALL)


@dataclass(frozen=True)
class DeviceSpec:
    """A driver's name, the place it opens, and its options by key. text: as it was given, for messages.

    >>> from calibrant.devices.spec import split_spec
    >>> split_spec("cell:seed=3,arm=ur5e").options
    {'seed': '3', 'arm': 'ur5e'}
    """

    driver: str
    place: str = ""
    options: Mapping[str, str] = field(default_factory=dict)
    text: str = ""

    def number(self, key: str, default: float) -> float:
        """The option as a number. Raises: InputError."""
        return self._read(key, default, float, "a number")

    def whole(self, key: str, default: int) -> int:
        """The option as a whole number. Raises: InputError."""
        return self._read(key, default, int, "a whole number")

    def size(self, key: str, default: tuple[int, int]) -> tuple[int, int]:
        """The option as width and height: 1280x720. Raises: InputError."""
        return self._read(key, default, _width_and_height, "a size in pixels, such as 1280x720")

    def one_of(self, key: str, words: Collection[str], default: str) -> str:
        """The option as one of some words. Raises: InputError listing them."""
        said = self.options.get(key, default)
        if said not in words:
            raise InputError(f"{self.text}: {key} is {' or '.join(words)}, got {said!r}")
        return said

    def without(self, *keys: str) -> dict[str, str]:
        """The options but for some."""
        return {key: value for key, value in self.options.items() if key not in keys}

    def need_place(self, what: str) -> str:
        """The place. Raises: InputError where none is given; what: for the message, "a folder: folder:DIR"."""
        if not self.place:
            raise InputError(f"{self.text}: expected {what}")
        return self.place

    def refuse_place(self, example: str) -> None:
        """Raises: InputError where a place is given to a driver that has none."""
        if self.place:
            raise InputError(f"{self.text}: {self.driver} takes options alone, such as {example}; got {self.place!r}")

    def _read(self, key: str, default: T, read: Callable[[str], T], what: str) -> T:
        if key not in self.options:
            return default
        try:
            value = read(self.options[key])
        except ValueError:
            raise InputError(f"{self.text}: {key} is {what}, got {self.options[key]!r}") from None
        if isinstance(value, float) and not abs(value) < float("inf"):
            raise InputError(f"{self.text}: {key} is {what}, got {self.options[key]!r}")
        return value


def split_spec(text: str) -> DeviceSpec:
    """The parts of a spec, whatever the driver. Raises: InputError for one without a name, or an option given twice."""
    driver, _, rest = text.strip().partition(":")
    if not driver:
        raise InputError(f"{text!r} names no device; expected a driver's name first, such as cell or opencv:0")
    places: list[str] = []
    options: dict[str, str] = {}
    for part in rest.split(",") if rest else []:
        found = _KEY.fullmatch(part.strip())
        if found is None:
            if options:  # a value with commas of its own, such as a list
                last = next(reversed(options))
                options[last] = f"{options[last]},{part}"
            else:
                places.append(part)
            continue
        if found["key"] in options:
            raise InputError(f"{text}: {found['key']} is given twice")
        options[found["key"]] = found["value"].strip()
    return DeviceSpec(driver.strip(), ",".join(places).strip(), options, text)


def _width_and_height(text: str) -> tuple[int, int]:
    width, height = (int(v) for v in text.lower().split("x"))
    if min(width, height) < 1:
        raise ValueError(text)
    return width, height
