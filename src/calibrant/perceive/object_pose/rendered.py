"""A shape as a camera sees it: the triangle behind every pixel, and the silhouette.

Edges are drawn straight between their projected ends: a lens that bends them by part of a pixel moves no association.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array, Mask
from calibrant.cameras import Camera
from calibrant.geometry import se3
from calibrant.perceive.object_pose.shapes import Shape

SPACING_PX = 1.5
"""Between the samples of a silhouette: nearer, blurred pixels tell the same twice."""
CORNER_PX = 3.5
"""So near to a corner the profile across one edge meets the other; of short edges a quarter is left out at each end."""
SHORT_PX = 4.0
"""Edges of boxes shorter than this are all corner: 1 px from one, blur of 0.7 px moves the half-way point inwards by
0.1 px, at the corner by a pixel."""
SHARP_RAD = 0.3
"""Faces that meet at less than 17 degrees look alike on both sides of their edge."""
_MOST_CREASES = 200
_OWN_PX = 1e-3
_FEW_EDGES = 16
_SECTORS = 16
_OUTSIDE_PX = 1.5
"""Beside an edge, where its two sides are looked up: the nearest pixel whose neighbour is not the edge's own."""


@dataclass(frozen=True, eq=False)
class Silhouette:
    """Samples of the outline. points (n, 3), object's frame; uv (n, 2), where they are seen; outward (n, 2), unit, in
    the picture; side (n,): samples of one number share the errors of their edge; strips, seconds (n,): how far inside
    the outline the first and the second crease are, px, infinity for none.
    """

    points: Array
    uv: Array
    outward: Array
    side: NDArray[np.int64]
    strips: Array
    seconds: Array

    def only(self, keep: Mask) -> Silhouette:
        """The samples where keep (n,) is true."""
        return Silhouette(
            self.points[keep],
            self.uv[keep],
            self.outward[keep],
            self.side[keep],
            self.strips[keep],
            self.seconds[keep],
        )


def visible_triangles(shape: Shape, camera: Camera, T_camera_object: Array) -> NDArray[np.int64]:
    """The triangle (h, w) that each pixel sees, -1 for none."""
    from calibrant.perceive.object_pose import rendered_kernels

    width, height = camera.image_size
    p = se3.apply(T_camera_object, shape.vertices)
    nearest, index = np.zeros((height, width)), np.full((height, width), -1, dtype=np.int64)
    if np.all(p[:, 2] > 0):
        seen = np.column_stack([camera.project(p), 1 / p[:, 2]])
        rendered_kernels.draw(np.ascontiguousarray(seen[shape.triangles]), nearest, index)
    return index


def outline(shape: Shape, camera: Camera, T_camera_object: Array, index: NDArray[np.int64]) -> Silhouette:
    """The silhouette's samples: edges between a triangle that is seen and one that is not, before the background.

    index: as `visible_triangles` gives it.
    """
    edges, sides = shape.edges
    centre = -T_camera_object[:3, :3].T @ T_camera_object[:3, 3]
    front = shape.normals @ centre > shape.offsets
    facing = np.where(sides >= 0, front[sides], False)
    chosen = np.flatnonzero(facing[:, 0] != facing[:, 1])
    points, inner, side = [], [], []
    for number, e in enumerate(chosen.tolist()):
        a, b = shape.vertices[edges[e]]
        ends = camera.project(se3.apply(T_camera_object, np.stack([a, b])))
        length = float(np.linalg.norm(ends[1] - ends[0]))
        n = max(int(length / SPACING_PX), 1) if np.isfinite(length) else 0
        if len(chosen) <= _FEW_EDGES and length < SHORT_PX:
            n = 0
        s = (np.arange(n) + 0.5)[:, None] / max(n, 1)
        if len(chosen) <= _FEW_EDGES and n:
            end = min(CORNER_PX / length, 0.25)
            s = end + (1 - 2 * end) * s
        points.append(a + s * (b - a))
        seen = shape.triangles[sides[e, 0 if facing[e, 0] else 1]]
        third = shape.vertices[next(v for v in seen if v not in edges[e])]
        inner.append(np.tile(third - a, (n, 1)))
        side.append(np.full(n, number))
    if not points:
        none = np.zeros((0, 2))
        return Silhouette(np.zeros((0, 3)), none, none, np.zeros(0, dtype=np.int64), none[:, 0], none[:, 0])
    X, toward, number_of = np.concatenate(points), np.concatenate(inner), np.concatenate(side)
    along = np.repeat(
        shape.vertices[edges[chosen, 1]] - shape.vertices[edges[chosen, 0]], [len(p) for p in points], axis=0
    )
    uv, normal = _normals(camera, T_camera_object, X, along, toward, 1e-3 * shape.size)
    keep = np.isfinite(uv).all(axis=1) & np.isfinite(normal).all(axis=1) & _before_background(index, uv, normal)
    if len(chosen) > _FEW_EDGES:
        number_of = np.floor((np.arctan2(normal[:, 1], normal[:, 0]) / np.pi + 1) * _SECTORS / 2 * 0.999999)
    creases = edges[facing.all(axis=1) & (_bends(shape, sides) > SHARP_RAD)]
    inward = _crossed(camera.project(se3.apply(T_camera_object, shape.vertices[creases])), uv[keep], -normal[keep])
    return Silhouette(X[keep], uv[keep], normal[keep], number_of[keep].astype(np.int64), inward[:, 0], inward[:, 1])


