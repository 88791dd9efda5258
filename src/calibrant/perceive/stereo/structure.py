"""Points reconstructed under what is known of the thing they are on: planes, right angles, parallel planes and edges.

A point i of planes k obeys n_k . Y_i = h_k exactly; a corner lies on three planes, an edge is where two meet, so that
edges of parallel planes are parallel. With N_i, h_i the planes of point i, X_i its triangulation with covariance C_i,

    min sum_i (N_i X_i - h_i)^T S_i^-1 (N_i X_i - h_i),   S_i = N_i C_i N_i^T,   over n_k, h_k, |n_k| = 1,
    n_a . n_b = 0 for right angles,   n_a x n_b = 0 for parallel planes,
    Y_i = X_i - C_i N_i^T S_i^-1 (N_i X_i - h_i),

by Gauss-Newton in the null space of the constraints. With C_i of the optimal triangulation this is, to first order,
least squares in the pixels of all pictures under the constraints.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array, Mask
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3, so3
from calibrant.optimize.chances import chi2_tail
from calibrant.perceive.stereo.points import StereoPoints

Pair = tuple[int, int]
_STEPS = 50
_SETTLED = 1e-11
_RANK = 1e-9
"""Singular value of a constraint below which others say the same."""
_FLAT = 1e-6
"""Width over length of a plane's points below which they are a line."""


@dataclass(frozen=True)
class Structure:
    """What is known: planes, for each the indices of its points; pairs of planes at right angles, and parallel ones.

    Raises: InputError for a plane of fewer than three points, or pairs of planes that are not there.
    """

    planes: tuple[tuple[int, ...], ...]
    right_angles: tuple[Pair, ...] = ()
    parallel: tuple[Pair, ...] = ()

    def __post_init__(self) -> None:
        for k, members in enumerate(self.planes):
            if len(set(members)) < 3:
                raise InputError(f"plane {k} has {len(set(members))} points; expected three or more")
        for a, b in (*self.right_angles, *self.parallel):
            if not (0 <= a < len(self.planes) and 0 <= b < len(self.planes)) or a == b:
                raise InputError(f"planes {a} and {b}: expected two of the planes 0 to {len(self.planes) - 1}")

    @classmethod
    def box(cls, *faces: Sequence[int]) -> Structure:
        """Faces of a box by the indices of their points, any two of them at right angles.

        >>> from calibrant.perceive.stereo.structure import Structure
        >>> Structure.box([0, 1, 2, 3], [0, 1, 4, 5], [0, 2, 4, 6]).right_angles
        ((0, 1), (0, 2), (1, 2))
        """
        planes = tuple(tuple(int(i) for i in face) for face in faces)
        return cls(planes, tuple((a, b) for a in range(len(planes)) for b in range(a + 1, len(planes))))

    @property
    def free(self) -> Structure:
        """The same planes without right angles and parallels."""
        return Structure(self.planes)


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """points (n, 3), metres, on their planes, with covariance (n, 3, 3) by the matches' noise and by the calibration.

    normals (k, 3), towards the first camera, and offsets (k,), n . Y = h, with their covariance (3 k, 3 k): turns of
    each normal (two, along `axes` (k, 3, 2)) and its offset, by both. fits: the chance of more misfit in such data.
    """

    points: Array
    noise: Array
    calibration: Array
    normals: Array
    offsets: Array
    axes: Array
    of_planes: Array
    fits: float

    @property
    def covariance(self) -> Array:
        """(n, 3, 3), square metres: both sources."""
        return self.noise + self.calibration

    def pose(self, x: int, y: int, z: int) -> tuple[Array, Array]:
        """T_first_box (4, 4), metres, with its covariance (6, 6) in `se3.retract`'s chart.

        The origin is where three planes meet, the axes are nearest to the normals of the planes x and y and that of z,
        or against it.

        Raises: RefusedError for planes that meet in no point.
        """
        k = [x, y, z]
        N, h = self.normals[k], self.offsets[k]
        if abs(np.linalg.det(N)) < _RANK:
            raise RefusedError("the three planes meet in no point: two of them are parallel")
        sign = np.array([1.0, 1.0, np.sign(np.linalg.det(N))])
        U, _, Vt = np.linalg.svd((N * sign[:, None]).T)
        t = np.linalg.solve(N, h)
        R = U @ Vt
        J = np.zeros((6, len(self.of_planes)))
        # The nearest rotation follows the normals by omega = A^-1 sum n x dn, A = sum (I - n n^T).
        A = sum(np.eye(3) - np.outer(n, n) for n in N)
        for row, plane in enumerate(k):
            at = 3 * plane
            J[:3, at : at + 2] = np.linalg.solve(A, so3.hat(N[row]) @ self.axes[plane])
            e = np.linalg.inv(N)[:, row]
            J[3:, at : at + 2] = -np.outer(e, t @ self.axes[plane])
            J[3:, at + 2] = e
        return se3.make(R, t), J @ self.of_planes @ J.T


