"""Pose pairs (A_i, B_i) and the relative motions between them.

Normal form: A_i X B_i = Z for every i. Two poses i and j give, without Z,

    A_ij X = X B_ij,    A_ij = A_j^-1 A_i,    B_ij = B_j B_i^-1

so alpha_ij = R_X beta_ij for the rotation vectors alpha of A_ij and beta of B_ij: X turns the camera's rotation axes
into the robot's.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calibrant.arrays import Array, Index
from calibrant.errors import InputError
from calibrant.geometry import se3, so3

MAX_PAIRS = 5000
"""All pairs up to here (100 poses). More pairs add time and next to no information: n poses hold n - 1 motions."""


@dataclass(frozen=True, eq=False)
class RelativeMotions:
    """Relative motions A_ij, B_ij (p, 4, 4) of pose pairs, and their rotation vectors on matching branches.

    alpha, beta (p, 3), radians: R(alpha) = R_A, R(beta) = R_B. The angle of alpha is in [0, pi]; beta may lie in
    [0, 2 pi], the branch that agrees with alpha, because noise flips the axis of a rotation close to half a turn.
    """

    i: Index
    j: Index
    A: Array
    B: Array
    alpha: Array
    beta: Array

    @cached_property
    def quaternion_a(self) -> Array:
        """Unit quaternions (p, 4), wxyz, of alpha."""
        return _quaternion_of_rotation_vector(self.alpha)

    @cached_property
    def quaternion_b(self) -> Array:
        """Unit quaternions (p, 4), wxyz, of beta: of the sign that matches `quaternion_a`."""
        return _quaternion_of_rotation_vector(self.beta)

    def only(self, keep: NDArray[np.bool_]) -> RelativeMotions:
        """The motions where `keep` (p,) is True."""
        return RelativeMotions(
            self.i[keep], self.j[keep], self.A[keep], self.B[keep], self.alpha[keep], self.beta[keep]
        )


@dataclass(frozen=True, eq=False)
class PosePairs:
    """Matching poses A (n, 4, 4) and B (n, 4, 4) = T_camera_target of A_i X B_i = Z, metres."""

    A: Array
    B: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "A", _checked_poses(self.A, "A"))
        object.__setattr__(self, "B", _checked_poses(self.B, "B"))
        if self.A.shape != self.B.shape:
            raise InputError(
                f"{len(self.A)} poses A of the robot but {len(self.B)} poses B of the target; "
                "every view needs one of each"
            )

    def __len__(self) -> int:
        return len(self.A)

    @cached_property
    def motions(self) -> RelativeMotions:
        """The relative motions of the pairs that `pair_indices` chooses."""
        i, j = pair_indices(len(self))
        A = se3.inverse(self.A)[j] @ self.A[i]
        B = self.B[j] @ se3.inverse(self.B)[i]
        alpha, beta = _rotation_vectors(A[:, :3, :3]), _rotation_vectors(B[:, :3, :3])
        return RelativeMotions(i, j, A, B, alpha, _matching_branch(alpha, beta, self._rough_rotation(A, B)))

    @cached_property
    def rough_rotation(self) -> Array:
        """R_X (3, 3) without any choice of sign: the rotation that best turns the odd parts of R_B into those of R_A.

        min sum |a - R_X b|^2, a = sin(theta) n = vee(R - R^T) / 2, which is continuous through half a turn.
        """
        return self._rough_rotation(self.motions.A, self.motions.B)

    @staticmethod
    def _rough_rotation(A: Array, B: Array) -> Array:
        return so3.nearest(odd_part(A[:, :3, :3]).T @ odd_part(B[:, :3, :3]))

    @cached_property
    def length(self) -> float:
        """Typical length of the relative translations, metres (1 when nothing moves).

        Methods that mix rows in radians and in metres divide lengths by it: the result then does not depend on the
        unit, and a rotation error weighs as much as the displacement it causes at working distance.
        """
        m = self.motions
        squares = np.sum(m.A[:, :3, 3] ** 2, axis=1) + np.sum(m.B[:, :3, 3] ** 2, axis=1)
        size = float(np.sqrt(squares.mean() / 2)) if len(squares) else 0.0
        return size if size > 0 else 1.0


def pose_pairs(A: ArrayLike, B: ArrayLike) -> PosePairs:
    """The pairs of A and B (n, 4, 4); the same object for the same numbers, while it is among the last asked for.

    Doctor and calibration ask many things of one set of poses: what they have in common is then computed once.
    """
    a, b = np.ascontiguousarray(A, dtype=np.float64), np.ascontiguousarray(B, dtype=np.float64)
    return _kept_pairs(a.shape, a.tobytes(), b.shape, b.tobytes())


@lru_cache(maxsize=4)
def _kept_pairs(shape_a: tuple[int, ...], a: bytes, shape_b: tuple[int, ...], b: bytes) -> PosePairs:
    return PosePairs(np.frombuffer(a).reshape(shape_a), np.frombuffer(b).reshape(shape_b))


def pair_indices(n: int) -> tuple[Index, Index]:
    """Pairs (i, j) of n poses: all of them up to MAX_PAIRS; beyond, every pose with those s places later (cyclic).

    The strides s are spread evenly from 1 (neighbours) to half the sequence, as many as MAX_PAIRS allows and at least
    three: each pose occurs equally often, and slow sequences whose neighbours hardly differ get wide pairs too.
    """
    if n * (n - 1) // 2 <= MAX_PAIRS:
        return np.triu_indices(n, 1)
    strides = np.linspace(1, (n - 1) // 2, max(3, MAX_PAIRS // n)).astype(np.intp)
    strides = strides[np.diff(strides, prepend=0) > 0]
    i = np.tile(np.arange(n), len(strides))
    return i, (i + np.repeat(strides, n)) % n


def sample(n: int, most: int) -> Index:
    """Rows of at most `most` of n poses, in their order: drawn, as sessions repeat themselves; always the same ones."""
    return np.arange(n) if n <= most else np.sort(np.random.default_rng(0).choice(n, most, replace=False))


def odd_part(R: ArrayLike) -> Array:
    """sin(theta) n = vee(R - R^T) / 2 of rotations (..., 3, 3): (..., 3)."""
    m = np.asarray(R, dtype=np.float64)
    d = m - np.swapaxes(m, -1, -2)
    return np.stack([d[..., 2, 1], d[..., 0, 2], d[..., 1, 0]], axis=-1) / 2


def _rotation_vectors(R: Array) -> Array:
    """so3.log of (p, 3, 3), turns beyond 120 degrees apart from the others: they take three times as long."""
    wide = np.einsum("pii->p", R) <= 0
    out = np.empty(R.shape[:-1])
    for rows in (wide, ~wide):
        out[rows] = so3.log(R[rows])
    return out


def _matching_branch(alpha: Array, beta: Array, R_x: Array) -> Array:
    """beta or its equal on the other branch, (theta - 2 pi) n, whichever lies closer to R_X^T alpha."""
    angle = np.linalg.norm(beta, axis=-1, keepdims=True)
    safe = np.where(angle > 0, angle, 1.0)
    other = np.where(angle > 0, beta * (1 - 2 * np.pi / safe), beta)
    expected = alpha @ R_x
    nearer = np.linalg.norm(expected - other, axis=-1) < np.linalg.norm(expected - beta, axis=-1)
    return np.where(nearer[:, None], other, beta)


def _quaternion_of_rotation_vector(omega: Array) -> Array:
    """(cos(t/2), sin(t/2) n) of rotation vectors (p, 3), also for t in (pi, 2 pi], where w < 0."""
    t = np.linalg.norm(omega, axis=-1)
    return np.concatenate([np.cos(t / 2)[:, None], 0.5 * np.sinc(t / (2 * np.pi))[:, None] * omega], axis=-1)


def _checked_poses(T: ArrayLike, name: str) -> Array:
    """T as (n, 4, 4) rigid transforms. Raises: InputError naming the first bad one."""
    m = np.asarray(T, dtype=np.float64)
    if m.ndim != 3 or m.shape[1:] != (4, 4):
        raise InputError(f"{name}: expected poses of shape (n, 4, 4), got shape {m.shape}")
    # One vectorised look for the usual case; the check that names the culprit walks through every matrix.
    clean = (
        np.isfinite(m).all()
        and (m[:, 3] == [0, 0, 0, 1]).all()
        and so3.is_rotation(m[:, :3, :3], tolerance=1e-12).all()
    )
    return m if clean else se3.check(m, name=name)