def _bends(shape: Shape, sides: NDArray[np.int64]) -> Array:
    """Angle (e,) between the triangles of each edge, rad."""
    cosine = np.sum(shape.normals[sides[:, 0]] * shape.normals[sides[:, 1]], axis=1)
    return np.where(sides[:, 1] >= 0, np.arccos(np.clip(cosine, -1, 1)), 0.0)


def _crossed(segments: Array, uv: Array, inward: Array) -> Array:
    """How far (n, 2) rays from pixels run until they cross a first and a second of the segments (k, 2, 2)."""
    out = np.full((len(uv), max(len(segments), 2)), np.inf)
    for k, (a, b) in enumerate(segments[:_MOST_CREASES]):
        d = b - a
        across = inward[:, 0] * d[1] - inward[:, 1] * d[0]
        with np.errstate(divide="ignore", invalid="ignore"):
            s = ((a - uv)[:, 0] * d[1] - (a - uv)[:, 1] * d[0]) / across
            t = ((a - uv)[:, 0] * inward[:, 1] - (a - uv)[:, 1] * inward[:, 0]) / across
            # Ends belong to it, and a little more: the strip does not end at a corner.
            out[:, k] = np.where((s > _OWN_PX) & (t > -0.02) & (t < 1.02), s, np.inf)
    return np.sort(out, axis=1)[:, :2]


def _normals(camera: Camera, T: Array, X: Array, along: Array, toward: Array, step: float) -> tuple[Array, Array]:
    """Pixels (n, 2) of points and the unit normals of their edges in the picture, away from `toward`."""
    size = np.linalg.norm(along, axis=1, keepdims=True)
    inside = np.linalg.norm(toward, axis=1, keepdims=True)
    uv, ahead, within = (
        camera.project(se3.apply(T, p))
        for p in (X, X + step * along / np.maximum(size, 1e-30), X + step * toward / np.maximum(inside, 1e-30))
    )
    t = ahead - uv
    n = np.stack([-t[:, 1], t[:, 0]], axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        n /= np.linalg.norm(n, axis=1, keepdims=True)
        return uv, n * -np.sign(np.sum(n * (within - uv), axis=1, keepdims=True))


def _before_background(index: NDArray[np.int64], uv: Array, n: Array) -> Mask:
    """Where the pixel outside an edge sees nothing of the object, within the picture."""
    height, width = index.shape
    at = np.rint(np.nan_to_num(uv + _OUTSIDE_PX * n, nan=-1.0)).astype(np.int64)
    inside = (at >= 0).all(axis=1) & (at[:, 0] < width) & (at[:, 1] < height)
    out = np.zeros(len(uv), dtype=np.bool_)
    out[inside] = index[at[inside, 1], at[inside, 0]] < 0
    return out
