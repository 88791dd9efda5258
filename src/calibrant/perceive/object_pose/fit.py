"""The pose of a shape by weighted least squares over depth, outline and the table that it stands on.

Unknown are T_camera_object, an offset for each side of the outline and one for all sides, the plane of the table
a . p = 1 (camera's frame), the common scale s of all depths and what rounding leaves in those of the object, c.
Residuals, predicted less measured:

    depth      (1 - s) (m . r) / D + c - 1/z,   m . p = D the face's plane in the depth camera's frame
    outline    n . (project(T X) - u) - b_side - b
    contact    (1 - a . T X) / |a|           for the vertices X that stand on the table
    table      L (a - a_measured (1 - s)),   L^T L = covariance^-1

Offsets and scale have priors of their own sigma and mean 0. The pose has a wide one, so that what nothing determines
has a finite, large sigma by which it is named.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.geometry import se3, so3
from calibrant.optimize import SE3, Factor, Problem, Solution, Variable, VectorPrior, solve, vector
from calibrant.optimize.factors import EXACT
from calibrant.optimize.levenberg_marquardt import SolverOptions
from calibrant.perceive.registered_depth.planes import Plane
from calibrant.perceive.registered_depth.register import DepthRig

CONTACT_SIGMA_M = 1e-4
"""How flat things and tables are, and how cleanly one stands on the other: a tenth of a millimetre, as a sheet of
paper's thickness."""
WIDE_TURN = 1.0
"""Sigma of the pose's own prior, rad: half a turn and more is within two of it."""
UNDETERMINED = 0.2
"""Of the prior's sigma: a direction whose sigma is larger was determined by nothing but it (or hardly better)."""
_ONE = np.zeros(1, dtype=np.int64)
_CLOSE = SolverOptions(max_iterations=30, cost_tolerance=1e-9)


@dataclass(frozen=True, eq=False)
class Measurements:
    """What was measured, with what it belongs to on the object.

    uv_depth (n, 2) pixels of the depth camera, inverse (n,) 1/z there, face (n,) triangle; sigma_inverse: of each, all
    taken as independent; points (k, 3), object's frame, outward (k, 2), edge_uv (k, 2), side (k,): of the outline;
    sigma_edge (k,), sigma_side (k,), sigma_common, px: of each, shared by a side, and by all; contact (c, 3): vertices
    on the table, object's frame; table: in the depth camera's frame, None where there is none; rounding: 1 sigma of
    what the depths' steps leave in all on the object together, 1/m; lost: share of the depths within the outline that
    are of something else; depth_shared: how many depths tell as much as an independent one; every: of how many pixels
    one was taken; sides: of the outline, found or not.
    """

    uv_depth: Array
    inverse: Array
    face: NDArray[np.int64]
    sigma_inverse: float
    points: Array
    outward: Array
    edge_uv: Array
    side: NDArray[np.int64]
    sigma_edge: Array
    sigma_side: Array
    sigma_common: float
    contact: Array
    table: Plane | None
    scale_sigma: float
    rounding: float = 0.0
    lost: float = 0.0
    depth_shared: float = 1.0
    every: float = 1.0
    sides: int = 0


class FaceDepths(Factor):
    """Inverse depths of pixels on faces of the object."""

    def __init__(
        self,
        normals: Array,
        offsets: Array,
        face: NDArray[np.int64],
        inverse: Array,
        sigma: float,
        *,
        rays: Array,
        T_depth_colour: Array,
    ) -> None:
        """normals (m, 3), offsets (m,): n . x = d of the faces, object's frame; face, inverse (n,), rays (n, 3)."""
        self.n, self.d = normals[face], offsets[face]
        self.rays, self.inverse, self.T = rays, inverse, T_depth_colour
        super().__init__(
            "depth",
            variables=("T_camera_object", "scale", "rounding"),
            indices=(_ONE, _ONE, _ONE),
            dim=1,
            noise="depth",
            relative_sigma=sigma,
            row_offsets=np.array([0, len(rays)]),
        )

    def linearize(self, *values: Array) -> tuple[Array, tuple[Array, ...]]:
        T, s, c = self.T @ values[0][0], float(values[1][0, 0]), float(values[2][0, 0])
        normal, t = self.n @ T[:3, :3].T, T[:3, 3]
        D = self.d + normal @ t
        along = np.sum(normal * self.rays, axis=1)
        q = along / D
        # normal turns with omega; D = d + normal . t.
        by_turn = np.cross(normal, self.rays) / D[:, None] - (along / D**2)[:, None] * np.cross(normal, t)
        by_shift = -(along / D**2)[:, None] * normal
        R = self.T[:3, :3]
        J = (1 - s) * np.concatenate([by_turn @ R, by_shift @ R], axis=1)
        return ((1 - s) * q + c - self.inverse)[:, None], (J[:, None], -q[:, None, None], np.ones((len(q), 1, 1)))


