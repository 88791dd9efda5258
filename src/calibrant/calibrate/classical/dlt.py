"""The direct linear transform (lecture 001, slides 32 to 35): eleven coefficients of a camera by linear least squares.

Slide 32 writes the distortion-free camera, with (X, Y) pixels and (x_w, y_w, z_w) the target, as

    X = (a11 x_w + a12 y_w + a13 z_w + a14) / (a31 x_w + a32 y_w + a33 z_w + a34),    Y likewise with a21 ... a24.

Slide 33 sets a34 = 1 and solves two equations a point for the other eleven; six points that are not coplanar are needed
(slide 34). Two things are done better here: |a| = 1 replaces a34 = 1, which fails where the target's origin lies in the
plane of the lens, and points and pixels are shifted and scaled first (Hartley 1997, "In defense of the eight-point
algorithm"; Hartley and Zisserman, algorithm 7.1). The result is scaled to |(a31, a32, a33)| = 1: a34 is then t_z.

Slide 35 says that R and t cannot be had from the coefficients. From the eleven as they stand they can, K being upper
triangular: P = K [R | t] has one such factorisation with positive focal lengths (Hartley and Zisserman, section 6.2.4).
What is true of the slide is that noise enters K and R together, so that both are poor with few or nearly flat points.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array
from calibrant.calibrate.classical.linear import UNSURE, NullVector, null_vector
from calibrant.calibrate.classical.points import ClassicalCalibration, checked_pairs, dimension, image_centre
from calibrant.calibrate.classical.refusals import (
    BEHIND,
    COPLANAR,
    MIRRORED,
    NO_FOCAL_LENGTH,
    UNDETERMINED,
    Degenerate,
)
from calibrant.cameras import Camera
from calibrant.errors import InputError
from calibrant.geometry import se3, so3

LEAST_POINTS = 6
SECOND_SOLUTION = (
    "a second set of coefficients fits the points as well: they lie nearly in a plane for their noise, or with the "
    "camera on a twisted cubic. Use points that spread further in depth"
)
AFFINE = 1e-9
"""Length of (a31, a32, a33) in normalised coordinates below which all points have one depth: a parallel projection."""


def dlt(points: ArrayLike, uv: ArrayLike) -> Array:
    """The projection matrix P (3, 4) with (X, Y, 1) ~ P (x_w, y_w, z_w, 1), the a_ij of slide 32.

    Each point gives two rows of slide 33's system with a34 among the unknowns:
        [p 1, 0, -X (p 1)] a = 0,    [0, p 1, -Y (p 1)] a = 0.
    Args: points (n, 3) metres, n >= 6, not coplanar; uv (n, 2) px. Returns P with |(a31, a32, a33)| = 1 per metre and
    positive depths P[2] (p 1); the slide's eleven coefficients are P / P[2, 3].
    Raises: Degenerate for too few, collinear or coplanar points, points that leave a second solution,
    points on both sides of the camera.
    """
    p, m = checked_pairs(points, uv, least=LEAST_POINTS, method="the direct linear transform")
    if dimension(p) < 3:
        raise Degenerate(
            COPLANAR,
            f"all {len(p)} points lie in a plane, where columns of the direct linear transform's system depend on each "
            "other (slide 34). Use points with depth; for a flat target Zhang's method with several views, or Tsai's "
            "for coplanar points with one",
        )
    T, S = _normalising(p), _normalising(m)
    q, n = _mapped(T, p), _mapped(S, m)
    zero = np.zeros_like(q)
    found = null_vector(np.concatenate([np.hstack([q, zero, -n[:, :1] * q]), np.hstack([zero, q, -n[:, 1:2] * q])]))
    if not found.determined:
        raise Degenerate(UNDETERMINED, SECOND_SOLUTION)
    normalised = found.values.reshape(3, 4)
    if np.linalg.norm(normalised[2, :3]) < AFFINE * np.linalg.norm(normalised):
        raise Degenerate(
            NO_FOCAL_LENGTH, "all points have one depth in the image: a telecentric lens, or points too far away"
        )
    P = np.asarray(np.linalg.solve(S, normalised @ T), dtype=np.float64)
    P /= np.linalg.norm(P[2, :3])
    depth = p @ P[2, :3] + P[2, 3]
    if depth.sum() < 0:
        P, depth = -P, -depth
    if np.any(depth <= 0):
        raise Degenerate(
            BEHIND,
            f"the camera that fits best has {int(np.sum(depth <= 0))} of {len(p)} points behind it; check that pixels "
            "and points are in the same order",
        )
    if not _directions_known(found):
        raise Degenerate(UNDETERMINED, SECOND_SOLUTION)
    return P


def decompose(P: ArrayLike) -> tuple[Array, Array]:
    """K and T_camera_target of a projection matrix: P ~ K [R | t], K upper triangular with f_x, f_y > 0.

    The factorisation of P[:, :3] is a QR factorisation with its rows in reverse (Hartley and Zisserman, section 6.2.4).
    Args: P (3, 4) as `dlt` returns it, its sign such that depths are positive.
    Returns K (3, 3), px, with skew in K[0, 1]; T_camera_target (4, 4), metres.
    Raises: InputError for another shape; Degenerate for a singular or mirrored P.
    """
    given = np.asarray(P, dtype=np.float64)
    if given.shape != (3, 4) or not np.all(np.isfinite(given)):
        raise InputError(f"a projection matrix is (3, 4) and finite, got shape {given.shape}")
    M = given[:, :3] / np.linalg.norm(given[2, :3])
    if np.linalg.det(M) <= 0:
        raise Degenerate(
            MIRRORED,
            "the points' mirror image fits the pixels, the points themselves do not: check that x, y, z form a "
            "right-handed frame, and that the picture is not mirrored (--mirror-x)",
        )
    Q, U = np.linalg.qr(M[::-1].T)
    K, R = U.T[::-1, ::-1], Q.T[::-1]
    sign = np.where(np.diag(K) < 0, -1.0, 1.0)
    K, R = np.asarray(K * sign, dtype=np.float64), R * sign[:, None]
    t = np.linalg.solve(K, given[:, 3] / np.linalg.norm(given[2, :3]))
    return K / K[2, 2], se3.make(so3.nearest(R), t)


def calibrate_dlt(points: ArrayLike, uv: ArrayLike, *, image_size: tuple[int, int]) -> ClassicalCalibration:
    """A camera with skew, and its pose, from one view of points with depth: `dlt`, then `decompose`.

    Args: points (n, 3) metres, n >= 6; uv (n, 2) px; image_size (width, height). Raises: as both.
    """
    image_centre(image_size, None)
    K, T = decompose(dlt(points, uv))
    return ClassicalCalibration(camera_of(K, image_size), T[None])


def camera_of(K: Array, image_size: tuple[int, int]) -> Camera:
    """The pinhole camera with skew that K (3, 3), px, stands for."""
    names = {"fx": K[0, 0], "fy": K[1, 1], "cx": K[0, 2], "cy": K[1, 2], "skew": K[0, 1]}
    return Camera.create("pinhole_skew", {n: float(v) for n, v in names.items()}, image_size=image_size)


def _directions_known(found: NullVector) -> bool:
    """Whether the coefficients of x_w, y_w, z_w stand out of the noise in every row, as nearly flat points' do not."""
    sigma = np.sqrt(np.maximum(np.diag(found.covariance), 0)).reshape(3, 4)[:, :3]
    rows = found.values.reshape(3, 4)[:, :3]
    return bool(np.all(np.linalg.norm(sigma, axis=1) < UNSURE * np.linalg.norm(rows, axis=1)))


def _normalising(points: Array) -> Array:
    """Shift and scale (d + 1, d + 1) that bring points (n, d) to mean 0 and mean square radius d."""
    d = points.shape[1]
    centre = points.mean(axis=0)
    scale = np.sqrt(d / np.mean(np.sum((points - centre) ** 2, axis=1)))
    return np.block([[scale * np.eye(d), -scale * centre[:, None]], [np.zeros((1, d)), np.ones((1, 1))]])


def _mapped(similarity: Array, points: Array) -> Array:
    """Homogeneous coordinates (n, d + 1) of the mapped points."""
    return np.column_stack([points, np.ones(len(points))]) @ similarity.T
