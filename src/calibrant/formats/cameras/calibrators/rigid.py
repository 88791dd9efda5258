"""Numbers of a file as rigid transforms, and the other way; what is none is refused by its name in the file."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.formats.cameras.camera_format import numbers
from calibrant.formats.documents.number_text import digits
from calibrant.formats.exchange.rotation_numbers import ROUNDED, rotation_in
from calibrant.geometry import se3, so3

_UNIT = 1e-3
"""How far from 1 the length of a quaternion may be: three digits."""


def from_matrix(value: Any, what: str, *, unit_m: float = 1.0) -> Array:
    """(4, 4), metres, of 12 or 16 numbers row by row. Raises: InputError for what is no rigid transform."""
    M = finite(value, what)
    if M.size not in (12, 16):
        raise InputError(f"{what} holds {M.size} numbers, expected 4x4 or 3x4")
    M = M.reshape(-1, 4)
    if len(M) == 4 and np.abs(M[3] - [0, 0, 0, 1]).max() > ROUNDED:
        raise InputError(f"the last row of {what} is {M[3].tolist()}, expected 0 0 0 1")
    return se3.make(rotation(M[:3, :3], what), unit_m * M[:3, 3])


def from_quaternion(xyzw: Any, translation: Any, what: str) -> Array:
    """(4, 4) of a quaternion (x, y, z, w) and a translation. Raises: InputError where the quaternion is not unit."""
    q, t = finite(xyzw, what), finite(translation, what)
    if q.size != 4 or t.size != 3 or abs(float(np.linalg.norm(q)) - 1) > _UNIT:
        raise InputError(
            f"the quaternion of {what} is {q.tolist()} of length {np.linalg.norm(q):.6g}, expected length 1"
        )
    return se3.make(so3.from_quaternion_wxyz(q[[3, 0, 1, 2]] / np.linalg.norm(q)), t)


def from_vector(rotation_vector: Any, translation: Any, what: str, *, unit_m: float = 1.0) -> Array:
    """(4, 4) of a rotation vector (rad), or the nine numbers of a matrix, and a translation. Raises: InputError."""
    r, t = finite(rotation_vector, f"the rotation of {what}"), finite(translation, f"the translation of {what}")
    if t.size != 3 or r.size not in (3, 9):
        raise InputError(f"{what} has a rotation of {r.size} and a translation of {t.size} numbers, expected 3 each")
    R = so3.exp(r) if r.size == 3 else rotation(r.reshape(3, 3), what)
    return se3.make(R, unit_m * t)


def rotation(R: Array, what: str) -> Array:
    """The rotation nearest to a matrix that is one but for rounding. Raises: InputError for any other."""
    turn = rotation_in(R)
    if turn is None:
        raise InputError(
            f"the rotation of {what} is none (determinant {np.linalg.det(R):.6g}): its rows are not at right angles "
            "with length 1"
        )
    return turn


def finite(value: Any, what: str) -> Array:
    """A flat array of finite numbers. Raises: InputError."""
    found = numbers(value, what)
    if not np.all(np.isfinite(found)):
        raise InputError(f"{what} holds numbers that are not finite")
    return found


def quoted(text: str) -> str:
    """A name between quotes, as YAML, TOML and JSON read it."""
    return json.dumps(text, ensure_ascii=False)


def rows_text(T: Array, indent: str) -> str:
    """A matrix as YAML, one row a line, all digits."""
    return "\n".join(f"{indent}- [{', '.join(map(digits, row))}]" for row in T)
