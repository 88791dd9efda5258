"""Closed-form start for targets with depth: poses from rays of any camera, and a first camera from the DLT.

A view of points in space and a known camera give a pose by the direct linear transform on the rays (`classical.dlt`
with K = I), turned so that their mean is the axis. Few or nearly flat points do not determine its eleven coefficients,
a pose they do: three points leave up to four (Grunert 1841; Haralick, Lee, Ottenberg and Nolle 1994, "Review and
analysis of solutions of the three point perspective pose estimation problem"), and the others choose. Views that show
one plane of the target start as planes do.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.calibrate.classical.planar import PlaneViews, in_plane, see_plane
from calibrant.calibrate.reprojection.factor import StackedViews
from calibrant.calibrate.starts import any_lens as camera_start
from calibrant.cameras import Camera, CameraModel
from calibrant.errors import InputError
from calibrant.geometry import se3, so3

FEWEST_POINTS = 4
SPREAD_POINTS = 5
"""Points whose triples are tried: ten triples, of which one is well spread in any target."""
IN_FRONT = 1e-3
"""Cosine to the mean ray below which a point is beside the camera, where normalised coordinates have no bound."""
FLAT = 1e-6
"""Thickness over length below which points are taken as a plane, as `planar_start.in_plane` takes them."""


@dataclass(frozen=True, eq=False)
class SolidViews:
    """Views of a target with depth, and which of them (m,) have points enough for a pose."""

    good: NDArray[np.bool_]

    def only(self, views: StackedViews, keep: NDArray[np.bool_]) -> SolidViews:
        """The views where keep (m,) is true."""
        return SolidViews(self.good[keep])


def see_target(views: StackedViews) -> PlaneViews | SolidViews:
    """What the views show of a flat target, or of one with depth."""
    if is_flat(views.points):
        return see_plane(views)
    from calibrant.calibrate.classical.points import dimension  # flat targets, the ordinary ones, go without

    parts = np.split(views.points, views.offsets[1:-1])
    return SolidViews(np.array([len(p) >= FEWEST_POINTS and dimension(p) > 1 for p in parts]))


def is_flat(points: Array) -> bool:
    """Whether target points (N, 3) lie in one plane."""
    if np.all(points[:, 2] == 0):
        return True
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(spread[2] <= FLAT * spread[0])


def start_parameters(
    views: StackedViews, kind: CameraModel, image_size: tuple[int, int], *, initial: Camera | None
) -> tuple[Array, Array]:
    """Parameters (k,) and T_camera_target (m, 4, 4) to start the refinement of a target with depth from.

    Raises: InputError when there is no `initial` and the views give none.
    """
    if initial is None:
        parameters = first_camera(views, kind, image_size)
    else:
        parameters = camera_start.transferred(initial, kind, views.uv)
    T, _ = poses_of_rays(views.points, camera_start.rays_of(kind, parameters, views.uv), views.offsets)
    return parameters, T


def first_camera(views: StackedViews, kind: CameraModel, image_size: tuple[int, int]) -> Array:
    """Parameters (k,) from the views' direct linear transforms: their median focal length, the image's centre.

    Raises: InputError when no view determines them: then a start value is needed.
    """
    from calibrant.calibrate.classical.dlt import LEAST_POINTS, calibrate_dlt
    from calibrant.calibrate.classical.refusals import Degenerate

    found, reasons = [], []
    for points, uv in zip(np.split(views.points, views.offsets[1:-1]), np.split(views.uv, views.offsets[1:-1])):
        try:
            camera = calibrate_dlt(points, uv, image_size=image_size).camera
        except Degenerate as refusal:
            reasons.append(str(refusal))
        else:
            found.append(np.sqrt(camera.parameters["fx"] * camera.parameters["fy"]))
    if not found:
        raise InputError(
            "a target with depth needs a start value of the camera, or a view from which the direct linear transform "
            f"gives one ({LEAST_POINTS} points that are not in a plane): give --initial camera.json. The views say: "
            f"{reasons[0]}"
        )
    f = float(np.median(found))
    centre = (np.array(image_size, dtype=np.float64) - 1) / 2
    start = {"fx": f, "fy": f, "cx": float(centre[0]), "cy": float(centre[1])}
    return camera_start.transferred(Camera.create("pinhole", start, image_size=image_size), kind, views.uv)


def poses_of_rays(points: Array, rays: Array, offsets: NDArray[np.int64]) -> tuple[Array, NDArray[np.bool_]]:
    """T_camera_target (m, 4, 4) from target points (N, 3) and their rays (N, 3), and which views determine theirs."""
    m = len(offsets) - 1
    T, good = np.tile(np.eye(4), (m, 1, 1)), np.zeros(m, dtype=np.bool_)
    T[:, 2, 3] = 1.0
    unit = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    for i in range(m):
        rows = slice(offsets[i], offsets[i + 1])
        pose = _pose_of_rays(points[rows], unit[rows])
        if pose is not None:
            T[i], good[i] = pose, True
    return T, good


def _pose_of_rays(points: Array, rays: Array) -> Array | None:
    """The candidate that sees the points nearest to their rays; None when the points determine no pose."""
    from calibrant.calibrate.classical.points import dimension

    if len(points) < FEWEST_POINTS or dimension(points) < 2:
        return None
    if is_flat(points):
        planar = in_plane(points)
        T, good = camera_start.poses_of_rays(planar.xy, rays, np.array([0, len(points)]))
        return T[0] @ planar.T_plane_target if good[0] else None
    candidates = [*_by_dlt(points, rays), *_by_triples(points, rays)]
    return min(candidates, key=lambda T: _ray_misfit(T, points, rays)) if candidates else None


def _by_dlt(points: Array, rays: Array) -> list[Array]:
    from calibrant.calibrate.classical.dlt import LEAST_POINTS, dlt
    from calibrant.calibrate.classical.refusals import Degenerate

    turn = camera_start.onto_axis(rays.mean(axis=0)[None])[0]
    turned = rays @ turn.T
    if len(points) < LEAST_POINTS or turned[:, 2].min() < IN_FRONT:
        return []
    try:
        P = dlt(points, turned[:, :2] / turned[:, 2:])
    except Degenerate:
        return []  # too flat for eleven coefficients: the triples find its six
    T = se3.make(so3.nearest(P[:, :3]), P[:, 3])
    return [se3.make(turn.T, np.zeros(3)) @ T]


def _ray_misfit(T: Array, points: Array, rays: Array) -> float:
    """Sum of squared sines between points and rays; a point behind its ray counts as one at right angles and more."""
    p = se3.apply(T, points)
    cosine = np.sum(p * rays, axis=1) / np.linalg.norm(p, axis=1)
    return float(np.sum(np.where(cosine > 0, 1 - cosine**2, 2.0)))


def _by_triples(points: Array, rays: Array) -> list[Array]:
    """Poses of all triples of a few points far from each other."""
    picked = [int(np.argmax(np.linalg.norm(points - points.mean(axis=0), axis=1)))]
    while len(picked) < min(SPREAD_POINTS, len(points)):
        nearest = np.min(np.linalg.norm(points[:, None] - points[picked], axis=2), axis=1)
        picked.append(int(np.argmax(nearest)))
    return [T for t in combinations(picked, 3) for T in three_point_poses(points[list(t)], rays[list(t)])]


def three_point_poses(points: Array, rays: Array) -> list[Array]:
    """Up to four T_camera_target that see three points (3, 3) along three unit rays (3, 3); none for a line.

    Distances s1, s2 = u s1, s3 = v s1 of the points from the camera satisfy the three laws of cosines; eliminating u
    leaves Grunert's quartic in v (Haralick et al. 1994, equations 9 to 11), with a, b, c the sides opposite to the
    points and alpha, beta, gamma the angles between the rays there.
    """
    p1, p2, p3 = points
    a2, b2, c2 = (float(np.sum(d * d)) for d in (p2 - p3, p1 - p3, p1 - p2))
    if np.linalg.norm(np.cross(p2 - p1, p3 - p1)) <= FLAT * max(a2, b2, c2):
        return []
    alpha, beta, gamma = float(rays[1] @ rays[2]), float(rays[0] @ rays[2]), float(rays[0] @ rays[1])
    q, plus = (a2 - c2) / b2, (a2 + c2) / b2
    quartic = [
        (q - 1) ** 2 - 4 * c2 / b2 * alpha**2,
        4 * (q * (1 - q) * beta - (1 - plus) * alpha * gamma + 2 * c2 / b2 * alpha**2 * beta),
        2
        * (
            q**2 - 1 + 2 * q**2 * beta**2 + 2 * (b2 - c2) / b2 * alpha**2
            - 4 * plus * alpha * beta * gamma + 2 * (b2 - a2) / b2 * gamma**2
        ),
        4 * (-q * (1 + q) * beta + 2 * a2 / b2 * gamma**2 * beta - (1 - plus) * alpha * gamma),
        (1 + q) ** 2 - 4 * a2 / b2 * gamma**2,
    ]  # fmt: skip
    poses = []
    for root in np.roots(quartic):
        v = float(root.real)
        # Noise turns a double root into a pair of complex ones: their real part is the start that refinement needs.
        if abs(root.imag) > 0.1 * abs(root) or v <= 0:
            continue
        below, square = gamma - v * alpha, 1 + v * v - 2 * v * beta
        if abs(below) < 1e-12 or square <= 0:
            continue
        u = ((q - 1) * v * v - 2 * q * beta * v + 1 + q) / (2 * below)
        if u > 0:
            s = np.sqrt(b2 / square) * np.array([1.0, u, v])
            poses.append(_aligned_points(points, s[:, None] * rays))
    return poses


def _aligned_points(points: Array, seen: Array) -> Array:
    """The transform that brings points (n, 3) nearest to where they are seen (n, 3) (Kabsch 1976)."""
    middle, place = points.mean(axis=0), seen.mean(axis=0)
    R = so3.nearest((seen - place).T @ (points - middle))
    return se3.make(R, place - R @ middle)
