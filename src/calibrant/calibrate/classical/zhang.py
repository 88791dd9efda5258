"""Zhang's closed form from homographies of several views of a plane (Zhang 2000, "A flexible new technique for camera
calibration"), and its form for one view.

A view's homography is H = (h1 h2 h3) ~ K (r1 r2 t), so with B = K^-T K^-1 every view says

    h1^T B h2 = 0,    h1^T B h1 = h2^T B h2,

two linear equations in the six elements of B up to scale. K follows from B by a Cholesky factorisation, the poses from
K^-1 H. The method is not on the slides; it is what replaced those that are. Its start inside `calibrate_intrinsics`,
`planar_start.focal_lengths`, is the form with a known principal point, which also serves one view here.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array
from calibrant.calibrate.classical import planar as planar_start
from calibrant.calibrate.classical.alignment import FACING
from calibrant.calibrate.classical.dlt import camera_of
from calibrant.calibrate.classical.linear import SIGMAS, least_squares, null_vector
from calibrant.calibrate.classical.points import (
    ClassicalCalibration,
    assumed,
    checked_pairs,
    dimension,
    image_centre,
)
from calibrant.calibrate.classical.refusals import (
    BEHIND,
    COLLINEAR,
    FRONTO_PARALLEL,
    NO_FOCAL_LENGTH,
    NOT_COPLANAR,
    PARALLEL_PLANES,
    TOO_FEW_VIEWS,
    Degenerate,
)
from calibrant.cameras import Camera
from calibrant.errors import InputError
from calibrant.geometry import se3
from calibrant.geometry.projective import homographies

Skew = Literal["zero", "free"]

LEAST_POINTS = 4
LEAST_VIEWS = {"zero": 2, "free": 3}


def calibrate_zhang(
    points: Sequence[ArrayLike], uv: Sequence[ArrayLike], *, image_size: tuple[int, int], skew: Skew = "zero"
) -> ClassicalCalibration:
    """Focal lengths, principal point and all poses from views of a plane at different tilts; no distortion.

    Args: for each view, points (n_i, 3) metres in one plane and uv (n_i, 2) px; skew "zero" (two views or more) or
    "free" (three or more). Returns a pinhole camera (with skew when free) and a pose a view.
    Raises: InputError for unusable arguments; Degenerate for too few views or points, collinear points, points
    with depth, planes that are all parallel, no positive focal lengths.
    """
    if skew not in get_args(Skew):
        raise InputError(f"skew is zero or free, got {skew!r}")
    if len(points) < LEAST_VIEWS[skew] and len(points) == len(uv):
        raise Degenerate(
            TOO_FEW_VIEWS,
            f"Zhang's method with {skew} skew needs {LEAST_VIEWS[skew]} views, got {len(points)}; for one view hold "
            "the principal point: Tsai's method, or calibrate_zhang_one_view",
        )
    xy, m, T_plane_target = _planes(points, uv)
    H = _homographies(xy, m)
    shift = _towards_unity(image_size)
    K = np.asarray(np.linalg.solve(shift, _camera_matrix(shift @ H, skew)), dtype=np.float64)
    camera = camera_of(K, image_size) if skew == "free" else _pinhole(K, image_size)
    return ClassicalCalibration(camera, _poses_in_front(H, K, xy) @ T_plane_target)


def calibrate_zhang_one_view(
    points: ArrayLike, uv: ArrayLike, *, image_size: tuple[int, int], centre: ArrayLike | None = None
) -> ClassicalCalibration:
    """Focal lengths and pose from one view of a plane with a known principal point: the two equations above.

    Args: points (n, 3) metres in a plane; uv (n, 2) px; centre (2,) px, the image's middle when not given.
    Raises: InputError, Degenerate as `calibrate_zhang`; fronto-parallel where the view shows no focal length.
    """
    middle = image_centre(image_size, centre)
    xy, m, T_plane_target = _planes([points], [uv])
    H = _homographies(xy, m)
    focal = planar_start.focal_lengths(H, middle) if _shows_perspective(xy[0], m[0]) else None
    if focal is None:
        raise Degenerate(
            FRONTO_PARALLEL,
            "the homography shows no focal length: the plane faces the camera, or leans about an image axis by too "
            "little. Tilt the target 20 to 45 degrees",
        )
    K = np.array([[focal[0], 0, middle[0]], [0, focal[1], middle[1]], [0, 0, 1]])
    unsaid = assumed(middle, centre, takes_aspect=False)
    return ClassicalCalibration(_pinhole(K, image_size), _poses_in_front(H, K, xy) @ T_plane_target, unsaid)


def zhang_distortion(
    found: ClassicalCalibration, points: Sequence[ArrayLike], uv: Sequence[ArrayLike]
) -> ClassicalCalibration:
    """k1 and k2 by linear least squares, camera and poses held (Zhang 2000, eq. 13): slide 47's, distort-ward.

        [(u - c_x) s, (u - c_x) s^2] (k1, k2)^T = u_seen - u,    s = x^2 + y^2, u ideal; the same with v
    The camera and poses were found without distortion and carry part of it, so the terms come out small: a start.
    Args: found as `calibrate_zhang` with zero skew returns it; points and uv as it took them. Returns a `brown` camera.
    Raises: InputError for a camera with skew, or other views.
    """
    if found.camera.model.name != "pinhole" or len(found.T_camera_target) != len(points) or len(points) != len(uv):
        raise InputError("radial terms belong to a pinhole camera without skew and to the views that it came from")
    rows, right = [], []
    for T, p, m in zip(found.T_camera_target, points, uv):
        q = se3.apply(T, p)
        s = np.sum((q[:, :2] / q[:, 2:]) ** 2, axis=1)[:, None]
        ideal = found.camera.project(q)
        offset = ideal - found.camera.K[:2, 2]
        rows.append(np.stack([(offset * s).ravel(), (offset * s * s).ravel()], axis=1))
        right.append((np.asarray(m, dtype=np.float64) - ideal).ravel())
    k1, k2 = least_squares(np.concatenate(rows), np.concatenate(right))
    terms = {"k1": float(k1), "k2": float(k2)}
    camera = Camera.create("brown", found.camera.parameters | terms, image_size=found.camera.image_size)
    return ClassicalCalibration(camera, found.T_camera_target)


def _camera_matrix(H: Array, skew: Skew) -> Array:
    """K (3, 3) of homographies (m, 3, 3) into coordinates of about unit size."""
    H = H / np.linalg.norm(H[:, :, :2], axis=(1, 2), keepdims=True)
    a, b = H[:, :, 0], H[:, :, 1]
    rows = np.concatenate([_products(a, b), _products(a, a) - _products(b, b)])
    keep = [0, 1, 2, 3, 4, 5] if skew == "free" else [0, 2, 3, 4, 5]
    found = null_vector(rows[:, keep])
    if not found.determined:
        raise Degenerate(
            PARALLEL_PLANES,
            "the views determine no camera: the planes are parallel, or too nearly so for their noise. Tilt the target "
            "20 to 45 degrees in different directions",
        )
    elements = np.zeros(6)
    elements[keep] = found.values
    b11, b12, b22, b13, b23, b33 = elements
    B = np.array([[b11, b12, b13], [b12, b22, b23], [b13, b23, b33]]) * np.sign(b11 + b22)
    if np.linalg.eigvalsh(B)[0] <= 0:
        raise Degenerate(
            NO_FOCAL_LENGTH,
            "no camera with positive focal lengths fits the homographies: the tilts are too small for the noise, or "
            "points and pixels are in different order",
        )
    K = np.linalg.inv(np.linalg.cholesky(B).T)
    return np.asarray(K / K[2, 2])


def _shows_perspective(xy: Array, uv: Array) -> bool:
    """Whether a homography's last row stands out of its noise: where depth does not change, nor does scale."""
    p, n = ((a - a.mean(axis=0)) / np.std(a) for a in (xy, uv))
    p = np.column_stack([p, np.ones(len(p))])
    zero = np.zeros_like(p)
    found = null_vector(np.concatenate([np.hstack([p, zero, -n[:, :1] * p]), np.hstack([zero, p, -n[:, 1:] * p])]))
    row = found.values[6:8] / found.values[8]
    noise = np.sqrt(max(np.linalg.eigvalsh(found.covariance[6:8, 6:8])[-1], 0.0)) / abs(found.values[8])
    return bool(np.linalg.norm(row) > max(FACING, SIGMAS * noise))


