"""A camera file's keys, each spelled one way, and which of them were used: what is left over is refused or said."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from calibrant.errors import InputError
from calibrant.formats.cameras.camera_format import single

_BENDS = re.compile(
    r"dist(?!ance)|coef|radial|tangent|decent|skew|shear|lens|fish|omni|undist|polynom|mirror"
    r"|^(?:xi|alpha|beta|lambda|tau[xy]?|tilt[xy]?|[ksl][1-9]|p[12]|t[xy]|kc|d|model)$"
)
"""Keys that say, or could say, how a lens bends: numbers under them are used or refused."""
_DESCRIBING = {
    *("calibrationtime", "calibrationdate", "date", "time", "created", "cameraname", "name", "id", "serial", "frameid"),
    *("serialnumber", "header", "avgreprojectionerror", "reprojectionerror", "reprojerror", "rms", "nframes", "flags"),
    *("framecount", "nrofframes", "boardwidth", "boardheight", "squaresize", "markersize", "fixaspectratio", "unit"),
    *("aspectratio", "fixprincipalpoint", "zerotangentdist", "flagvalue", "perviewreprojectionerrors", "comment"),
    *("extrinsicparameters", "imagepoints", "gridpoints", "version", "units", "rectificationmatrix", "note"),
    *("projectionmatrix", "p", "r", "skewparams"),
}
"""Keys of the known formats that describe a calibration, or follow from the camera."""


def spelled(name: object) -> str:
    """A key in small letters and digits."""
    return re.sub(r"[^0-9a-z]", "", str(name).lower())


class Fields:
    """Values by their keys' one spelling; remembers which were taken. Raises: InputError for two keys spelled alike."""

    def __init__(self, data: Mapping[Any, Any], *, above: Fields | None = None) -> None:
        self._names: dict[str, str] = {}
        self._values: dict[str, Any] = {}
        self._taken: set[str] = set()
        for name, value in data.items():
            key = spelled(name)
            value = _plain(value)
            if key in self._values and not _same(self._values[key], value):
                raise InputError(f"the keys {self._names[key]!r} and {str(name)!r} mean the same and differ; keep one")
            self._names[key], self._values[key] = str(name), value
        if above is not None:
            # What a wrapper says beside the camera holds for it, unless the camera says it itself.
            for key, value in above._values.items():
                if key not in self._values:
                    self._names[key], self._values[key] = above._names[key], value

    def __contains__(self, key: str) -> bool:
        return key in self._values

    def get(self, key: str) -> Any:
        """The value of a key, None where there is none; it counts as used."""
        self._taken.add(key)
        return self._values.get(key)

    def peek(self, key: str) -> Any:
        """The value of a key, None where there is none, without using it."""
        return self._values.get(key)

    def first(self, keys: Iterable[str]) -> tuple[str, Any] | None:
        """The first of the keys that is there with a value, and its value."""
        for key in keys:
            if self._values.get(key) is not None:
                return key, self.get(key)
        return None

    def matching(self, pattern: re.Pattern[str]) -> dict[str, Any]:
        """Values of keys that match, by key; they count as used where they are asked for with `get`."""
        return {key: value for key, value in self._values.items() if pattern.match(key)}

    def numbers_named(self, names: Iterable[str]) -> dict[str, float]:
        """The single numbers under those of the names that are there. Raises: InputError for what is none."""
        return {name: single(self._values, name) for name in names if self.get(name) is not None}

    def is_flag(self, key: str) -> bool:
        """Whether a value is one word or number."""
        return not isinstance(self._values.get(key), Mapping | list | np.ndarray)

    def name(self, key: str) -> str:
        """A key as the file spells it."""
        return self._names.get(key, key)

    def without(self, key: str) -> None:
        """Forget a key whose value was taken apart."""
        self._values.pop(key, None)

    def spread(self, inner: Mapping[Any, Any]) -> None:
        """Add the keys of a value as if they stood beside it. Raises: InputError for one that is there and differs."""
        for name, value in inner.items():
            key, value = spelled(name), _plain(value)
            if key in self._values and not _same(self._values[key], value):
                raise InputError(f"{str(name)!r} is given twice, and differs; keep one")
            self._names[key], self._values[key] = str(name), value

    def _is_elsewhere(self, key: str) -> bool:
        """Whether a key is of something else: a translation, or a device that has a matrix of its own."""
        if key in ("tx", "ty") and "tz" in self._values:
            return True
        found = _BENDS.search(key)
        device = key[: found.start()] if found else ""
        others = [k for k in self._values if device and k.startswith(device) and k != key and k not in self._taken]
        return any(np.shape(self._values[k]) == (3, 3) for k in others)

    def unused(self) -> list[str]:
        """Keys as the file spells them that were not taken and say something.

        Raises: InputError for one whose numbers could bend the picture.
        """
        out = []
        for key, value in self._values.items():
            if key in self._taken or _says_nothing(value):
                continue
            bending = None if self._is_elsewhere(key) else _bending(key, value, self._names[key])
            if bending is not None:
                raise InputError(
                    f"{bending} could say how the lens bends, and is not a name that is known; without it every pixel "
                    "could be wrong. Expected camera_matrix or fx, fy, cx, cy, with distortion_coefficients in "
                    "OpenCV's order (k1 k2 p1 p2 k3 …), or k1, k2, p1 … by name, and distortion_model; rename or "
                    "remove it"
                )
            if key not in _DESCRIBING:
                out.append(self._names[key])
        return out


