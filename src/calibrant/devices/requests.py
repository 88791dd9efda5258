"""What is asked of a robot, checked before anything moves."""

from __future__ import annotations

import numpy as np

from calibrant.arrays import Array
from calibrant.errors import InputError


def checked_speed(speed: float) -> float:
    """A share of the limits. Raises: InputError."""
    if not 0 < speed <= 1:
        raise InputError(f"speed is a share of the limits, above 0 up to 1; got {speed}")
    return float(speed)


def checked_seconds(seconds: float) -> float:
    """Raises: InputError."""
    if not 0 <= seconds < float("inf"):
        raise InputError(f"a time of {seconds} s; expected 0 or more")
    return float(seconds)


def checked_twist(twist: Array) -> Array:
    """(6,) rotation, then translation. Raises: InputError."""
    asked = np.asarray(twist, dtype=np.float64)
    if asked.shape != (6,) or not np.all(np.isfinite(asked)):
        raise InputError(f"a twist is six finite numbers, rotation and translation; got {asked}")
    return asked