NO_ROUNDING = 1e-12
"""1/m: a picometre at 1 m is none, and its inverse square would overflow."""


def rounding_left(sigma: float) -> tuple[Variable, list[Factor]]:
    """c of `FaceDepths`, 1/m, and what is known of it: 0 +- sigma, or 0 for a sigma of 0."""
    c = vector("rounding", [0.0], ["offset"], held=() if sigma > NO_ROUNDING else ("offset",))
    if sigma <= NO_ROUNDING:
        return c, []
    return c, [VectorPrior("rounding", "rounding", 0, np.zeros(1), sqrt_information=np.array([[1 / sigma]]))]


class OutlineEdges(Factor):
    """Distances of the outline's samples from the edges in the picture, along the outward normal."""

    def __init__(self, camera: Camera, m: Measurements, order: NDArray[np.int64], starts: NDArray[np.int64]) -> None:
        self.camera, self.m, self.order, self.counts = camera, m, order, np.diff(starts)
        sides = len(starts) - 1
        super().__init__(
            "outline",
            variables=("T_camera_object", "side", "all sides"),
            indices=(np.zeros(sides, dtype=np.int64), np.arange(sides), np.zeros(sides, dtype=np.int64)),
            dim=1,
            noise="outline",
            relative_sigma=m.sigma_edge[order],
            row_offsets=starts,
        )

    def linearize(self, *values: Array) -> tuple[Array, tuple[Array, ...]]:
        T, off = values[0][0], values[1][:, 0] + float(values[2][0, 0])
        X, n, u = (a[self.order] for a in (self.m.points, self.m.outward, self.m.edge_uv))
        turned = X @ T[:3, :3].T
        uv, J_p, _ = self.camera.model.project_with_jacobians(self.camera.values, turned + T[:3, 3])
        across = np.einsum("ni,nij->nj", n, J_p)
        each = np.repeat(off, self.counts)
        r = np.sum(n * (uv - u), axis=1) - each
        J = np.concatenate([np.cross(turned, across), across], axis=1)
        one = np.full((len(r), 1, 1), -1.0)
        return r[:, None], (J[:, None], one, one)


class StandsOn(Factor):
    """Heights above the table of the vertices that touch it, metres."""

    def __init__(self, contact: Array) -> None:
        self.contact = contact
        super().__init__(
            "contact",
            variables=("T_camera_object", "table"),
            indices=(_ONE, _ONE),
            dim=1,
            noise="contact",
            relative_sigma=CONTACT_SIGMA_M,
            row_offsets=np.array([0, len(contact)]),
        )

    def linearize(self, *values: Array) -> tuple[Array, tuple[Array, ...]]:
        T, a = values[0][0], values[1][0]
        turned = self.contact @ T[:3, :3].T
        p = turned + T[:3, 3]
        size = float(np.linalg.norm(a))
        r = (1 - p @ a) / size
        J = -np.concatenate([np.cross(turned, a), np.broadcast_to(a, p.shape)], axis=1) / size
        return r[:, None], (J[:, None], (-p / size - r[:, None] * a / size**2)[:, None])


class SeenPlane(Factor):
    """The table as it was measured, all of its depths too long by the common scale."""

    def __init__(self, table: Plane) -> None:
        self.a = table.a
        self.root = np.linalg.inv(np.linalg.cholesky(table.covariance))
        super().__init__("table", variables=("table", "scale"), indices=(_ONE, _ONE), dim=3, noise=EXACT)

    def linearize(self, *values: Array) -> tuple[Array, tuple[Array, ...]]:
        a, s = values[0][0], float(values[1][0, 0])
        r = self.root @ ((1 - s) * a - self.a)
        return r[None], ((1 - s) * self.root[None], -(self.root @ a)[None, :, None])