def _bending(key: str, value: Any, name: str) -> str | None:
    """The place of numbers that could bend the picture, and what they are; None where there are none."""
    if isinstance(value, Mapping):
        inner = (_bending(spelled(k), _plain(v), f"{name}.{k}") for k, v in value.items() if not _says_nothing(v))
        return next((place for place in inner if place is not None), None)
    numbers = isinstance(value, np.ndarray | list | int | float) and not isinstance(value, bool)
    if key in _DESCRIBING or not numbers or not _BENDS.search(key):
        return None
    flat: list[Any] = np.asarray(value, dtype=object).ravel().tolist()
    return f"{name!r} ({', '.join(str(v)[:12] for v in flat[:5])}{' …' if len(flat) > 5 else ''})"


def _says_nothing(value: Any) -> bool:
    """Whether a value is empty, or nothing but zeros."""
    if isinstance(value, Mapping):
        return all(_says_nothing(v) for v in value.values())
    if isinstance(value, np.ndarray):
        return value.size == 0 or (value.dtype.kind in "fiu" and not value.any())
    if isinstance(value, list):
        return all(_says_nothing(v) for v in value)
    return value is None or value is False or value == "" or (isinstance(value, int | float) and value == 0)


def _plain(value: Any) -> Any:
    """A value with matrices given as rows, cols and data (as ROS and ViSP save them) as arrays."""
    if isinstance(value, Mapping):
        keys = {spelled(k): k for k in value}
        if "data" in keys and set(keys) <= {"rows", "cols", "data", "dt", "typeid"}:
            return _matrix(*(value.get(keys.get(k, "")) for k in ("rows", "cols", "data")))
    return value


def _matrix(rows: Any, cols: Any, data: Any) -> Any:
    try:
        flat = np.asarray(data, dtype=np.float64).ravel()
        shape = [int(n) for n in (rows, cols) if n is not None]
        return flat.reshape(shape) if len(shape) == 2 else flat
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"a matrix of {rows} rows and {cols} columns whose data do not fit ({error})") from None


def _same(a: Any, b: Any) -> bool:
    try:
        return bool(np.array_equal(np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)))
    except (TypeError, ValueError, OverflowError):
        return bool(a is b or (type(a) is type(b) and not isinstance(a, np.ndarray | list | Mapping) and a == b))