def _products(a: Array, b: Array) -> Array:
    """v with a^T B b = v . (B11, B12, B22, B13, B23, B33), rows (m, 6)."""
    return np.stack(
        [
            a[:, 0] * b[:, 0],
            a[:, 0] * b[:, 1] + a[:, 1] * b[:, 0],
            a[:, 1] * b[:, 1],
            a[:, 2] * b[:, 0] + a[:, 0] * b[:, 2],
            a[:, 2] * b[:, 1] + a[:, 1] * b[:, 2],
            a[:, 2] * b[:, 2],
        ],
        axis=1,
    )


def _planes(points: Sequence[ArrayLike], uv: Sequence[ArrayLike]) -> tuple[list[Array], list[Array], Array]:
    """Coordinates (n_i, 2) of every view's points in their common plane, the pixels, and T_plane_target (4, 4)."""
    if len(points) != len(uv):
        raise InputError(f"points has {len(points)} views and uv has {len(uv)}; give one of each a view")
    pairs = [checked_pairs(p, m, least=LEAST_POINTS, method="a view's homography") for p, m in zip(points, uv)]
    together = np.concatenate([p for p, _ in pairs])
    if dimension(together) > 2:
        raise Degenerate(NOT_COPLANAR, "Zhang's method takes points of one plane; for points with depth use the DLT")
    plane = planar_start.in_plane(together)
    ends = np.cumsum([len(p) for p, _ in pairs])[:-1]
    return np.split(plane.xy, ends), [m for _, m in pairs], plane.T_plane_target


