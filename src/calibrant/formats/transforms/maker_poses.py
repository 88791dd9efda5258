"""One transform as a pose in the notation of a robot's maker, in its own text where it has one.

Units, rotation and order are those by which calibrant reads the maker's poses (`formats.poses.makers`, which names the
manuals): what is written here is read with `--robot-format` as the same pose.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from calibrant.arrays import Array
from calibrant.data import CalibrationResult
from calibrant.formats.documents.number_text import text_of
from calibrant.formats.exchange.exchange_format import ExchangeFormat, WriteOptions
from calibrant.formats.poses.makers import FORMATS as MAKERS
from calibrant.formats.poses.makers import RobotFormat
from calibrant.formats.transforms.one import the_transform
from calibrant.geometry import rotations

_MM = 1e3


def numbers_of(T: Array, fmt: RobotFormat) -> list[float]:
    """A pose (4, 4), metres, as the maker's columns of numbers."""
    said = fmt.options
    if said.rotation == "matrix":  # by columns, as libfranka has it
        return [float(v) for v in T.T.ravel()]
    R, position = T[:3, :3], T[:3, 3] * (_MM if said.units == "mm" else 1.0)
    if said.rotation == "rotvec":
        turn = rotations.rotation_vector_from_matrix(R, unit="rad")
    elif said.rotation == "quat-wxyz":
        turn = rotations.quaternion_wxyz_from_matrix(R)
    else:
        turn = rotations.euler_from_matrix(R, order=said.rotation.removeprefix("euler:"), unit="deg")
    return [float(v) for v in np.concatenate([position, turn])]


def _ur(values: Sequence[str]) -> str:
    return f"p[{', '.join(values)}]"


def _kuka(values: Sequence[str]) -> str:
    return "{" + ", ".join(f"{name} {value}" for name, value in zip("XYZABC", values)) + "}"


def _fanuc(values: Sequence[str]) -> str:
    units = ("mm", "mm", "mm", "deg", "deg", "deg")
    return ", ".join(f"{name} = {value} {unit}" for name, value, unit in zip("XYZWPR", values, units))


def _abb(values: Sequence[str]) -> str:
    return f"[[{', '.join(values[:3])}], [{', '.join(values[3:])}]]"


_TEXTS: Mapping[str, Callable[[Sequence[str]], str]] = {"ur": _ur, "kuka": _kuka, "fanuc": _fanuc, "abb": _abb}


def pose_text(T: Array, maker: str) -> str:
    """A pose (4, 4), metres, as the maker's controller takes it; numbers alone where it has no text of its own."""
    fmt = MAKERS[maker]
    # A controller's language knows no exponent: what is smaller than its last digit is 0.
    values = [_plain(v) for v in numbers_of(T, fmt)]
    return _TEXTS[maker](values) if maker in _TEXTS else ", ".join(values)


def _plain(value: float) -> str:
    (text,) = text_of([value])
    return np.format_float_positional(float(text), trim="0") if "e" in text else text


def _write(maker: str, result: CalibrationResult, options: WriteOptions) -> bytes:
    return (pose_text(the_transform(result, options).T, maker) + "\n").encode()


def _format(maker: str) -> ExchangeFormat:
    return ExchangeFormat(
        name=f"{maker}-pose",
        title=f"pose as {MAKERS[maker].maker} writes it",
        suffix=f".{maker}.txt",
        matches=lambda document: False,  # poses are read where poses are asked for
        write=partial(_write, maker),
    )


UR, FRANKA, KUKA, FANUC, ABB, YASKAWA, STAUBLI, KAWASAKI = map(_format, MAKERS)
