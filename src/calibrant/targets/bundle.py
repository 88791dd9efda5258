"""Markers fixed to each other anywhere in space: bundles on a plate, cubes, any solid. Their geometry is in a file:

    target: bundle
    dictionary: DICT_APRILTAG_36h11
    markers:
      - {id: 3, side: 50mm, position: [0mm, 80mm, 0mm], rotation_vector_deg: [0, 0, 90]}
      - {id: 4, corners: [[0mm, 0mm, 0mm], [50mm, 0mm, 0mm], [50mm, 50mm, 0mm], [0mm, 50mm, 0mm]]}
    cubes:
      - {side: 60mm, marker: 48mm, ids: [10, 11, 12, 13, 14, 15], position: [0mm, 0mm, 0mm]}

position: of the marker's (cube's) centre in the target's frame, 0 if left out; rotation_vector_deg or quaternion_xyzw:
its turn, none if left out. A marker's own frame: x to the right, y down, z into it. corners: top left, top right,
bottom right, bottom left instead of all these. A cube's ids are those of its faces +x, -x, +y, -y, +z, -z (null for a
face without one); markers on the first four have their tops towards +z, on the last two towards +y.

Points: 4 id + k for corner k of marker id.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.targets.apriltag3 import FAMILIES, tag_name
from calibrant.targets.lengths import format_length, parse_coordinate, parse_length
from calibrant.targets.marker import check_id, marker_art
from calibrant.targets.scale import format_scale, split_scale
from calibrant.targets.target import Artwork, Target
from calibrant.targets.yaml_file import read_yaml

SYNTAX = "bundle:FILE with a YAML file of markers and cubes, such as bundle:cube.yaml"

Corners = tuple[tuple[float, float, float], ...]

_UNIT_SQUARE = np.array([[-0.5, -0.5, 0.0], [0.5, -0.5, 0.0], [0.5, 0.5, 0.0], [-0.5, 0.5, 0.0]])
# Of the faces +x, -x, +y, -y, +z, -z: x, y (down) and z (inwards) of the markers, as columns.
_INWARDS = np.array([[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]], dtype=np.float64)
_DOWN = np.array([[0, 0, -1]] * 4 + [[0, -1, 0]] * 2, dtype=np.float64)
_SQUARENESS = 0.01
"""Corners given one by one may be measured: sides and angles within 1 %."""


@dataclass(frozen=True)
class Bundle(Target):
    """Markers of one dictionary: (id, four corners in metres, target frame); scale: a factor on the file's lengths."""

    kind: ClassVar[str] = "bundle"

    file: str
    dictionary: str
    markers: tuple[tuple[int, Corners], ...]
    scale: float = 1.0

    @cached_property
    def points(self) -> Array:
        """Corners of all markers, (4 n, 3) metres, markers by id."""
        points = self.scale * np.array([corners for _, corners in self.markers], dtype=np.float64).reshape(-1, 3)
        points.setflags(write=False)
        return points

    @property
    def point_ids(self) -> NDArray[np.int64]:
        """4 id + corner."""
        return (4 * np.array([i for i, _ in self.markers], dtype=np.int64)[:, None] + np.arange(4)).ravel()

    @property
    def marker_points(self) -> dict[int, NDArray[np.int64]]:
        """Point ids of the corners of each marker, by the marker's id."""
        return {i: 4 * i + np.arange(4, dtype=np.int64) for i, _ in self.markers}

    @property
    def spec(self) -> str:
        """bundle:FILE."""
        return f"{self.kind}:{self.file}{format_scale(self.scale)}"

    def artwork(self) -> Artwork:
        """The markers with a quiet zone, when all lie upright in one plane.

        Raises: InputError for a solid, whose markers are printed one by one.
        """
        corners = self.points.reshape(-1, 4, 3)
        sides = np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1)
        flat = np.all(np.abs(corners[..., 2]) < 1e-9) and np.all(corners[:, 2, 1] > corners[:, 1, 1])
        if not flat or np.any(np.abs(corners[:, 1, 1] - corners[:, 0, 1]) > 1e-9 * sides):
            raise InputError(
                f"{self.spec}: its markers do not lie upright in one plane; print them one by one, such as "
                f"calibrant target marker:{1e3 * sides[0]:g}mm:{self.dictionary}:{self.markers[0][0]}"
            )
        shapes = tuple(
            marker_art(self.dictionary, i, (float(c[0, 0]), float(c[0, 1])), float(side))
            for (i, _), c, side in zip(self.markers, corners, sides, strict=True)
        )
        beyond = FAMILIES[self.dictionary].margin if self.dictionary in FAMILIES else 0.0
        edge = (beyond + 0.25) * float(sides.max())
        low, high = corners[..., :2].min(axis=(0, 1)) - edge, corners[..., :2].max(axis=(0, 1)) + edge
        return Artwork((float(low[0]), float(low[1]), float(high[0]), float(high[1])), shapes)

    def scaled(self, factor: float) -> Bundle:
        """The same bundle with all lengths times `factor`."""
        return replace(self, scale=self.scale * factor)


