"""SO(3): rotations as 3x3 matrices, batched over any leading axes.

Tangent vectors are rotation vectors in radians. Perturbations are on the left: R <- exp(omega) R, so omega is
expressed in the frame that R maps into. Near zero and near pi the closed forms are replaced by their series or by
the quaternion route, so exp and log are accurate to rounding over the whole group.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calibrant.arrays import Array
from calibrant.errors import InputError

_SMALL_ANGLE_SQ = 1e-8
"""Below this squared angle the Taylor series of the coefficients is exact to 1e-16 (next term ~ angle^4 / 120)."""


def hat(omega: ArrayLike) -> Array:
    """Skew matrix of a vector: hat(a) b = a x b.

    Args: omega (..., 3). Returns (..., 3, 3).
    """
    w = np.asarray(omega, dtype=np.float64)
    out = np.zeros((*w.shape[:-1], 3, 3))
    out[..., 0, 1], out[..., 0, 2] = -w[..., 2], w[..., 1]
    out[..., 1, 0], out[..., 1, 2] = w[..., 2], -w[..., 0]
    out[..., 2, 0], out[..., 2, 1] = -w[..., 1], w[..., 0]
    return out


def _coefficients(angle_sq: Array) -> tuple[Array, Array, Array]:
    """Return sin(t)/t, (1 - cos t)/t^2 and (t - sin t)/t^3 for t^2 = angle_sq."""
    small = angle_sq < _SMALL_ANGLE_SQ
    safe_sq = np.where(small, 1.0, angle_sq)
    t = np.sqrt(safe_sq)
    a = np.where(small, 1 - angle_sq / 6, np.sin(t) / t)
    b = np.where(small, 0.5 - angle_sq / 24, 2 * np.sin(t / 2) ** 2 / safe_sq)
    c = np.where(small, 1 / 6 - angle_sq / 120, (t - np.sin(t)) / (safe_sq * t))
    return a, b, c


def exp(omega: ArrayLike) -> Array:
    """Rotation matrix of a rotation vector (Rodrigues): R = I + a W + b W^2, W = hat(omega).

    Args: omega (..., 3), radians. Returns (..., 3, 3).
    """
    w = np.asarray(omega, dtype=np.float64)
    a, b, _ = _coefficients(np.sum(w * w, axis=-1))
    W = hat(w)
    return np.eye(3) + a[..., None, None] * W + b[..., None, None] * (W @ W)


def quaternion_wxyz(R: ArrayLike) -> Array:
    """Unit quaternion (w, x, y, z), w >= 0, of a rotation matrix (Shepperd's method: the largest component first).

    Args: R (..., 3, 3). Returns (..., 4).
    """
    m = np.asarray(R, dtype=np.float64)
    d = np.stack([m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]], axis=-1)
    trace = d.sum(axis=-1)
    # Row k of `candidates` is 4 q_k q: each is exact up to scale, the one with the largest q_k is the stable one.
    off = m - np.swapaxes(m, -1, -2)
    sym = m + np.swapaxes(m, -1, -2)
    w_row = np.stack([1 + trace, off[..., 2, 1], off[..., 0, 2], off[..., 1, 0]], axis=-1)
    x_row = np.stack([off[..., 2, 1], 1 + 2 * d[..., 0] - trace, sym[..., 0, 1], sym[..., 0, 2]], axis=-1)
    y_row = np.stack([off[..., 0, 2], sym[..., 0, 1], 1 + 2 * d[..., 1] - trace, sym[..., 1, 2]], axis=-1)
    z_row = np.stack([off[..., 1, 0], sym[..., 0, 2], sym[..., 1, 2], 1 + 2 * d[..., 2] - trace], axis=-1)
    candidates = np.stack([w_row, x_row, y_row, z_row], axis=-2)
    best = np.argmax(np.concatenate([trace[..., None], d], axis=-1), axis=-1)
    q = np.take_along_axis(candidates, best[..., None, None], axis=-2)[..., 0, :]
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    return np.where(q[..., :1] < 0, -q, q)


def log(R: ArrayLike) -> Array:
    """Rotation vector of a rotation matrix, angle in [0, pi].

    Args: R (..., 3, 3). Returns (..., 3), radians. Up to 120 degrees from the odd part sin(t) n; beyond through the
    quaternion, which is accurate at pi too, in three times the time.
    """
    m = np.asarray(R, dtype=np.float64)
    cosine = 0.5 * (m[..., 0, 0] + m[..., 1, 1] + m[..., 2, 2] - 1)
    if np.all(cosine > -0.5):
        odd = np.empty(m.shape[:-1])
        odd[..., 0] = m[..., 2, 1] - m[..., 1, 2]
        odd[..., 1] = m[..., 0, 2] - m[..., 2, 0]
        odd[..., 2] = m[..., 1, 0] - m[..., 0, 1]
        odd *= 0.5
        sine = np.sqrt(np.sum(odd * odd, axis=-1))
        tiny = sine < 1e-10
        return odd * np.where(tiny, 1.0, np.arctan2(sine, cosine) / np.where(tiny, 1.0, sine))[..., None]
    q = quaternion_wxyz(m)
    w, v = q[..., 0], q[..., 1:]
    n = np.linalg.norm(v, axis=-1)
    small = n < 1e-10
    # 2 atan2(n, w) / n -> 2 / w for n -> 0.
    scale = np.where(small, 2 / np.where(small, w, 1.0), 2 * np.arctan2(n, w) / np.where(small, 1.0, n))
    return v * scale[..., None]


def angle(R: ArrayLike) -> Array:
    """Rotation angle in [0, pi], radians, of R (..., 3, 3)."""
    return np.linalg.norm(log(R), axis=-1)


def left_jacobian(omega: ArrayLike) -> Array:
    """J with exp(omega + d) ~ exp(J d) exp(omega): J = I + b W + c W^2.

    Args: omega (..., 3). Returns (..., 3, 3).
    """
    w = np.asarray(omega, dtype=np.float64)
    _, b, c = _coefficients(np.sum(w * w, axis=-1))
    W = hat(w)
    return np.eye(3) + b[..., None, None] * W + c[..., None, None] * (W @ W)


def left_jacobian_inverse(omega: ArrayLike) -> Array:
    """Inverse of `left_jacobian`: J^-1 = I - W/2 + e W^2, e = (1 - t sin t / (2 (1 - cos t))) / t^2.

    Args: omega (..., 3), angle below 2 pi. Returns (..., 3, 3).
    """
    w = np.asarray(omega, dtype=np.float64)
    angle_sq = np.sum(w * w, axis=-1)
    a, b, _ = _coefficients(angle_sq)
    small = angle_sq < 1e-4  # the closed form cancels: 1 - a/(2b) ~ t^2/12 loses digits as 1e-16/t^2
    safe = np.where(small, 1.0, angle_sq)
    series = 1 / 12 + angle_sq / 720 + angle_sq**2 / 30240
    e = np.where(small, series, (1 - a / (2 * b)) / safe)
    W = hat(w)
    return np.eye(3) - 0.5 * W + e[..., None, None] * (W @ W)


def nearest(M: ArrayLike) -> Array:
    """Rotation nearest to a matrix in the Frobenius norm (orthogonal Procrustes, det = +1).

    Args: M (..., 3, 3), any real matrices. Returns (..., 3, 3).
    """
    U, _, Vt = np.linalg.svd(np.asarray(M, dtype=np.float64))
    sign = np.linalg.det(U @ Vt)
    U = U.copy()
    U[..., :, 2] *= sign[..., None]
    return U @ Vt


def mean(R: ArrayLike, *, weights: ArrayLike | None = None) -> Array:
    """Intrinsic (Karcher) mean of rotations: the R with sum_i w_i log(R_i R^T) = 0.

    Args: R (n, 3, 3); weights (n,), positive. Returns (3, 3). Starts from the chordal mean, then iterates.
    Raises: InputError when R is empty.
    """
    m = np.asarray(R, dtype=np.float64)
    if m.ndim != 3 or len(m) == 0:
        raise InputError(f"the mean of rotations needs an (n, 3, 3) array with n >= 1, got shape {m.shape}")
    w = np.ones(len(m)) if weights is None else np.asarray(weights, dtype=np.float64)
    w = w / w.sum()
    centre = nearest(np.einsum("n,nij->ij", w, m))
    for _ in range(50):
        step = w @ log(m @ centre.T)
        centre = exp(step) @ centre
        if np.linalg.norm(step) < 1e-14:
            break
    return centre


def random(rng: np.random.Generator, size: int) -> Array:
    """Rotations drawn uniformly (Haar) from normalised Gaussian quaternions: (size, 3, 3)."""
    q = rng.normal(size=(size, 4))
    q /= np.linalg.norm(q, axis=-1, keepdims=True)
    return from_quaternion_wxyz(q)


def from_quaternion_wxyz(q: ArrayLike) -> Array:
    """Rotation matrix of a quaternion (w, x, y, z), normalised here.

    Args: q (..., 4). Returns (..., 3, 3). Raises: InputError for a quaternion of norm 0 or not finite.
    """
    a = np.asarray(q, dtype=np.float64)
    n = np.linalg.norm(a, axis=-1, keepdims=True)
    if not np.all(np.isfinite(n)) or np.any(n < 1e-12):
        raise InputError("a quaternion has norm 0 or a value that is not finite; a rotation needs a norm of 1")
    w, x, y, z = np.moveaxis(a / n, -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def is_rotation(R: ArrayLike, *, tolerance: float = 1e-6) -> NDArray[np.bool_]:
    """True where R R^T = I and det R = 1 within `tolerance` per element. Args: R (..., 3, 3). Returns (...,)."""
    m = np.asarray(R, dtype=np.float64)
    with np.errstate(invalid="ignore"):
        off = np.abs(m @ np.swapaxes(m, -1, -2) - np.eye(3)).max(axis=(-1, -2))
        return (off < tolerance) & (np.linalg.det(m) > 0)
