"""Target poses from views and a known camera: T_camera_target of every view, with its covariance and its double.

A plane seen with weak perspective has two poses that fit (Schweighofer and Pinz 2006, "Robust pose estimation from a
planar target"): the second is the first with the plane's normal mirrored at the line of sight. Both are refined and
the better one is kept, the other comes with it. A target with depth has its best plane mirrored: the
nearly flat ones have a second pose too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array, Mask
from calibrant.calibrate.classical import planar as planar_start
from calibrant.calibrate.reprojection.factor import ReprojectionFactor, StackedViews, stack
from calibrant.calibrate.reprojection.links import Link
from calibrant.calibrate.starts import any_lens as camera_start
from calibrant.calibrate.starts import with_depth as spatial_start
from calibrant.cameras import Camera
from calibrant.data import View
from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.optimize.levenberg_marquardt import CLOSE_ENOUGH, SolverOptions, solve
from calibrant.optimize.losses import Loss
from calibrant.optimize.manifolds import SE3, Variable, vector
from calibrant.optimize.problem import Problem
from calibrant.optimize.solution import Solution


@dataclass(frozen=True, eq=False)
class TargetPoses:
    """T_camera_target (m, 4, 4) of m views.

    covariance (m, 6, 6) for unit pixel noise: multiply by sigma_px^2; rms_px (m,) per point, both axes;
    doubles (m, 4, 4) the best pose of the mirrored kind, doubles_covariance and doubles_rms_px as above. When that is
    hardly larger, the view cannot tell the two apart; where there is no second minimum the double is the pose itself.
    """

    T_camera_target: Array
    covariance: Array
    rms_px: Array
    doubles: Array
    doubles_covariance: Array
    doubles_rms_px: Array


def target_poses(camera: Camera, views: Sequence[View], *, loss: Loss | None = None, sigma: float = 1.0) -> TargetPoses:
    """Pose of the target in every view by least squares on the reprojection error, camera held.

    loss: squared by default; a robust one needs sigma, the noise per axis in pixels (for weights that differ, of the
    typical point).
    Raises: InputError for a view whose points do not determine a pose, naming it.
    """
    empty = next((v for v in views if not len(v)), None)
    if empty is not None:
        raise InputError(f"view {empty.id!r}: its 0 points determine no pose (fewer than 4, or on a line)")
    stacked = stack(views)
    rays = camera.unproject(stacked.uv)
    lost = ~np.isfinite(rays).all(axis=1)
    if lost.any():
        view = views[int(np.searchsorted(stacked.offsets, np.flatnonzero(lost)[0], side="right") - 1)]
        raise InputError(
            f"view {view.id!r} has points outside the camera's valid field; is it the camera that took it?"
        )
    start, normal, good = _starts(stacked, rays)
    if not good.all():
        view = views[int(np.flatnonzero(~good)[0])]
        raise InputError(f"view {view.id!r}: its {len(view)} points determine no pose (fewer than 4, or on a line)")
    first, first_covariance, first_rms = _refined_poses(camera, stacked, start, loss, sigma)
    mirrored = _mirrored(first, normal, stacked)
    hidden = _hidden(camera, mirrored, stacked)
    mirrored[hidden] = first[hidden]
    second, second_covariance, second_rms = _refined_poses(camera, stacked, mirrored, loss, sigma)
    swap = second_rms < first_rms
    pick = swap[:, None, None]
    return TargetPoses(
        np.where(pick, second, first),
        np.where(pick, second_covariance, first_covariance),
        np.where(swap, second_rms, first_rms),
        np.where(pick, first, second),
        np.where(pick, first_covariance, second_covariance),
        np.where(swap, first_rms, second_rms),
    )


def determine_a_pose(camera: Camera, views: Sequence[View]) -> Mask:
    """Which views (m,) have a pose to start from, before the camera with all their points: four points or more, not on
    a line, that lie as the target has them."""
    there = np.array([len(v) > 0 for v in views])
    shown = [v for v in views if len(v)]
    if not shown:
        return there
    stacked = stack(shown)
    rays = camera.unproject(stacked.uv)
    seen = np.logical_and.reduceat(np.isfinite(rays).all(axis=1), stacked.offsets[:-1])
    start, _, good = _starts(stacked, np.where(np.isfinite(rays), rays, 0.0))
    there[there] = good & (~seen | ~_hidden(camera, np.where(good[:, None, None], start, np.eye(4)), stacked))
    return there


def poses_from(camera: Camera, views: Sequence[View], start: Array) -> Array:
    """T_camera_target (m, 4, 4) of the least reprojection error next to `start` (m, 4, 4), camera held.

    Raises: InputError for a start at which the camera does not see a point.
    """
    return _refined(camera, stack(views), start, None, 1.0, CLOSE_ENOUGH).value("T_camera_target")


def _starts(views: StackedViews, rays: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    """T_camera_target (m, 4, 4), normals (m, 3) of the views' best planes, target frame, and where there is a pose."""
    m = len(views.offsets) - 1
    if spatial_start.is_flat(views.points):
        planar = planar_start.in_plane(views.points)
        T, good = camera_start.poses_of_rays(planar.xy, rays, views.offsets)
        return T @ planar.T_plane_target, np.broadcast_to(planar.T_plane_target[2, :3], (m, 3)), good
    T, good = spatial_start.poses_of_rays(views.points, rays, views.offsets)
    parts = np.split(views.points, views.offsets[1:-1])
    normals = [np.linalg.svd(p - p.mean(axis=0), full_matrices=True)[2][2] for p in parts]
    return T, np.array(normals), good