def reconstruct(points: StereoPoints, structure: Structure, *, calibration: ArrayLike) -> Reconstruction:
    """The points on their planes under the structure.

    Args: points, as triangulated; calibration (p, p): covariance of the eyes, which `by_calibration` is by.
    Points of no plane stay as they are. Raises: InputError for points that are not there, NaN; RefusedError where a
    plane's points lie on a line.
    """
    X, C = points.points, points.noise
    n = len(X)
    member = _members(structure, n)
    if not np.isfinite(X[member.any(axis=1)]).all():
        raise InputError("a point of a plane has no place: its rays do not meet; leave it out")
    normals, offsets = _start(structure, X)
    if structure.right_angles or structure.parallel:
        normals = _kept(structure, normals)
    chi2 = np.inf
    Y = X
    for _ in range(_STEPS):
        axes = _axes(normals)
        r, S, J, who = _residuals(structure, member, X, Y, C, normals, offsets, axes)
        Z, first = _null_space(structure, normals, axes)
        H, g = _normal_equations(J, S, r)
        reduced = Z.T @ H @ Z
        step = first + Z @ np.linalg.solve(reduced, -Z.T @ (g + H @ first))
        turns = step.reshape(-1, 3)
        normals = normals + np.einsum("kij,kj->ki", axes, turns[:, :2])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        offsets = offsets + turns[:, 2]
        Y, chi2 = _placed(member, X, C, normals, offsets)
        if np.max(np.abs(step)) < _SETTLED * max(1.0, float(np.abs(offsets).max())):
            break
    axes = _axes(normals)
    r, S, J, who = _residuals(structure, member, X, Y, C, normals, offsets, axes)
    Z, _ = _null_space(structure, normals, axes)
    H, _ = _normal_equations(J, S, r)
    P = Z @ np.linalg.inv(Z.T @ H @ Z) @ Z.T
    return _with_covariance(points, member, P, J, S, who, Y, normals, offsets, axes, chi2, Z, np.asarray(calibration))


def _members(structure: Structure, n: int) -> Mask:
    member = np.zeros((n, len(structure.planes)), dtype=np.bool_)
    for k, indices in enumerate(structure.planes):
        bad = [i for i in indices if not 0 <= i < n]
        if bad:
            raise InputError(f"plane {k} names point {bad[0]}; there are the points 0 to {n - 1}")
        member[list(indices), k] = True
    return member


def _start(structure: Structure, X: Array) -> tuple[Array, Array]:
    """Planes of least squares, their normals towards the camera."""
    normals, offsets = [], []
    for k, indices in enumerate(structure.planes):
        p = X[list(indices)]
        _, s, axes = np.linalg.svd(p - p.mean(axis=0))
        if s[1] < _FLAT * s[0]:
            raise RefusedError(f"the points of plane {k} lie on a line: they are on many planes")
        normal = axes[2] * (-1.0 if axes[2] @ p.mean(axis=0) > 0 else 1.0)
        normals.append(normal)
        offsets.append(float(normal @ p.mean(axis=0)))
    return np.array(normals), np.array(offsets)


def _kept(structure: Structure, normals: Array) -> Array:
    """Normals moved until they keep right angles and parallels: the start of the fit."""
    for _ in range(_STEPS):
        axes = _axes(normals)
        _, first = _null_space(structure, normals, axes)
        turns = first.reshape(-1, 3)
        normals = normals + np.einsum("kij,kj->ki", axes, turns[:, :2])
        normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
        if np.max(np.abs(first)) < _SETTLED:
            break
    return normals


def _axes(normals: Array) -> Array:
    """Two axes (k, 3, 2) across each normal."""
    first = np.cross(normals, np.eye(3)[np.argmin(np.abs(normals), axis=1)])
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(normals, first)], axis=2)