def parse(fields: Sequence[str]) -> Bundle:
    """Bundle of a spec's fields after its kind. Raises: InputError naming what the file gets wrong."""
    name, scale = split_scale(fields)
    if not name:
        raise InputError(f"a bundle needs its file: {SYNTAX}")
    content = read_yaml(Path(name))
    if not isinstance(content, Mapping) or not isinstance(content.get("dictionary"), str):
        raise InputError(f"bundle file {name} needs `dictionary: NAME` and a list `markers:` or `cubes:`")
    dictionary = tag_name(content["dictionary"])
    try:
        found = [*_markers(content.get("markers") or ()), *_cubes(content.get("cubes") or ())]
        ids = [check_id(i, dictionary) for i, _ in found]
    except InputError as error:
        raise InputError(f"bundle file {name}: {error}") from None
    if not found:
        raise InputError(f"bundle file {name} holds no markers; add a list `markers:` or `cubes:`")
    if len(set(ids)) < len(ids):
        twice = next(i for i in ids if ids.count(i) > 1)
        raise InputError(f"bundle file {name} gives marker {twice} twice; each id stands for one marker")
    placed = sorted((i, tuple(map(tuple, corners.tolist()))) for i, corners in found)
    return Bundle(name, dictionary, tuple(placed), scale)


def bundle_text(
    tags: Mapping[int, tuple[str, float]], places: Mapping[int, Array | None], sigma_mm: Mapping[int, Array | None]
) -> str:
    """The file of a bundle of markers that were measured: a target's spec, for `parse_target`.

    Args: by id: tags, dictionary and side (metres); places, T_target_marker (4, 4), None for the one whose frame
    is the target's; sigma_mm, of the position along x, y, z, None where nothing says so.
    """
    lines = [
        "# Measured from photos; the frame is that of the first marker: its centre, x to the right, y down, z into it.",
        "target: bundle",
        f"dictionary: {next(iter(tags.values()))[0]}",
        "markers:",
    ]
    for marker, (_, side) in tags.items():
        T, sigma = places.get(marker), sigma_mm.get(marker)
        words = [f"id: {marker}", f"side: {format_length(side)}"]
        if T is not None:
            at = ", ".join(f"{1e3 * v:.5f}mm" for v in T[:3, 3])
            turn = ", ".join(f"{v:.6f}" for v in np.rad2deg(so3.log(T[:3, :3])))
            words += [f"position: [{at}]", f"rotation_vector_deg: [{turn}]"]
        known = "" if sigma is None else f"  # ± {', '.join(f'{v:.2g}' for v in sigma)} mm (1 sigma)"
        lines.append(f"  - {{{', '.join(words)}}}{known}")
    return "\n".join(lines) + "\n"


def _markers(entries: Any) -> Iterator[tuple[int, Array]]:
    for number, entry in enumerate(_list(entries, "markers"), start=1):
        what = f"marker {number}"
        _known(entry, ("id", "side", "corners", "position", "rotation_vector_deg", "quaternion_xyzw"), what)
        if not isinstance(entry.get("id"), int):
            raise InputError(f"{what}: its id is a whole number, got {entry.get('id')!r}")
        if "corners" in entry:
            yield entry["id"], _square(entry["corners"], what)
        else:
            side = parse_length(str(entry.get("side", "")), what=f"{what}: side")
            yield entry["id"], se3.apply(_marker_pose(entry, what), side * _UNIT_SQUARE)