def _refined_poses(
    camera: Camera, views: StackedViews, start: Array, loss: Loss | None, sigma: float
) -> tuple[Array, Array, Array]:
    """Poses, covariances for noise `sigma` and rms of independent views."""
    solution = _refined(camera, views, start, loss, sigma)
    squares = np.sum(solution.residuals("reprojection") ** 2, axis=1)
    rms = np.sqrt(np.add.reduceat(squares, views.offsets[:-1]) / np.diff(views.offsets))
    return solution.value("T_camera_target"), solution.covariances("T_camera_target"), rms


def _refined(
    camera: Camera,
    views: StackedViews,
    start: Array,
    loss: Loss | None,
    sigma: float,
    options: SolverOptions | None = None,
) -> Solution:
    m = len(start)
    factor = ReprojectionFactor(
        "reprojection",
        model=camera.model,
        camera="camera",
        links=[Link("T_camera_target", np.arange(m))],
        views=views,
        loss=loss,
    )
    held = vector("camera", camera.values, camera.model.parameter_names, held=camera.model.parameter_names)
    problem = Problem((Variable("T_camera_target", SE3(), start), held), (factor,), {"pixel": sigma})
    return solve(problem, options=options)


def _hidden(camera: Camera, T_camera_target: Array, views: StackedViews) -> NDArray[np.bool_]:
    """Which views (m,) have a point that the camera cannot see at these poses."""
    edge = np.repeat(np.arange(len(T_camera_target)), np.diff(views.offsets))
    unseen = ~camera.model.sees(camera.values, se3.apply(T_camera_target[edge], views.points))
    return np.logical_or.reduceat(unseen, views.offsets[:-1])


def _mirrored(T_camera_target: Array, normals: Array, views: StackedViews) -> Array:
    """Poses with the plane's normal (m, 3), target frame, reflected at the line of sight to the points' centroid."""
    counts = np.diff(views.offsets)[:, None]
    centroid = np.add.reduceat(views.points, views.offsets[:-1], axis=0) / counts
    seen = se3.apply(T_camera_target, centroid)
    sight = seen / np.linalg.norm(seen, axis=1, keepdims=True)
    normal = (T_camera_target[:, :3, :3] @ normals[:, :, None])[..., 0]
    target = 2 * np.sum(normal * sight, axis=1, keepdims=True) * sight - normal
    axis = np.cross(normal, target)
    sine = np.linalg.norm(axis, axis=1, keepdims=True)
    angle = np.arctan2(sine[:, 0], np.sum(normal * target, axis=1))
    turn = so3.exp(axis / np.maximum(sine, 1e-12) * angle[:, None])
    R = turn @ T_camera_target[:, :3, :3]
    return se3.make(R, seen - (R @ centroid[:, :, None])[..., 0])
