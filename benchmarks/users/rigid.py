"""Rotations and rigid transforms, written anew: a simulator that took the calibrator's would share its mistakes."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def turn(rotation_vector: ArrayLike) -> Array:
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3), radians, by Rodrigues' formula."""
    w = np.asarray(rotation_vector, dtype=np.float64)
    angle = np.linalg.norm(w, axis=-1)[..., None, None]
    x, y, z = np.moveaxis(w, -1, 0)
    o = np.zeros_like(x)
    cross = np.stack([np.stack([o, -z, y], -1), np.stack([z, o, -x], -1), np.stack([-y, x, o], -1)], -2)
    return np.eye(3) + np.sinc(angle / np.pi) * cross + 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * cross @ cross


def turned_by(R: Array) -> Array:
    """Rotation vectors (..., 3) of rotation matrices, for angles below half a turn."""
    skew = np.stack([R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]], -1) / 2
    sine, cosine = np.linalg.norm(skew, axis=-1), (np.trace(R, axis1=-2, axis2=-1) - 1) / 2
    angle = np.arctan2(sine, cosine)
    return skew * np.where(sine > 1e-12, angle / np.maximum(sine, 1e-12), 1.0)[..., None]


def rigid(R: ArrayLike, t: ArrayLike) -> Array:
    """T (..., 4, 4) of R (..., 3, 3) and t (..., 3)."""
    R, t = np.asarray(R, dtype=np.float64), np.asarray(t, dtype=np.float64)
    T = np.zeros((*np.broadcast_shapes(R.shape[:-2], t.shape[:-1]), 4, 4))
    T[..., :3, :3], T[..., :3, 3], T[..., 3, 3] = R, t, 1.0
    return T


def back(T: Array) -> Array:
    """The inverse of T (..., 4, 4)."""
    Rt = np.swapaxes(T[..., :3, :3], -1, -2)
    return rigid(Rt, -np.einsum("...ij,...j->...i", Rt, T[..., :3, 3]))


def moved(T: Array, step: ArrayLike) -> Array:
    """T (..., 4, 4) moved by (rotation vector, translation) (..., 6), both along the axes of the parent."""
    d = np.asarray(step, dtype=np.float64)
    return rigid(turn(d[..., :3]) @ T[..., :3, :3], T[..., :3, 3] + d[..., 3:])


def step_between(T: Array, other: Array) -> Array:
    """The step (..., 6) with moved(T, step) = other."""
    w = turned_by(other[..., :3, :3] @ np.swapaxes(T[..., :3, :3], -1, -2))
    return np.concatenate([w, other[..., :3, 3] - T[..., :3, 3]], axis=-1)