def _homographies(xy: Sequence[Array], uv: Sequence[Array]) -> Array:
    """Homographies (m, 3, 3). Raises: Degenerate where all points of a view but one lie on a line."""
    try:
        return homographies(xy, uv)
    except InputError as error:
        raise Degenerate(COLLINEAR, str(error)) from error


def _poses_in_front(H: Array, K: Array, xy: Sequence[Array]) -> Array:
    """T_camera_plane (m, 4, 4) of homographies. Raises: Degenerate where a point would be behind the camera."""
    T = planar_start.poses(H, K)
    for i, (pose, points) in enumerate(zip(T, xy)):
        if np.any(points @ pose[2, :2] + pose[2, 3] <= 0):
            raise Degenerate(
                BEHIND,
                f"the camera that fits best has points of view {i} behind it; check that points and pixels are in the "
                "same order, and take more points or larger tilts",
            )
    return T


def _towards_unity(image_size: tuple[int, int]) -> Array:
    """Shift and scale (3, 3) of pixels about the image's middle, by half its diagonal."""
    middle, half = image_centre(image_size, None), float(np.hypot(*image_size)) / 2
    return np.array([[1 / half, 0, -middle[0] / half], [0, 1 / half, -middle[1] / half], [0, 0, 1]])


def _pinhole(K: Array, image_size: tuple[int, int]) -> Camera:
    names = {"fx": K[0, 0], "fy": K[1, 1], "cx": K[0, 2], "cy": K[1, 2]}
    return Camera.create("pinhole", {n: float(v) for n, v in names.items()}, image_size=image_size)