def fit(m: Measurements, normals: Array, offsets: Array, rig: DepthRig, T_start: Array, *, size: float) -> Solution:
    """The solution of all measurements together. normals, offsets: of the shape's triangles; size: metres, of it."""
    pose = Variable("T_camera_object", SE3(), T_start[None], words="the object's pose")
    variables: list[Variable] = [pose]
    factors: list[Factor] = [_Wide(T_start, size)]
    table = None if m.table is None else m.table.moved(rig.T_colour_depth)
    if len(m.inverse) or table is not None:
        held = () if m.scale_sigma > 0 else ("scale",)
        variables.append(vector("scale", [0.0], ["scale"], held=held))
        if m.scale_sigma > 0:
            root = np.array([[1 / m.scale_sigma]])
            factors.append(VectorPrior("scale", "scale", 0, np.zeros(1), sqrt_information=root))
    if len(m.inverse):
        c, known = rounding_left(m.rounding)
        variables.append(c)
        factors += known
        rays = rig.depth.unproject(m.uv_depth)
        seen = {"rays": rays / rays[:, 2:], "T_depth_colour": se3.inverse(rig.T_colour_depth)}
        factors.append(FaceDepths(normals, offsets, m.face, m.inverse, m.sigma_inverse, **seen))
    if len(m.points):
        order = np.argsort(m.side, kind="stable")
        numbers, first = np.unique(m.side[order], return_index=True)
        factors.append(OutlineEdges(rig.colour, m, order, np.append(first, len(order))))
        variables.append(Variable("side", vector("side", [0.0], ["offset"]).manifold, np.zeros((len(numbers), 1))))
        variables.append(vector("all sides", [0.0], ["offset"]))
        common = np.array([[1 / m.sigma_common]])
        factors.append(VectorPrior("all sides", "all sides", 0, np.zeros(1), sqrt_information=common))
        sigma_side = m.sigma_side[order]
        factors += [
            VectorPrior(f"side {k}", "side", k, np.zeros(1), sqrt_information=np.array([[1 / s]]))
            for k, s in enumerate(sigma_side[first].tolist())
        ]
    if table is not None:
        variables.append(vector("table", table.a, ["x", "y", "z"]))
        factors += [SeenPlane(table), *([StandsOn(m.contact)] if len(m.contact) else [])]
    return solve(Problem(tuple(variables), tuple(factors)), options=_CLOSE)


class _Wide(Factor):
    """The wide prior of a pose: around the start."""

    def __init__(self, T: Array, size: float) -> None:
        self.T, self.root = T, np.diag([1 / WIDE_TURN] * 3 + [1 / size] * 3)
        super().__init__("wide", variables=("T_camera_object",), indices=(_ONE,), dim=6, noise=EXACT)

    def linearize(self, *values: Array) -> tuple[Array, tuple[Array, ...]]:
        r = se3.local(self.T, values[0][0])
        J = np.eye(6)
        J[:3, :3] = so3.left_jacobian_inverse(r[:3])
        return (self.root @ r)[None], ((self.root @ J)[None],)


def by_calibration(m: Measurements, normals: Array, offsets: Array, rig: DepthRig, T: Array, *, size: float) -> Array:
    """Covariance (6, 6) of the pose by the errors of the calibration: each of its independent ones, tried."""
    known = rig.calibration
    values, vectors = np.linalg.eigh(known)
    out = np.zeros((6, 6))
    for value, direction in zip(values, vectors.T):
        if value <= 1e-12 * values.max(initial=0.0) or value <= 0:
            continue
        off = rig.moved(np.sqrt(value) * direction)
        seen = m if m.table is None else replace(m, table=m.table.through(rig.depth, off.depth))
        moved = fit(seen, normals, offsets, off, T, size=size).value("T_camera_object")[0]
        delta = se3.local(T, moved)
        out += np.outer(delta, delta)
    return out


def undetermined(covariance: Array, size: float) -> tuple[str, ...]:
    """Directions, in words, of which nothing but the wide prior knows anything."""
    scale = np.array([WIDE_TURN] * 3 + [size] * 3)
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    return tuple(
        SE3().describe(v * scale, np.abs(v)) for value, v in zip(values, vectors.T) if np.sqrt(value) > UNDETERMINED
    )


def without(m: Measurements, *, contact: bool = False, outline: bool = False) -> Measurements:
    """The measurements less those of a kind."""
    none = np.zeros((0, 3))
    if contact:
        m = replace(m, contact=none)
    if outline:
        m = replace(
            m,
            points=none,
            outward=none[:, :2],
            edge_uv=none[:, :2],
            side=np.zeros(0, dtype=np.int64),
            sigma_edge=none[:, 0],
            sigma_side=none[:, 0],
        )
    return m
