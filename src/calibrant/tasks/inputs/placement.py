"""Places, ranges, angles and noises as people type them on the command line, always with units."""

from __future__ import annotations

import numpy as np

from calibrant.arrays import Array
from calibrant.diagnose.budget.volume import parse_coordinate
from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.targets.lengths import parse_length

_EXAMPLE = "20mm,-60mm,50mm,0deg,0deg,23deg"


def parse_angle(text: str, *, what: str) -> float:
    """Radians of an angle with its unit: 23deg, -0.4rad. Raises: InputError for a bare number or another unit."""
    for unit, scale in (("deg", float(np.deg2rad(1.0))), ("rad", 1.0)):
        if text.strip().endswith(unit):
            try:
                value = float(text.strip().removesuffix(unit))
            except ValueError:
                break
            if np.isfinite(value):
                return value * scale
    raise InputError(f"{what}: {text!r} is not an angle; write a number and its unit, such as 23deg or 0.4rad")


def parse_placement(text: str, *, what: str) -> Array:
    """A transform (4, 4) from x, y, z, roll, pitch, yaw: R = Rz(yaw) Ry(pitch) Rx(roll).

    Raises: InputError for another number of values, or values without units.
    """
    parts = text.split(",")
    if len(parts) != 6:
        raise InputError(f"{what} {text!r}: expected six values x,y,z,roll,pitch,yaw with units, such as {_EXAMPLE}")
    t = [parse_coordinate(p, what=what) for p in parts[:3]]
    roll, pitch, yaw = (parse_angle(p, what=what) for p in parts[3:])
    return se3.make(so3.exp([0, 0, yaw]) @ so3.exp([0, pitch, 0]) @ so3.exp([roll, 0, 0]), t)


def parse_range(text: str, *, what: str) -> tuple[float, float]:
    """Two lengths FROM:TO, metres. Raises: InputError when they are not two lengths, or the larger comes first."""
    parts = text.split(":")
    if len(parts) != 2:
        raise InputError(f"{what} {text!r}: expected a range FROM:TO with units, such as 300mm:800mm")
    low, high = (parse_length(p, what=what) for p in parts)
    if low > high:
        raise InputError(f"{what} {text!r}: the smaller length comes first")
    return low, high


def parse_noise(text: str, *, what: str) -> tuple[float, float]:
    """Noise of a pose, metres and radians, from 0.1mm,0.02deg. Raises: InputError for anything else."""
    parts = text.split(",")
    if len(parts) != 2:
        raise InputError(f"{what} {text!r}: expected a length and an angle, such as 0.1mm,0.02deg")
    metres, radians = parse_length(parts[0], what=what), parse_angle(parts[1], what=what)
    if radians <= 0:
        raise InputError(f"{what} {text!r}: the angle must be above 0")
    return metres, radians