def _cubes(entries: Any) -> Iterator[tuple[int, Array]]:
    for number, entry in enumerate(_list(entries, "cubes"), start=1):
        what = f"cube {number}"
        _known(entry, ("side", "marker", "ids", "position", "rotation_vector_deg", "quaternion_xyzw"), what)
        side = parse_length(str(entry.get("side", "")), what=f"{what}: side")
        marker = parse_length(str(entry.get("marker", "")), what=f"{what}: marker")
        ids = entry.get("ids")
        if not isinstance(ids, list) or len(ids) != 6 or not all(i is None or isinstance(i, int) for i in ids):
            raise InputError(f"{what}: ids are six numbers, of the faces +x, -x, +y, -y, +z, -z (null for none)")
        if marker > side:
            raise InputError(f"{what}: its markers ({1e3 * marker:g} mm) are larger than its faces ({1e3 * side:g} mm)")
        for face, marker_id in enumerate(ids):
            if marker_id is None:
                continue
            y, z = _DOWN[face], _INWARDS[face]
            T_cube_marker = se3.make(np.column_stack([np.cross(y, z), y, z]), -0.5 * side * z)
            yield marker_id, se3.apply(_marker_pose(entry, what) @ T_cube_marker, marker * _UNIT_SQUARE)


def _list(entries: Any, name: str) -> list[Mapping[str, Any]]:
    if not isinstance(entries, list | tuple) or not all(isinstance(e, Mapping) for e in entries):
        raise InputError(f"{name} is a list of mappings, such as - {{id: 3, side: 50mm}}")
    return list(entries)


def _known(entry: Mapping[str, Any], names: Sequence[str], what: str) -> None:
    unknown = [key for key in entry if key not in names]
    if unknown:
        raise InputError(f"{what}: unknown key {unknown[0]!r}; known keys: {', '.join(names)}")


def _marker_pose(entry: Mapping[str, Any], what: str) -> Array:
    """T_target_x (4, 4) of an entry's position and turn."""
    position = _position(entry.get("position", [0, 0, 0]), f"{what}: position")
    if "quaternion_xyzw" in entry:
        x, y, z, w = _numbers(entry["quaternion_xyzw"], 4, f"{what}: quaternion_xyzw")
        if not np.hypot(np.hypot(x, y), np.hypot(z, w)) > 0:
            raise InputError(f"{what}: a quaternion of norm 0 is no rotation")
        return se3.make(so3.from_quaternion_wxyz(np.array([w, x, y, z])), position)
    turn = _numbers(entry.get("rotation_vector_deg", [0, 0, 0]), 3, f"{what}: rotation_vector_deg")
    return se3.make(so3.exp(np.deg2rad(turn)), position)


def _square(corners: Any, what: str) -> Array:
    if not isinstance(corners, list) or len(corners) != 4:
        raise InputError(f"{what}: corners are four positions: top left, top right, bottom right, bottom left")
    p = np.array([_position(c, f"{what}: corner {i + 1}") for i, c in enumerate(corners)])
    side = np.linalg.norm(p[1] - p[0])
    closing = np.linalg.norm(p[0] - p[1] + p[2] - p[3])
    slant = abs(float((p[1] - p[0]) @ (p[3] - p[0])))
    other = np.linalg.norm(p[3] - p[0])
    if not side > 0 or max(closing, abs(side - other), slant / side) > _SQUARENESS * side:
        raise InputError(f"{what}: its corners are no square")
    return p


def _position(value: Any, what: str) -> Array:
    if not isinstance(value, list) or len(value) != 3:
        raise InputError(f"{what}: expected three lengths with their units, such as [0mm, 80mm, 0mm], got {value!r}")
    return np.array([0.0 if v == 0 else parse_coordinate(str(v), what=what) for v in value])


def _numbers(value: Any, count: int, what: str) -> list[float]:
    if not isinstance(value, list) or len(value) != count or not all(isinstance(v, int | float) for v in value):
        raise InputError(f"{what}: expected {count} numbers, got {value!r}")
    return [float(v) for v in value]
