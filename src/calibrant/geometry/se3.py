"""SE(3): rigid transforms as 4x4 matrices, batched over any leading axes.

`T_a_b` maps coordinates of frame b into frame a. Tangent vectors are (omega, v): rotation first, radians, then
translation, metres. Two charts are used and never mixed:

* `exp` / `log`: the group's exponential (twists), for interpolation and screw motion;
* `retract` / `local`: R <- exp(omega) R, t <- t + v. Both halves are expressed in the parent frame a, so the standard
  deviations of v are those of the position of b's origin in a. The optimiser and every covariance use this one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.geometry import so3


def make(R: ArrayLike, t: ArrayLike) -> Array:
    """Transform from a rotation (..., 3, 3) and a translation (..., 3), metres: (..., 4, 4)."""
    rotation, translation = np.asarray(R, dtype=np.float64), np.asarray(t, dtype=np.float64)
    batch = np.broadcast_shapes(rotation.shape[:-2], translation.shape[:-1])
    T = np.zeros((*batch, 4, 4))
    T[..., :3, :3] = rotation
    T[..., :3, 3] = translation
    T[..., 3, 3] = 1.0
    return T


def inverse(T_a_b: ArrayLike) -> Array:
    """T_b_a: (R^T, -R^T t). Args: T_a_b (..., 4, 4)."""
    T = np.asarray(T_a_b, dtype=np.float64)
    Rt = np.swapaxes(T[..., :3, :3], -1, -2)
    return make(Rt, -np.einsum("...ij,...j->...i", Rt, T[..., :3, 3]))


def apply(T_a_b: ArrayLike, p_b: ArrayLike) -> Array:
    """p_a = R p_b + t for transforms (..., 4, 4) and points (..., 3); leading axes broadcast."""
    T, p = np.asarray(T_a_b, dtype=np.float64), np.asarray(p_b, dtype=np.float64)
    return np.einsum("...ij,...j->...i", T[..., :3, :3], p) + T[..., :3, 3]


def exp(xi: ArrayLike) -> Array:
    """Transform of a twist (omega, v): R = exp(omega), t = J(omega) v. Args: xi (..., 6). Returns (..., 4, 4)."""
    x = np.asarray(xi, dtype=np.float64)
    omega, v = x[..., :3], x[..., 3:]
    return make(so3.exp(omega), np.einsum("...ij,...j->...i", so3.left_jacobian(omega), v))


def log(T: ArrayLike) -> Array:
    """Twist (omega, v) of a transform, inverse of `exp`. Args: T (..., 4, 4). Returns (..., 6)."""
    m = np.asarray(T, dtype=np.float64)
    omega = so3.log(m[..., :3, :3])
    v = np.einsum("...ij,...j->...i", so3.left_jacobian_inverse(omega), m[..., :3, 3])
    return np.concatenate([omega, v], axis=-1)


def retract(T_a_b: ArrayLike, delta: ArrayLike) -> Array:
    """Move a transform by delta = (omega, v), both in frame a: R <- exp(omega) R, t <- t + v.

    Args: T_a_b (..., 4, 4); delta (..., 6), radians and metres. Returns (..., 4, 4).
    """
    T, d = np.asarray(T_a_b, dtype=np.float64), np.asarray(delta, dtype=np.float64)
    return make(so3.exp(d[..., :3]) @ T[..., :3, :3], T[..., :3, 3] + d[..., 3:])


def local(T_from: ArrayLike, T_to: ArrayLike) -> Array:
    """The delta with retract(T_from, delta) = T_to: (log(R_to R_from^T), t_to - t_from). Returns (..., 6)."""
    a, b = np.asarray(T_from, dtype=np.float64), np.asarray(T_to, dtype=np.float64)
    omega = so3.log(b[..., :3, :3] @ np.swapaxes(a[..., :3, :3], -1, -2))
    return np.concatenate([omega, b[..., :3, 3] - a[..., :3, 3]], axis=-1)


def mm_and_deg(delta: ArrayLike) -> tuple[Array, Array]:
    """How large deviations (..., 6) are, radians and metres: distance in mm (...) and angle in degrees (...)."""
    d = np.asarray(delta, dtype=np.float64)
    return 1e3 * np.linalg.norm(d[..., 3:], axis=-1), np.rad2deg(np.linalg.norm(d[..., :3], axis=-1))


def deviation(T_from: ArrayLike, T_to: ArrayLike) -> tuple[Array, Array]:
    """How far transforms (..., 4, 4) are apart: distance of their origins in mm (...), angle in degrees (...).

    >>> mm, deg = deviation(np.eye(4), make(so3.exp([0.0, 0.0, np.pi / 2]), [0.0, 0.003, 0.004]))
    >>> float(mm.round(6)), float(deg.round(6))
    (5.0, 90.0)
    """
    return mm_and_deg(local(T_from, T_to))


def adjoint(T_a_b: ArrayLike) -> Array:
    """Ad with T exp(xi) T^-1 = exp(Ad xi), twists ordered (omega, v): [[R, 0], [hat(t) R, R]].

    Args: T_a_b (..., 4, 4). Returns (..., 6, 6).
    """
    T = np.asarray(T_a_b, dtype=np.float64)
    R = T[..., :3, :3]
    out = np.zeros((*T.shape[:-2], 6, 6))
    out[..., :3, :3] = out[..., 3:, 3:] = R
    out[..., 3:, :3] = so3.hat(T[..., :3, 3]) @ R
    return out


def mean(T: ArrayLike, *, weights: ArrayLike | None = None) -> Array:
    """Mean transform: Karcher mean of the rotations, weighted mean of the translations. Args: T (n, 4, 4)."""
    m = np.asarray(T, dtype=np.float64)
    if m.ndim != 3 or len(m) == 0:
        raise InputError(f"the mean of transforms needs an (n, 4, 4) array with n >= 1, got shape {m.shape}")
    w = None if weights is None else np.asarray(weights, dtype=np.float64)
    return make(so3.mean(m[:, :3, :3], weights=w), np.average(m[:, :3, 3], axis=0, weights=w))


def carrying(p_b: ArrayLike, p_a: ArrayLike) -> Array:
    """T_a_b (4, 4) that carries points onto points: least sum of |p_a - T_a_b p_b|^2 (Arun, Huang, Blostein 1987).

    p_b, p_a (n, 3), metres, n of 3 or more that do not stand in a line.

        >>> import numpy as np
        >>> p = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.2, 0.0]])
        >>> np.allclose(carrying(p, p + [1.0, 2.0, 3.0])[:3, 3], [1.0, 2.0, 3.0])
        True
    """
    b, a = np.asarray(p_b, dtype=np.float64), np.asarray(p_a, dtype=np.float64)
    centre_b, centre_a = b.mean(axis=0), a.mean(axis=0)
    R = so3.nearest((a - centre_a).T @ (b - centre_b))
    return make(R, centre_a - R @ centre_b)


def _sound(T: Array, tolerance: float) -> NDArray[np.bool_]:
    """Which of T (n, 4, 4) are rigid transforms, as `check` asks for."""
    finite = np.asarray(np.isfinite(T).all(axis=(1, 2)))
    R = np.where(finite[:, None, None], T[:, :3, :3], np.eye(3))
    last = np.abs(np.where(finite[:, None], T[:, 3], [0, 0, 0, 1]) - [0, 0, 0, 1]).max(axis=1) <= 1e-9
    off = np.abs(R @ np.swapaxes(R, 1, 2) - np.eye(3)).max(axis=(1, 2))
    return finite & last & (off <= tolerance) & (np.linalg.det(R) >= 0)


def check(T: ArrayLike, *, name: str, tolerance: float = 1e-4) -> Array:
    """Return T as a float array (..., 4, 4) after checking that every matrix is a rigid transform.

    Rotations off by rounding (within `tolerance`) are replaced by the nearest rotation, so that everything after this
    may rely on R R^T = I. Args: name, how messages call the input.
    Raises: InputError naming the first bad matrix: shape, NaN, last row, reflection, not orthonormal.
    """
    try:
        m = np.array(T, dtype=np.float64)
    except (TypeError, ValueError):
        found = str(T)[:60]
        raise InputError(f"{name}: expected 4x4 matrices of numbers, shape (..., 4, 4), got {found!r}") from None
    if m.shape[-2:] != (4, 4):
        raise InputError(f"{name}: expected 4x4 matrices, shape (..., 4, 4), got shape {m.shape}")
    flat = m.reshape(-1, 4, 4)
    for i in np.flatnonzero(~_sound(flat, tolerance)):  # none, as a rule: what follows only finds the words
        row = flat[i]
        label = name if len(flat) == 1 else f"{name}[{i}]"
        if not np.all(np.isfinite(row)):
            raise InputError(f"{label} holds NaN or infinite values; every pose needs finite numbers")
        if np.abs(row[3] - [0, 0, 0, 1]).max() > 1e-9:
            raise InputError(
                f"{label}: the last row is {row[3].tolist()}, expected [0, 0, 0, 1]; is the matrix transposed?"
            )
        R = row[:3, :3]
        det, off = np.linalg.det(R), np.abs(R @ R.T - np.eye(3)).max()
        if off > tolerance:
            raise InputError(
                f"{label}: the upper left 3x3 block is not a rotation: R R^T differs from the identity by {off:.2g} "
                f"(allowed {tolerance:g}); check for scale, units or a wrong column order"
            )
        if det < 0:
            raise InputError(f"{label}: the rotation has determinant -1: it mirrors; check the signs of an axis")
    m[..., :3, :3] = so3.nearest(m[..., :3, :3])
    return m
