"""Conversions between 3x3 rotation matrices and every other notation of a rotation, batched over leading axes.

All functions name both ends, `matrix_from_…` and `…_from_matrix`. A matrix R_a_b turns coordinates of frame b into
frame a (active and passive readings: docs/conventions.md). Angles carry their unit in a keyword without a default,
because no default is right for everybody.

Euler orders are spelled as SciPy spells them. Capital letters are intrinsic: each rotation is about an axis of the
frame as already turned, so "ZYX" with angles (a, b, c) is R = Rz(a) Ry(b) Rx(c). Small letters are extrinsic: each
rotation is about an axis of the fixed frame, so "xyz" with (a, b, c) is R = Rz(c) Ry(b) Rx(a). Twelve sequences (six
Tait-Bryan, six proper) read in two ways are the 24 of lecture 000, section "Euler Angles".

Yaw-pitch-roll is intrinsic "ZYX": yaw about z, then pitch about the new y, then roll about the newest x. The same
three numbers, listed as roll, pitch, yaw, are extrinsic "xyz" (ROS, URDF).
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.geometry import so3

AngleUnit = Literal["deg", "rad"]

_SEQUENCES = ("xyz", "xzy", "yxz", "yzx", "zxy", "zyx", "xyx", "xzx", "yxy", "yzy", "zxz", "zyz")
INTRINSIC_EULER_ORDERS: tuple[str, ...] = tuple(s.upper() for s in _SEQUENCES)
EXTRINSIC_EULER_ORDERS: tuple[str, ...] = _SEQUENCES
EULER_ORDERS: tuple[str, ...] = INTRINSIC_EULER_ORDERS + EXTRINSIC_EULER_ORDERS
"""All 24 orders: capitals intrinsic, small letters extrinsic."""

_LOCKED = 1e-12
"""Below this sine (proper) or cosine (Tait-Bryan) of the middle angle the first angle is lost in rounding (1e-16)."""

_NOT_A_ROTATION = 1e-4
"""Largest |R R^T - I| taken for the rounding of a text file; as in `se3.check`."""


def matrix_from_euler(angles: ArrayLike, *, order: str, unit: AngleUnit) -> Array:
    """Rotation matrix of three Euler angles in the order of the letters.

    Args: angles (..., 3), in `unit`; order, one of `EULER_ORDERS`. Returns (..., 3, 3).
    Raises: InputError for an unknown order or unit, a wrong shape, values that are not finite.
    """
    axes, intrinsic = _parse_order(order)
    radians = _radians(_finite_array(angles, "Euler angles", (3,)), unit)
    first, second, third = (_elementary(axis, radians[..., i]) for i, axis in enumerate(axes))
    return first @ second @ third if intrinsic else third @ second @ first


def euler_from_matrix(R: ArrayLike, *, order: str, unit: AngleUnit) -> Array:
    """Euler angles of a rotation, inverse of `matrix_from_euler`.

    The outer angles lie in [-180, 180] degrees, the middle one in [-90, 90] (Tait-Bryan) or [0, 180] (proper Euler).
    In gimbal lock (middle angle at an end of its range) only the sum or difference of the outer angles is determined;
    the angle applied first to the body's own axes (last of an intrinsic order, first of an extrinsic one) is then 0.
    The angles returned always reproduce R to rounding.

    Args: R (..., 3, 3); order, one of `EULER_ORDERS`. Returns (..., 3), in `unit`.
    Raises: InputError for an unknown order or unit, or a matrix that is not a rotation.
    """
    axes, intrinsic = _parse_order(order)
    m = _checked_rotation(R)
    # R = Rk(c) Rj(b) Ri(a) of an extrinsic order is the intrinsic order read backwards.
    radians = _intrinsic_angles(m, axes) if intrinsic else _intrinsic_angles(m, axes[::-1])[..., ::-1]
    return _from_radians(radians, unit)


def matrix_from_yaw_pitch_roll(angles: ArrayLike, *, unit: AngleUnit) -> Array:
    """R = Rz(yaw) Ry(pitch) Rx(roll). Args: angles (..., 3) as yaw, pitch, roll, in `unit`. Returns (..., 3, 3)."""
    return matrix_from_euler(angles, order="ZYX", unit=unit)


def yaw_pitch_roll_from_matrix(R: ArrayLike, *, unit: AngleUnit) -> Array:
    """Yaw, pitch, roll (..., 3), in `unit`, pitch within 90 degrees. Args: R (..., 3, 3). See `euler_from_matrix`."""
    return euler_from_matrix(R, order="ZYX", unit=unit)


def matrix_from_axis_angle(axis: ArrayLike, angle: ArrayLike, *, unit: AngleUnit) -> Array:
    """Rotation by `angle` about `axis`, right-handed: R = exp(angle * axis / |axis|).

    Args: axis (..., 3), any length but 0; angle (...), in `unit`. Returns (..., 3, 3).
    Raises: InputError for an axis of length 0, values that are not finite.
    """
    a = _finite_array(axis, "a rotation axis", (3,))
    length = np.linalg.norm(a, axis=-1, keepdims=True)
    if np.any(length < 1e-12):
        raise InputError("a rotation axis has length 0; it needs a direction, such as (0, 0, 1)")
    theta = _radians(_finite_array(angle, "a rotation angle", ()), unit)
    return so3.exp(a / length * theta[..., None])


def axis_angle_from_matrix(R: ArrayLike, *, unit: AngleUnit) -> tuple[Array, Array]:
    """Unit axis (..., 3) and angle (...), in `unit`, in [0, 180] degrees. No rotation: axis (1, 0, 0), angle 0.

    Args: R (..., 3, 3). Raises: InputError for a matrix that is not a rotation.
    """
    omega = so3.log(_checked_rotation(R))
    theta = np.linalg.norm(omega, axis=-1)
    still = theta == 0
    axis = np.where(still[..., None], [1.0, 0.0, 0.0], omega / np.where(still, 1.0, theta)[..., None])
    return axis, _from_radians(theta, unit)


def matrix_from_rotation_vector(vector: ArrayLike, *, unit: AngleUnit) -> Array:
    """R = exp(vector): the axis times the angle (OpenCV's rvec and UR's rx, ry, rz are in radians).

    Args: vector (..., 3), in `unit`. Returns (..., 3, 3). Raises: InputError for a wrong shape or NaN.
    """
    return so3.exp(_radians(_finite_array(vector, "a rotation vector", (3,)), unit))


def rotation_vector_from_matrix(R: ArrayLike, *, unit: AngleUnit) -> Array:
    """Rotation vector (..., 3), in `unit`, of length at most 180 degrees. Args: R (..., 3, 3)."""
    return _from_radians(so3.log(_checked_rotation(R)), unit)


def matrix_from_quaternion_wxyz(quaternion: ArrayLike) -> Array:
    """Rotation of a quaternion (w, x, y, z), normalised here (MuJoCo, ABB). Args: (..., 4). Returns (..., 3, 3).

    Raises: InputError for a norm of 0, values that are not finite, a wrong shape.
    """
    return so3.from_quaternion_wxyz(_finite_array(quaternion, "a quaternion", (4,)))


def matrix_from_quaternion_xyzw(quaternion: ArrayLike) -> Array:
    """Rotation of a quaternion (x, y, z, w), normalised here (ROS, SciPy). Args: (..., 4). Returns (..., 3, 3).

    Raises: InputError for a norm of 0, values that are not finite, a wrong shape.
    """
    return so3.from_quaternion_wxyz(wxyz_from_xyzw(quaternion))


def quaternion_wxyz_from_matrix(R: ArrayLike) -> Array:
    """Unit quaternion (w, x, y, z) with w >= 0: (..., 4). Args: R (..., 3, 3). Raises: InputError if not a rotation."""
    return so3.quaternion_wxyz(_checked_rotation(R))


def quaternion_xyzw_from_matrix(R: ArrayLike) -> Array:
    """Unit quaternion (x, y, z, w) with w >= 0: (..., 4). Args: R (..., 3, 3). Raises: InputError if not a rotation."""
    return xyzw_from_wxyz(so3.quaternion_wxyz(_checked_rotation(R)))


def xyzw_from_wxyz(quaternion: ArrayLike) -> Array:
    """Reorder quaternions (..., 4) from (w, x, y, z) to (x, y, z, w)."""
    return np.roll(_finite_array(quaternion, "a quaternion", (4,)), -1, axis=-1)


def wxyz_from_xyzw(quaternion: ArrayLike) -> Array:
    """Reorder quaternions (..., 4) from (x, y, z, w) to (w, x, y, z)."""
    return np.roll(_finite_array(quaternion, "a quaternion", (4,)), 1, axis=-1)


def _intrinsic_angles(R: Array, axes: tuple[int, int, int]) -> Array:
    """Angles (a, b, c) with R = Ri(a) Rj(b) Rk(c), k = i allowed.

    The first angle comes from the third column (Tait-Bryan) or the first axis' column (proper); the other two from
    M = Ri(a)^T R, so that they absorb the rounding of a near gimbal lock and the product stays exact.
    """
    i, j, last = axes
    k = 3 - i - j
    sign = 1.0 if (j - i) % 3 == 1 else -1.0  # +1 when (i, j, k) is a cyclic permutation of (x, y, z)
    proper = last == i
    sine, cosine = (R[..., j, i], -sign * R[..., k, i]) if proper else (-sign * R[..., j, k], R[..., k, k])
    locked = np.hypot(sine, cosine) < _LOCKED
    a = np.where(locked, np.arctan2(sign * R[..., k, j], R[..., j, j]), np.arctan2(sine, cosine))
    M = np.swapaxes(_elementary(i, a), -1, -2) @ R
    if proper:
        b = np.arctan2(-sign * M[..., k, i], M[..., i, i])
        c = np.arctan2(-sign * M[..., j, k], M[..., j, j])
    else:
        b = np.arctan2(sign * M[..., i, k], M[..., k, k])
        c = np.arctan2(sign * M[..., j, i], M[..., j, j])
    return np.stack([a, np.abs(b) if proper else b, np.where(locked, 0.0, c)], axis=-1) + 0.0  # no -0.0 in print


def _elementary(axis: int, angle: Array) -> Array:
    """Rotation by angle (...), radians, about coordinate axis 0, 1 or 2: (..., 3, 3)."""
    j, k = (axis + 1) % 3, (axis + 2) % 3
    out = np.zeros((*np.shape(angle), 3, 3))
    out[..., axis, axis] = 1.0
    out[..., j, j] = out[..., k, k] = np.cos(angle)
    out[..., k, j] = np.sin(angle)
    out[..., j, k] = -out[..., k, j]
    return out


def _parse_order(order: str) -> tuple[tuple[int, int, int], bool]:
    if order not in EULER_ORDERS:
        raise InputError(
            f"unknown Euler order {order!r}; intrinsic (axes turn with the body): {' '.join(INTRINSIC_EULER_ORDERS)}; "
            f"extrinsic (fixed axes): {' '.join(EXTRINSIC_EULER_ORDERS)}"
        )
    first, second, third = ("xyz".index(letter) for letter in order.lower())
    return (first, second, third), order.isupper()


def _radians(angles: Array, unit: str) -> Array:
    return np.deg2rad(angles) if _check_unit(unit) == "deg" else angles


def _from_radians(angles: Array, unit: str) -> Array:
    return np.rad2deg(angles) if _check_unit(unit) == "deg" else angles


def _check_unit(unit: str) -> str:
    if unit not in ("deg", "rad"):
        raise InputError(f"unknown angle unit {unit!r}; expected 'deg' or 'rad'")
    return unit


def _finite_array(values: ArrayLike, what: str, tail: tuple[int, ...]) -> Array:
    a = np.asarray(values, dtype=np.float64)
    if a.shape[a.ndim - len(tail) :] != tail:
        raise InputError(f"{what}: expected shape (..., {', '.join(map(str, tail))}), got {a.shape}")
    if not np.all(np.isfinite(a)):
        raise InputError(f"{what}: NaN or infinite values; every rotation needs finite numbers")
    return a


def _checked_rotation(R: ArrayLike) -> Array:
    """R as floats, checked to be rotations and freed of the rounding of a file. Raises: InputError."""
    m = _finite_array(R, "a rotation matrix", (3, 3))
    good = so3.is_rotation(m, tolerance=_NOT_A_ROTATION)
    if not np.all(good):
        bad = m[~good][0]
        raise InputError(
            f"not a rotation matrix: R R^T differs from the identity by {np.abs(bad @ bad.T - np.eye(3)).max():.2g} "
            f"(allowed {_NOT_A_ROTATION:g}), determinant {np.linalg.det(bad):.4g} (expected 1)"
        )
    return so3.nearest(m)
