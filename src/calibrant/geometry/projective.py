"""Projective geometry of one and two views: homographies, epipolar lines, the distances that go with them.

Points are rows (..., 2). Functions of a camera pair call the views a and b and take T_b_a, which maps points of camera
a into camera b; K are 3x3 camera matrices, pixels. Lenses are assumed ideal: undistort first.
Source of the equations: Hartley and Zisserman, Multiple View Geometry, 2nd ed., chapters 4, 9 and 11.
Triangulation is in `triangulation`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.geometry import so3

_COLLINEAR = 1e-6
"""Width over length of a point set below which it is a line: a millionth of a board is far below any noise."""

_RANK_SQ = 1e-12
"""Smallest eigenvalue but one of A^T A over the largest, the square of 1e-6: below, a second homography fits as well.

Normalised points of a real view give 1e-4 and more.
"""


def homography(source: ArrayLike, target: ArrayLike) -> Array:
    """H with target ~ H source, by the normalised direct linear transform (Hartley and Zisserman, algorithm 4.2).

    Args: source, target (n, 2), n >= 4, no line holding all but one of them. Returns (3, 3), Frobenius norm 1, the
    sign such that source points have positive depth (third homogeneous coordinate) on average.
    Raises: InputError for too few points, unequal numbers, NaN, collinear points.
    """
    return homographies([source], [target])[0]


def homographies(sources: Sequence[ArrayLike], targets: Sequence[ArrayLike]) -> Array:
    """Homographies of many views in one batch; the views may have different numbers of points.

    A row pair of the linear system is [p, 0, -u p] and [0, p, -v p], so A^T A consists of the four 3x3 moments
    sum p p^T, sum u p p^T, sum v p p^T and sum (u^2 + v^2) p p^T; its last eigenvector is H. Normalisation keeps its
    condition number below ~1e4, so squaring costs no visible digit, and padding a view with zeros costs nothing.

    Args: for each view, source and target (n_i, 2). Returns (views, 3, 3) as `homography`.
    Raises: InputError naming the first bad view.
    """
    if len(sources) != len(targets) or len(sources) == 0:
        raise InputError(
            f"homographies need the same number of source and target sets, got {len(sources)} and {len(targets)}"
        )
    pairs = [_checked_pair(s, t, f"view {i}: ") for i, (s, t) in enumerate(zip(sources, targets))]
    most = max(len(source) for source, _ in pairs)
    padded, weight = np.zeros((len(pairs), 2, most, 2)), np.zeros((len(pairs), most))
    for i, (s, t) in enumerate(pairs):
        padded[i, 0, : len(s)], padded[i, 1, : len(s)], weight[i, : len(s)] = s, t, 1.0
    source, S = _normalise(padded[:, 0], weight)
    target, T = _normalise(padded[:, 1], weight)
    _refuse_lines(source, "source")
    _refuse_lines(target, "target")
    values, vectors = np.linalg.eigh(_moment_matrix(source, target, weight))
    bad = np.flatnonzero(values[:, 1] < _RANK_SQ * values[:, -1])
    if len(bad):
        raise InputError(
            f"view {bad[0]}: all points but one lie on a line; a homography needs four in general position"
        )
    H: Array = np.linalg.solve(T, vectors[:, :, 0].reshape(-1, 3, 3) @ S).astype(np.float64, copy=False)
    H /= np.sqrt(np.sum(H**2, axis=(1, 2), keepdims=True))
    depth = np.einsum("vj,vnj->v", H[:, 2], _homogeneous(padded[:, 0]) * weight[..., None])
    return H * np.where(depth < 0, -1.0, 1.0)[:, None, None]


def apply_homography(H: ArrayLike, points: ArrayLike) -> Array:
    """Points mapped by H: (..., 3, 3) and (..., n, 2) -> (..., n, 2); NaN for a point mapped to infinity."""
    mapped = _homogeneous(points) @ np.swapaxes(np.asarray(H, dtype=np.float64), -1, -2)
    w = mapped[..., 2:]
    return mapped[..., :2] / np.where(w == 0, np.nan, w)


def essential_from_transform(T_b_a: ArrayLike) -> Array:
    """Essential matrix E = hat(t) R with x_b^T E x_a = 0 for ideal coordinates (x, y, 1).

    Args: T_b_a (..., 4, 4), metres. Returns (..., 3, 3). Raises: InputError where the cameras share their centre.
    """
    T = np.asarray(T_b_a, dtype=np.float64)
    t = T[..., :3, 3]
    if np.any(np.linalg.norm(t, axis=-1) == 0):
        raise InputError("T_b_a has no translation: two cameras with one centre have no epipolar geometry")
    return so3.hat(t) @ T[..., :3, :3]


def fundamental_from_transform(T_b_a: ArrayLike, *, K_a: ArrayLike, K_b: ArrayLike) -> Array:
    """Fundamental matrix F = K_b^-T E K_a^-1 with u_b^T F u_a = 0 for pixels (u, v, 1).

    Args: T_b_a (..., 4, 4), metres; K_a, K_b (3, 3), pixels. Returns (..., 3, 3), Frobenius norm 1.
    Raises: InputError where the cameras share their centre.
    """
    Ka, Kb = np.linalg.inv(np.asarray(K_a, dtype=np.float64)), np.linalg.inv(np.asarray(K_b, dtype=np.float64))
    F = Kb.T @ essential_from_transform(T_b_a) @ Ka
    return F / np.linalg.norm(F, axis=(-2, -1), keepdims=True)


def epipolar_lines(F_b_a: ArrayLike, uv_a: ArrayLike) -> Array:
    """Lines (a, b, c) in view b of points in view a: a u + b v + c = 0 with a^2 + b^2 = 1; NaN for the epipole.

    Args: F_b_a (3, 3) with u_b^T F u_a = 0; uv_a (..., 2). Returns (..., 3).
    """
    lines = _homogeneous(uv_a) @ np.asarray(F_b_a, dtype=np.float64).T
    length = np.linalg.norm(lines[..., :2], axis=-1, keepdims=True)
    return lines / np.where(length == 0, np.nan, length)


def epipolar_distance(F_b_a: ArrayLike, uv_a: ArrayLike, uv_b: ArrayLike) -> Array:
    """Distance in view b of each point from the epipolar line of its partner in view a, pixels, >= 0.

    For distances in view a pass the transpose: `epipolar_distance(F_b_a.T, uv_b, uv_a)`.
    Args: F_b_a (3, 3); uv_a, uv_b (..., 2). Returns (...).
    """
    return np.abs(np.sum(epipolar_lines(F_b_a, uv_a) * _homogeneous(uv_b), axis=-1))


def sampson_distance(F_b_a: ArrayLike, uv_a: ArrayLike, uv_b: ArrayLike) -> Array:
    """First-order distance of a pair from the nearest pair that satisfies F, over both views, pixels, >= 0.

    |u_b^T F u_a| / sqrt((F u_a)_1^2 + (F u_a)_2^2 + (F^T u_b)_1^2 + (F^T u_b)_2^2)   (H&Z, eq. 11.9, its root)
    Args: F_b_a (3, 3); uv_a, uv_b (..., 2). Returns (...); NaN where both points are epipoles.
    """
    F = np.asarray(F_b_a, dtype=np.float64)
    a, b = _homogeneous(uv_a), _homogeneous(uv_b)
    line_b, line_a = a @ F.T, b @ F
    slope = np.sqrt(np.sum(line_b[..., :2] ** 2, axis=-1) + np.sum(line_a[..., :2] ** 2, axis=-1))
    return np.abs(np.sum(b * line_b, axis=-1)) / np.where(slope == 0, np.nan, slope)


def _checked_pair(source: ArrayLike, target: ArrayLike, label: str) -> tuple[Array, Array]:
    s, t = np.asarray(source, dtype=np.float64), np.asarray(target, dtype=np.float64)
    if s.ndim != 2 or s.shape[1] != 2 or s.shape != t.shape:
        raise InputError(f"{label}expected source and target points of one shape (n, 2), got {s.shape} and {t.shape}")
    if len(s) < 4:
        raise InputError(f"{label}a homography needs at least 4 points, got {len(s)}")
    for points, name in ((s, "source"), (t, "target")):
        if not np.all(np.isfinite(points)):
            raise InputError(f"{label}the {name} points hold NaN or infinite values; leave those points out")
    return s, t


def _refuse_lines(points: Array, name: str) -> None:
    """Raise InputError where all points of a view lie on one line; points (v, n, 3) as `_normalise` returns them."""
    spread = np.linalg.eigvalsh(np.swapaxes(points[..., :2], -1, -2) @ points[..., :2])
    lines = np.flatnonzero(~(spread[:, 0] > _COLLINEAR**2 * spread[:, 1]))
    if len(lines):
        raise InputError(
            f"view {lines[0]}: the {name} points lie on one line; a homography needs four in general position"
        )


def _normalise(points: Array, weight: Array) -> tuple[Array, Array]:
    """Shift and scale to mean 0 and mean square radius 2; returns homogeneous points (v, n, 3), zero where padded,
    and the similarities (v, 3, 3) that did it."""
    count = weight.sum(axis=1)
    centre = np.einsum("vn,vni->vi", weight, points) / count[:, None]
    offset = (points - centre[:, None]) * weight[..., None]
    square = np.sum(offset**2, axis=(1, 2))
    scale = np.sqrt(2 * count / np.where(square == 0, 1.0, square))  # all points in one place: refused right after
    similarity = np.zeros((len(points), 3, 3))
    similarity[:, 0, 0] = similarity[:, 1, 1] = scale
    similarity[:, :2, 2] = -scale[:, None] * centre
    similarity[:, 2, 2] = 1.0
    return np.concatenate([offset * scale[:, None, None], weight[..., None]], axis=-1), similarity


def _moment_matrix(source: Array, target: Array, weight: Array) -> Array:
    """A^T A (v, 9, 9) of the linear systems; see `homographies`. Padded points are zero and add nothing."""
    u, v = target[..., 0], target[..., 1]
    factors = np.stack([weight, u, v, u * u + v * v], axis=1)
    plain, by_u, by_v, by_square = np.moveaxis(
        np.einsum("vkn,vni,vnj->kvij", factors, source, source, optimize=True), 0, 0
    )
    out = np.zeros((len(source), 9, 9))
    out[:, :3, :3] = out[:, 3:6, 3:6] = plain
    out[:, :3, 6:] = out[:, 6:, :3] = -by_u
    out[:, 3:6, 6:] = out[:, 6:, 3:6] = -by_v
    out[:, 6:, 6:] = by_square
    return out


def _homogeneous(points: ArrayLike) -> Array:
    p = np.asarray(points, dtype=np.float64)
    return np.concatenate([p, np.ones((*p.shape[:-1], 1))], axis=-1)
