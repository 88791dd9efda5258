"""Places in MJCF: pos, and one of quat, axisangle, euler, xyaxes, zaxis, in the compiler's angles.

Letters of eulerseq turn about axes that move where they are small and about fixed ones where they are capitals: the
other way round than in SciPy. Vectors and quaternions are normalised. Source: MuJoCo documentation, "XML reference",
compiler (angle, eulerseq) and "Modeling", section "Frame orientations".
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.formats.exchange.rotation_numbers import finite
from calibrant.geometry import rotations, se3

_COUNTS = {"quat": 4, "axisangle": 4, "euler": 3, "xyaxes": 6, "zaxis": 3}
_SHORTEST = 1e-12


@dataclass(frozen=True)
class Angles:
    """How the compiler reads angles: in radians or degrees, and the axes of euler."""

    radians: bool = False
    sequence: str = "xyz"


def angles_of(root: ET.Element, source: str) -> Angles:
    """What the file's compiler elements say, the last of them. Raises: InputError for words that MuJoCo has not."""
    said: dict[str, str] = {}
    for element in root.findall("compiler"):
        said |= {key: value for key, value in element.attrib.items() if key in ("angle", "eulerseq", "coordinate")}
    if said.get("coordinate", "local") != "local":
        raise InputError(f"{source}: coordinate={said['coordinate']!r}; MuJoCo has local coordinates alone since 2.3.3")
    angle, sequence = said.get("angle", "degree"), said.get("eulerseq", "xyz")
    if angle not in ("degree", "radian"):
        raise InputError(f"{source}: angle={angle!r}, expected degree or radian")
    if len(sequence) != 3 or not set(sequence.lower()) <= set("xyz"):
        raise InputError(f"{source}: eulerseq={sequence[:20]!r}, expected three of x y z X Y Z")
    return Angles(angle == "radian", sequence)


def place_of(attributes: Mapping[str, str], angles: Angles, where: str) -> Array:
    """T_parent_element (4, 4), metres. Raises: InputError for two orientations, and numbers that are none."""
    position = finite(attributes.get("pos", "0 0 0").split(), 3, f"{where}: pos")
    given = [key for key in _COUNTS if attributes.get(key, "").strip()]
    if len(given) > 1:
        raise InputError(f"{where}: {given[0]} and {given[1]}; expected one orientation")
    if not given:
        return se3.make(np.eye(3), position)
    (key,) = given
    numbers = finite(attributes[key].split(), _COUNTS[key], f"{where}: {key}")
    return se3.make(_rotation(key, numbers, angles, f"{where}: {key}"), position)


def _rotation(key: str, v: Array, angles: Angles, where: str) -> Array:
    if key == "quat":
        _direction(v, where)
        return rotations.matrix_from_quaternion_wxyz(v)
    if key == "axisangle":
        axis = _direction(v[:3], where)
        return rotations.matrix_from_axis_angle(axis, v[3], unit="rad" if angles.radians else "deg")
    if key == "euler":
        return _euler(v if angles.radians else np.deg2rad(v), angles.sequence)
    if key == "zaxis":
        return _least_turn_of_z(_direction(v, where))
    x = _direction(v[:3], where)
    y = _direction(v[3:] - x * (x @ v[3:]), where)
    return np.stack([x, y, np.cross(x, y)], axis=1)


def _euler(radians: Array, sequence: str) -> Array:
    R: Array = np.eye(3)
    for letter, angle in zip(sequence, radians):
        axis = np.eye(3)["xyz".index(letter.lower())]
        turn = rotations.matrix_from_axis_angle(axis, angle, unit="rad")
        R = R @ turn if letter.islower() else turn @ R
    return R


def _least_turn_of_z(z: Array) -> Array:
    """The least turn that takes (0, 0, 1) to z; half a turn about x where they are opposite."""
    axis = np.cross([0.0, 0.0, 1.0], z)
    sine = float(np.linalg.norm(axis))
    if sine < _SHORTEST:
        axis = np.array([1.0, 0.0, 0.0])
    return rotations.matrix_from_axis_angle(axis, math.atan2(sine, float(z[2])), unit="rad")


def _direction(v: Array, where: str) -> Array:
    length = float(np.linalg.norm(v))
    if length < _SHORTEST:
        raise InputError(f"{where}: {' '.join(f'{x:g}' for x in v)} has no direction")
    return v / length