def _null_space(structure: Structure, normals: Array, axes: Array) -> tuple[Array, Array]:
    """Steps (3 k, m) that keep the constraints, and the shortest one that restores them."""
    size = 3 * len(normals)
    rows, values = [], []
    for a, b in structure.right_angles:
        row = np.zeros(size)
        row[3 * a : 3 * a + 2] = normals[b] @ axes[a]
        row[3 * b : 3 * b + 2] = normals[a] @ axes[b]
        rows.append(row)
        values.append(float(normals[a] @ normals[b]))
    for a, b in structure.parallel:
        block = np.zeros((2, size))
        block[:, 3 * b : 3 * b + 2] = axes[a].T @ axes[b]
        block[:, 3 * a : 3 * a + 2] = -np.sign(normals[a] @ normals[b]) * np.eye(2)
        rows += list(block)
        values += (axes[a].T @ normals[b]).tolist()
    if not rows:
        return np.eye(size), np.zeros(size)
    A, c = np.array(rows), np.array(values)
    U, s, Vt = np.linalg.svd(A)
    rank = int(np.sum(s > 1e-6))
    first = -Vt[:rank].T @ ((U[:, :rank].T @ c) / s[:rank])
    return Vt[rank:].T, first


Rows = list[Array]


def _residuals(
    structure: Structure, member: Mask, X: Array, Y: Array, C: Array, normals: Array, offsets: Array, axes: Array
) -> tuple[Rows, Rows, Rows, list[int]]:
    """By point: N X - h, its covariance, its derivative by all planes, and the point's index."""
    r, S, J, who = [], [], [], []
    for i in np.flatnonzero(member.any(axis=1)):
        planes = np.flatnonzero(member[i])
        N = normals[planes]
        r.append(N @ X[i] - offsets[planes])
        S.append(N @ C[i] @ N.T)
        row = np.zeros((len(planes), 3 * len(structure.planes)))
        for at, k in enumerate(planes):
            row[at, 3 * k : 3 * k + 2] = Y[i] @ axes[k]
            row[at, 3 * k + 2] = -1.0
        J.append(row)
        who.append(int(i))
    return r, S, J, who


def _normal_equations(J: Rows, S: Rows, r: Rows) -> tuple[Array, Array]:
    H = sum(j.T @ np.linalg.solve(s, j) for j, s in zip(J, S))
    g = sum(j.T @ np.linalg.solve(s, e) for j, s, e in zip(J, S, r))
    return np.asarray(H), np.asarray(g)


def _placed(member: Mask, X: Array, C: Array, normals: Array, offsets: Array) -> tuple[Array, float]:
    """The points on their planes, and chi-square."""
    Y, chi2 = X.copy(), 0.0
    for i in np.flatnonzero(member.any(axis=1)):
        N, h = normals[member[i]], offsets[member[i]]
        r = N @ X[i] - h
        w = np.linalg.solve(N @ C[i] @ N.T, r)
        Y[i] = X[i] - C[i] @ N.T @ w
        chi2 += float(r @ w)
    return Y, chi2


def _with_covariance(
    points: StereoPoints, member: Mask, P: Array, J: Rows, S: Rows, who: list[int], Y: Array, normals: Array,
    offsets: Array, axes: Array, chi2: float, Z: Array, calibration: Array,
) -> Reconstruction:  # fmt: skip
    by = points.by_calibration
    N_by = [normals[member[i]] @ by[i] for i in who]
    # All points move with the calibration, and the planes with them.
    planes_by = -P @ sum(j.T @ np.linalg.solve(s, b) for j, s, b in zip(J, S, N_by))
    noise, moved = points.noise.copy(), by.copy()
    for i, j, s, b in zip(who, J, S, N_by):
        K = points.noise[i] @ normals[member[i]].T @ np.linalg.inv(s)
        noise[i] = points.noise[i] - K @ s @ K.T + K @ j @ P @ j.T @ K.T
        moved[i] = by[i] - K @ (b + j @ planes_by)
    spare = sum(len(s) for s in S) - Z.shape[1]
    return Reconstruction(
        Y,
        noise,
        moved @ calibration @ np.swapaxes(moved, 1, 2),
        normals,
        offsets,
        axes,
        P + planes_by @ calibration @ planes_by.T,
        chi2_tail(spare, chi2) if spare > 0 else 1.0,
    )
