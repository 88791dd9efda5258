"""Rotations as numbers in a file, checked before they turn anything."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.geometry import rotations, se3, so3
from calibrant.reading.notes import note

ROUNDED = 1e-4
"""A rotation as people write it down: four digits."""
_NO_QUATERNION = 1e-2
"""How far from 1 a norm may be: 0.707 for the root of a half is 1.5e-4 off, two digits are 4e-3."""
_FEW_DIGITS = 1e-4


def finite(values: Iterable[Any], count: int, where: str) -> Array:
    """`count` finite numbers. Raises: InputError naming `where`, and what stands there."""
    found = list(values)
    try:
        numbers = np.array([float(v) for v in found])
    except (TypeError, ValueError, OverflowError):
        numbers = np.full(1, np.nan)
    if numbers.shape != (count,) or not np.all(np.isfinite(numbers)):
        shown = " ".join(map(str, found))[:80]
        raise InputError(f"{where}: {shown!r}, expected {count} finite numbers")
    return numbers


def rotation_in(M: Array) -> Array | None:
    """The rotation nearest to a matrix (3, 3) that is one but for rounding; None for any other."""
    return so3.nearest(M) if so3.is_rotation(M, tolerance=ROUNDED) else None


def rotation_of_quaternion(xyzw: Array, where: str) -> Array:
    """R (3, 3) of x, y, z, w. Raises: InputError where they are no unit quaternion, and no rounding makes them so."""
    norm = float(np.linalg.norm(xyzw))
    if abs(norm - 1) > _NO_QUATERNION:
        shown = ", ".join(f"{v:g}" for v in xyzw)
        raise InputError(f"{where}: the quaternion x y z w = ({shown}) has a norm of {norm:.4g}, expected 1")
    if abs(norm - 1) > _FEW_DIGITS:
        note(f"{where}: the quaternion has a norm of {norm:.6f}; it was divided by it")
    return rotations.matrix_from_quaternion_xyzw(xyzw)


def pose_of(position: Array, xyzw: Array, where: str) -> Array:
    """T (4, 4), metres, of a position and a quaternion. Raises: as `rotation_of_quaternion`."""
    return se3.make(rotation_of_quaternion(xyzw, where), position)
