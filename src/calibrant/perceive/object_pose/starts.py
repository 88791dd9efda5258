"""First guesses of an object's pose: standing on the table with any face down, in any turn; or any turn at all.

Structure leaves few: a thing that lies still rests on a face of its convex hull above which its middle stands, so that
two of three turns follow from the table's plane; the third is tried in steps. Each guess is put where its outline's
middle is that of the segment, and judged by how far outline and segment overlap and how well depths agree.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array, Mask
from calibrant.cameras import Camera
from calibrant.geometry import se3, so3
from calibrant.opencv import cv2
from calibrant.perceive.object_pose.rendered import visible_triangles
from calibrant.perceive.object_pose.shapes import Shape, axis_turns
from calibrant.perceive.registered_depth.planes import Plane

Place = Callable[[Array, Array], Array]
"""Where the object's origin is (3,) on a ray with z = 1, in a turn (3, 3)."""
TURNS = 24
"""Of 15 degrees about the table's normal: a refinement that starts within half of it finds the edges."""
FREE_TURNS = 400
"""Rotations in no order: the nearest is within some 25 degrees."""
_DOWN = 8
_HULL_POINTS = 400


@dataclass(frozen=True, eq=False)
class Guess:
    """A pose and its score: overlap (intersection over union) less what depths disagree by, of the object's size."""

    T_camera_object: Array
    score: float
    contact: Array


def resting(shape: Shape) -> list[tuple[Array, Array]]:
    """Rotations R_table_object (z up) in which it can stand, and the vertices (c, 3) that touch; likely ones first."""
    from scipy.spatial import ConvexHull

    hull = ConvexHull(shape.vertices)
    middle = shape.vertices[hull.vertices].mean(axis=0)
    faces: list[tuple[float, Array, Array]] = []
    for n in _distinct(hull.equations[:, :3]):
        d = float((shape.vertices @ n).max())
        contact = shape.vertices[shape.vertices @ n > d - 1e-6 * shape.size]
        hull_of = np.unique(np.round(contact, 9), axis=0)
        flat = hull_of - n * (hull_of @ n)[:, None]
        if len(flat) >= 3 and _over(middle - n * (middle @ n), flat, n):
            faces.append((_solid_angle(contact, middle), n, contact))
    faces.sort(key=lambda f: -f[0])
    return [(_down(n), contact) for _, n, contact in faces[:_DOWN]]


def _distinct(normals: Array) -> list[Array]:
    out: list[Array] = []
    for n in normals:
        if all(n @ m < 1 - 1e-6 for m in out):
            out.append(n)
    return out


def _over(p: Array, corners: Array, n: Array) -> bool:
    """Whether a point lies over the convex polygon of corners, all in one plane of normal n."""
    R = _down(n)
    q, c = (R @ p)[:2], (corners @ R.T)[:, :2]
    outline = cv2.convexHull(c.astype(np.float32)).reshape(-1, 1, 2)
    return cv2.pointPolygonTest(outline, (float(q[0]), float(q[1])), True) > -1e-9


def _solid_angle(corners: Array, middle: Array) -> float:
    d = corners - middle
    return float(np.ptp(d, axis=0).prod() ** (2 / 3) / np.mean(np.sum(d * d, axis=1))) if len(d) else 0.0


def _down(n: Array) -> Array:
    """A rotation R with R n = (0, 0, -1)."""
    z = -n
    x = np.eye(3)[int(np.argmin(np.abs(z)))]
    x = x - z * (x @ z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z])


def on_table(shape: Shape, camera: Camera, mask: Mask, table: Plane, z_object: float | None) -> list[Guess]:
    """Guesses of an object that stands on a table (plane in the camera's frame), best first. z_object: the median depth
    of what is seen of it, metres, where known."""
    up = table.normal
    R_camera_table = _down(-up).T
    middle = _middle(mask)
    out = []
    for R, contact in resting(shape):
        heights = shape.vertices @ R.T[:, 2]
        lift = -heights.min()
        for k in range(TURNS):
            turn = so3.exp([0, 0, 2 * np.pi * k / TURNS])
            R_co = R_camera_table @ turn @ R
            out.append(_placed(shape, camera, mask, middle, R_co, _on_plane(table, up, lift), contact, z_object))
    return sorted((g for g in out if g is not None), key=lambda g: -g.score)


def free(shape: Shape, camera: Camera, mask: Mask, z: float) -> list[Guess]:
    """Guesses in any turn, its middle about where the depths z of what is seen of it, metres, say; best first."""
    from scipy.spatial.transform import Rotation

    turns = [*axis_turns(), *Rotation.random(FREE_TURNS, random_state=np.random.default_rng(0)).as_matrix()]
    none, middle = np.zeros((0, 3)), _middle(mask)

    def place(ray: Array, R: Array) -> Array:
        # What is seen of it lies between its nearest point and its middle, nearer to the first.
        return ray * (z - 0.7 * float((shape.vertices @ R.T)[:, 2].min()))

    out = [_placed(shape, camera, mask, middle, R, place, none, z) for R in turns]
    return sorted((g for g in out if g is not None), key=lambda g: -g.score)


def _middle(mask: Mask) -> Array:
    rows, columns = np.nonzero(mask)
    return np.array([columns.mean(), rows.mean()])


def _on_plane(table: Plane, up: Array, lift: float) -> Place:
    """Where the object's origin is, on a ray, `lift` metres above the table."""
    a = table.a / (1 - lift / table.distance)

    def place(ray: Array, R: Array) -> Array:
        return ray / float(a @ ray)

    return place


def _placed(
    shape: Shape, camera: Camera, mask: Mask, target: Array, R: Array, place: Place, contact: Array, z: float | None
) -> Guess | None:
    """The guess in this turn whose outline's middle is `target`, where `place` lets it stand."""
    pixel = target.copy()
    T = np.eye(4)
    for _ in range(3):
        ray = camera.unproject(pixel)
        if not np.isfinite(ray).all():
            return None
        T = se3.make(R, place(ray / ray[2], R))
        uv = _drawn_points(shape, camera, T)
        if uv is None:
            return None
        moments = cv2.moments(cv2.convexHull(uv.astype(np.float32)))
        if moments["m00"] <= 0:
            return None
        pixel = pixel + target - (moments["m10"] / moments["m00"], moments["m01"] / moments["m00"])
    score = overlap(shape, camera, T, mask)
    if z is not None:
        seen = float(np.median(se3.apply(T, shape.vertices)[:, 2]))
        score -= abs(seen - z) / shape.size
    return Guess(T, score, contact)


def _drawn_points(shape: Shape, camera: Camera, T: Array) -> Array | None:
    p = se3.apply(T, shape.vertices)
    if np.any(p[:, 2] <= 0):
        return None
    uv = camera.project(p)
    return uv if np.isfinite(uv).all() and np.abs(uv).max() < 30_000 else None


def overlap(shape: Shape, camera: Camera, T_camera_object: Array, mask: Mask) -> float:
    """Intersection over union of the drawn shape and a segment."""
    uv = _drawn_points(shape, camera, T_camera_object)
    if uv is None:
        return 0.0
    if shape.sides is not None:
        canvas = np.zeros(mask.shape, np.uint8)
        cv2.fillConvexPoly(canvas, np.rint(cv2.convexHull(uv.astype(np.float32)) * 16).astype(np.int32), 1, shift=4)
        drawn = canvas > 0
    else:
        drawn = visible_triangles(shape, camera, T_camera_object) >= 0
    both, either = int((mask & drawn).sum()), int((mask | drawn).sum())
    return both / max(either, 1)
