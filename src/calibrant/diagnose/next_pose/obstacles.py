"""What a robot must not hit, and whether it does: spheres along its links against boxes, spheres and a floor.

A file of geometry (YAML) gives lengths with their units, in the base frame:

    link_radius: 60mm
    floor: 0mm
    boxes:
      - {from: [400mm, -300mm, 0mm], to: [600mm, -200mm, 300mm]}
    spheres:
      - {centre: [0mm, 500mm, 400mm], radius: 100mm}

The arm is a chain of capsules of one radius between joints, from the second joint on: the first stands in the base.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calibrant.arrays import Array
from calibrant.diagnose.budget.volume import parse_coordinate
from calibrant.errors import InputError
from calibrant.robots.chain import KinematicChain
from calibrant.robots.geometry import ParametricChain
from calibrant.targets.lengths import parse_length
from calibrant.targets.yaml_file import read_yaml

_SPACING = 0.5
"""Spheres along a link, in radii: half a radius apart they miss no more than 3 % of the radius between them."""
_KEYS = ("link_radius", "floor", "boxes", "spheres")


@dataclass(frozen=True)
class Box:
    """An upright box in the base frame, corners (x, y, z), metres."""

    lower: tuple[float, float, float]
    upper: tuple[float, float, float]

    def distance(self, p: Array) -> Array:
        """Distance (...,) of points (..., 3) from the box, 0 inside."""
        outside = np.maximum(np.maximum(np.array(self.lower) - p, p - np.array(self.upper)), 0.0)
        return np.asarray(np.linalg.norm(outside, axis=-1))


@dataclass(frozen=True)
class Sphere:
    """A sphere in the base frame, metres."""

    centre: tuple[float, float, float]
    radius: float

    def distance(self, p: Array) -> Array:
        """Distance (...,) of points (..., 3) from the sphere, below 0 inside."""
        return np.asarray(np.linalg.norm(p - np.array(self.centre), axis=-1) - self.radius)


@dataclass(frozen=True)
class Geometry:
    """What stands in the cell, and how thick the arm's links are, metres."""

    obstacles: tuple[Box | Sphere, ...] = ()
    link_radius: float = 0.0
    floor: float | None = None

    def clear(self, chain: KinematicChain, q: ArrayLike) -> NDArray[np.bool_]:
        """Whether the arm touches nothing at joint values q (..., n): (...,). Raises: InputError for other chains."""
        if not isinstance(chain, ParametricChain):
            raise InputError("this robot's description does not say where its links are; collisions cannot be checked")
        p = self._spheres(chain, q)
        free = np.ones(p.shape[:-2], dtype=np.bool_)
        for obstacle in self.obstacles:
            free &= np.all(obstacle.distance(p) > self.link_radius, axis=-1)
        if self.floor is not None:
            free &= np.all(p[..., 2] > self.floor + self.link_radius, axis=-1)
        return free

    def _spheres(self, chain: ParametricChain, q: ArrayLike) -> Array:
        """Centres (..., m, 3) along the links, from the second joint to the flange."""
        corners = np.concatenate([chain.link_frames(q)[..., :3, 3], chain.forward(q)[..., None, :3, 3]], axis=-2)
        corners = corners[..., 1:, :]
        # As many spheres a link as the longest of all poses needs.
        longest = np.linalg.norm(np.diff(corners, axis=-2), axis=-1).reshape(-1, corners.shape[-2] - 1).max(axis=0)
        step = max(_SPACING * self.link_radius, 0.01)  # thin links are walked in centimetres
        parts = [
            corners[..., i, None, :] + np.linspace(0, 1, 2 + int(length / step))[:, None] * (b - a)[..., None, :]
            for i, length in enumerate(longest)
            for a, b in [(corners[..., i, :], corners[..., i + 1, :])]
        ]
        return np.concatenate(parts, axis=-2)


def read_geometry(path: Path) -> Geometry:
    """The geometry of a YAML file. Raises: InputError naming the file, the key and what was expected."""
    data = read_yaml(path, what="geometry file")
    if not isinstance(data, Mapping):
        raise InputError(f"{path}: expected YAML with {', '.join(_KEYS)}")
    unknown = [str(k) for k in data if k not in _KEYS]
    if unknown:
        raise InputError(f"{path}: unknown key {unknown[0]!r}; known keys: {', '.join(_KEYS)}")
    boxes = [_box(b, f"{path}: boxes[{i}]") for i, b in enumerate(_list(data, "boxes", path))]
    spheres = [_sphere(s, f"{path}: spheres[{i}]") for i, s in enumerate(_list(data, "spheres", path))]
    radius = parse_length(str(data.get("link_radius", "")), what=f"{path}: link_radius")
    floor = data.get("floor")
    height = None if floor is None else parse_coordinate(str(floor), what=f"{path}: floor")
    return Geometry((*boxes, *spheres), radius, height)


def _list(data: Mapping[str, Any], key: str, path: Path) -> Sequence[Any]:
    value = data.get(key) or []
    if not isinstance(value, list):
        raise InputError(f"{path}: {key} is a list, one entry an obstacle")
    return value


def _two_fields(entry: object, where: str, names: tuple[str, str]) -> tuple[Any, Any]:
    if not isinstance(entry, Mapping) or set(entry) != set(names):
        raise InputError(f"{where}: expected the keys {names[0]} and {names[1]}")
    return entry[names[0]], entry[names[1]]


def _point(value: object, where: str) -> tuple[float, float, float]:
    if not isinstance(value, list) or len(value) != 3:
        raise InputError(f"{where}: expected three lengths [x, y, z] with units, such as [400mm, -300mm, 0mm]")
    x, y, z = (parse_coordinate(str(v), what=where) for v in value)
    return x, y, z


def _box(entry: object, where: str) -> Box:
    low, high = _two_fields(entry, where, ("from", "to"))
    lower, upper = _point(low, f"{where}.from"), _point(high, f"{where}.to")
    if any(a > b for a, b in zip(lower, upper)):
        raise InputError(f"{where}: 'from' is the corner with the smaller x, y and z")
    return Box(lower, upper)


def _sphere(entry: object, where: str) -> Sphere:
    centre, radius = _two_fields(entry, where, ("centre", "radius"))
    return Sphere(_point(centre, f"{where}.centre"), parse_length(str(radius), what=f"{where}.radius"))
