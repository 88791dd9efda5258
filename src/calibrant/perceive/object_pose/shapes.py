"""Objects of known shape: a box by its sides, or any surface of triangles; with the turns that change nothing.

A box's frame stands in its middle, x, y, z along the sides in the order given. A mesh keeps the frame of its file. The
symmetries T_object_same are the proper rigid motions after which the object looks as before: of a box with three
different sides the half turns about its axes (4 with standing still), 8 with two equal ones, 24 of a cube.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property
from itertools import permutations, product
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.geometry import se3, so3

_UNITS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254}
_BOX = re.compile(r"(\d+(?:\.\d+)?)x(\d+(?:\.\d+)?)x(\d+(?:\.\d+)?)(mm|cm|m|in)")
_LENGTH = re.compile(r"(\d+(?:\.\d+)?)(mm|cm|m|in)")
FORMS = "box:54x37x5mm, cube:40mm, mesh:part.stl:mm"
EQUAL = 1e-9
"""Metres: sides typed in as the same number are equal; what differs by design is a different side."""
SAME_SURFACE = 0.005
"""Of the object's size: a turn that moves the surface by less is taken as a symmetry. Tessellation moves it by that
much (a circle of 32 corners by 0.5 % of its radius)."""
_FOLDS = (2, 3, 4, 5, 6, 8, 12)
_POINTS, _FEW_POINTS = 600, 40
_SAME_TURN = 0.02
"""Radians: nearer turns are one and the same, found twice."""
_ODD_ANGLE = 0.37
"""Radians, no small fraction of a turn: a surface that it leaves alone is one of revolution."""


@dataclass(frozen=True, eq=False)
class Shape:
    """A surface. vertices (n, 3), metres; triangles (m, 3) counterclockwise from outside; symmetries (s, 4, 4), the
    first the identity; axis: of revolution, a unit vector, where it has one; sides (3,), of a box."""

    name: str
    vertices: Array
    triangles: NDArray[np.int64]
    symmetries: Array
    axis: Array | None = None
    sides: Array | None = None

    @cached_property
    def normals(self) -> Array:
        """Of the triangles (m, 3), unit, outwards."""
        a, b, c = np.moveaxis(self.vertices[self.triangles], 1, 0)
        n = np.cross(b - a, c - a)
        return n / np.maximum(np.linalg.norm(n, axis=1, keepdims=True), 1e-30)

    @cached_property
    def offsets(self) -> Array:
        """normal . x of the points x of each triangle (m,), metres."""
        return np.sum(self.normals * self.vertices[self.triangles[:, 0]], axis=1)

    @cached_property
    def size(self) -> float:
        """The longest distance within it, along its axes' diagonal, metres."""
        return float(np.linalg.norm(np.ptp(self.vertices, axis=0)))

    @cached_property
    def middle(self) -> Array:
        """(3,) of its bounding box."""
        return (self.vertices.min(axis=0) + self.vertices.max(axis=0)) / 2

    @cached_property
    def edges(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Edges (e, 2) of vertices and their triangles (e, 2), -1 where there is one alone; inner edges of flat faces
        are left out."""
        found: dict[tuple[int, int], list[int]] = {}
        for k, (a, b, c) in enumerate(self.triangles.tolist()):
            for i, j in ((a, b), (b, c), (c, a)):
                found.setdefault((min(i, j), max(i, j)), []).append(k)
        rows = [(pair, (t[0], t[1] if len(t) > 1 else -1)) for pair, t in found.items()]
        pairs = np.array([p for p, _ in rows], dtype=np.int64)
        sides = np.array([t for _, t in rows], dtype=np.int64)
        flat = (sides[:, 1] >= 0) & (np.sum(self.normals[sides[:, 0]] * self.normals[sides[:, 1]], axis=1) > 1 - 1e-9)
        return pairs[~flat], sides[~flat]


def box(sides: ArrayLike, *, name: str = "box") -> Shape:
    """A box of three sides, metres.

    >>> len(box([0.054, 0.037, 0.005]).symmetries), len(box([0.04, 0.04, 0.04]).symmetries)
    (4, 24)
    """
    s = np.asarray(sides, dtype=np.float64)
    if s.shape != (3,) or not np.all(np.isfinite(s) & (s > 0)):
        raise InputError(f"a box has three sides above 0, metres, got {s.tolist()}")
    corners = np.array(list(product((-0.5, 0.5), repeat=3))) * s
    quads = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    triangles = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    turns = [se3.make(R, np.zeros(3)) for R in axis_turns() if np.all(np.abs(np.abs(R) @ s - s) <= EQUAL)]
    return Shape(name, corners, triangles, np.array(turns), sides=s)


def axis_turns() -> list[Array]:
    """The 24 rotations that bring axes onto axes, standing still first."""
    out = []
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            R = np.zeros((3, 3))
            R[range(3), order] = signs
            if np.linalg.det(R) > 0:
                out.append(R)
    return sorted(out, key=lambda R: -float(np.trace(R)))


def mesh(vertices: ArrayLike, triangles: ArrayLike, *, name: str = "mesh") -> Shape:
    """A surface of triangles, metres; its symmetries are found."""
    v, t = np.asarray(vertices, dtype=np.float64), np.asarray(triangles, dtype=np.int64)
    corners = v[t]
    if np.sum(np.cross(corners[:, 1], corners[:, 2]) * corners[:, 0]) < 0:
        t = t[:, ::-1]  # the volume is negative: the triangles run the other way
    bare = Shape(name, v, np.ascontiguousarray(t), np.eye(4)[None])
    turns, axis = _symmetries(bare)
    return Shape(name, v, bare.triangles, turns, axis)


def parse_shape(spec: str) -> tuple[Shape, str]:
    """The shape of a text, and in words how it was read: "box:54x37x5mm", "cube:40mm", "mesh:part.stl[:mm]".

    A mesh without a unit is in millimetres where its size is above 2, in metres else. Raises: InputError.
    """
    kind, _, rest = spec.partition(":")
    if kind == "box" and (m := _BOX.fullmatch(rest)):
        return box(np.array([float(x) for x in m.groups()[:3]]) * _UNITS[m.group(4)]), f"box of {rest}"
    if kind == "cube" and (m := _LENGTH.fullmatch(rest)):
        side = float(m.group(1)) * _UNITS[m.group(2)]
        return box([side] * 3, name="cube"), f"cube of {rest}"
    if kind == "mesh" and rest:
        from calibrant.formats.meshes.read import read_mesh

        path, _, unit = rest.rpartition(":")
        if unit not in _UNITS or not path:
            path, unit = rest, ""
        found = read_mesh(path)
        size = float(np.linalg.norm(np.ptp(found.vertices, axis=0)))
        chosen = unit or ("mm" if size > 2 else "m")
        words = f"{Path(path).name}, {len(found.triangles)} triangles, {size * _UNITS[chosen] * 1e3:.4g} mm across"
        if not unit:
            words += f", taken as {chosen} (say mesh:{path}:m or :mm)"
        return mesh(found.vertices * _UNITS[chosen], found.triangles, name=Path(path).stem), words
    raise InputError(f"{spec!r} is no object; expected one of {FORMS}, with a unit")


def _symmetries(shape: Shape) -> tuple[Array, Array | None]:
    """Turns about the surface's own axes that leave it where it is, and the axis of one of revolution."""
    from scipy.spatial import cKDTree

    centre, spread = _moments(shape)
    points, dense = surface_points(shape, _POINTS) - centre, cKDTree(surface_points(shape, 20 * _POINTS) - centre)
    spacing = np.asarray(dense.query(points)[0], dtype=np.float64)
    limit = SAME_SURFACE * shape.size + 3 * float(np.median(spacing))

    def same(R: Array) -> bool:
        # A few points tell most of what is none.
        few = np.max(dense.query(points[:_FEW_POINTS] @ R.T)[0]) <= 2 * limit
        return bool(few and np.quantile(dense.query(points @ R.T)[0], 0.98) <= limit)

    frames = _frames(shape, spread)
    revolution = next((axis for F in frames for axis in F.T if same(so3.exp(_ODD_ANGLE * axis))), None)
    found = [F @ R @ F.T for F in frames for R in axis_turns()]
    if revolution is None:
        found += [
            so3.exp(2 * np.pi * k / n * axis) for F in frames for axis in F.T for n in _FOLDS for k in range(1, n)
        ]
    kept: list[Array] = [np.eye(3)]
    for R in found:
        # Turns about the axis are no choice: what is left is whether it stands upside down.
        if revolution is not None and (len(kept) == 2 or R @ revolution @ revolution > -1 + 1e-9):
            continue
        if all(np.linalg.norm(so3.log(R @ K.T)) > _SAME_TURN for K in kept) and same(R):
            kept.append(R)
    return se3.make(np.array(kept), np.array([centre - R @ centre for R in kept])), revolution


def _moments(shape: Shape) -> tuple[Array, Array]:
    """Centre (3,) and covariance (3, 3) of the surface, exactly."""
    v = shape.vertices[shape.triangles]
    area = np.linalg.norm(np.cross(v[:, 1] - v[:, 0], v[:, 2] - v[:, 0]), axis=1)
    area /= area.sum()
    centre = area @ v.mean(axis=1)
    v = v - centre
    total = v.sum(axis=1)
    second = np.einsum("n,ni,nj->ij", area, total, total) + np.einsum("n,nki,nkj->ij", area, v, v)
    return centre, second / 12


def _frames(shape: Shape, spread: Array) -> list[Array]:
    """Frames (3, 3) whose axes may be axes of symmetry: the principal ones, and those of its two largest flat sides,
    which decide where principal axes are no axes (a cube's)."""
    _, axes = np.linalg.eigh(spread)
    out = [axes if np.linalg.det(axes) > 0 else axes * [1, 1, -1]]
    v = shape.vertices[shape.triangles]
    area = np.linalg.norm(np.cross(v[:, 1] - v[:, 0], v[:, 2] - v[:, 0]), axis=1)
    of: dict[tuple[float, ...], float] = {}
    for n, a in zip(np.round(shape.normals, 4).tolist(), area.tolist()):
        of[tuple(n)] = of.get(tuple(n), 0.0) + a
    by_area = [np.array(n) for n in sorted(of, key=lambda n: -of[n])]
    first = by_area[0] / np.linalg.norm(by_area[0])
    second = next((n for n in by_area if abs(n @ first) < 1e-3), None)
    if second is not None:
        second = second - first * (second @ first)
        second /= np.linalg.norm(second)
        out.append(np.stack([first, second, np.cross(first, second)], axis=1))
    return out


def surface_points(shape: Shape, count: int) -> Array:
    """(count, 3) points spread over the surface by area, the same each time."""
    a, b, c = np.moveaxis(shape.vertices[shape.triangles], 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    generator = np.random.default_rng(0)
    which = generator.choice(len(area), size=count, p=area / area.sum())
    s, t = generator.random((2, count))
    flip = s + t > 1
    s, t = np.where(flip, 1 - s, s)[:, None], np.where(flip, 1 - t, t)[:, None]
    return np.asarray(a[which] + s * (b - a)[which] + t * (c - a)[which])
