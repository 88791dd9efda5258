"""Target poses from views and a known camera: T_camera_target of every view, with its covariance and its double.

A plane seen with weak perspective has two poses that fit (Schweighofer and Pinz 2006, "Robust pose estimation from a
planar target"): the second is the first with the plane's normal mirrored at the line of sight. Both are refined and
the better one is kept; `ambiguity` says how much better it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrant.calibrate import camera_start, planar_start
from calibrant.calibrate.chain import Link
from calibrant.calibrate.reprojection import ReprojectionFactor, StackedViews, stack
from calibrant.cameras import Camera
from calibrant.data import View
from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.optimize.levenberg_marquardt import solve
from calibrant.optimize.losses import Loss
from calibrant.optimize.manifolds import SE3, Variable, vector
from calibrant.optimize.problem import Problem

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class TargetPoses:
    """T_camera_target (m, 4, 4) of m views.

    covariance (m, 6, 6) for unit pixel noise: multiply by sigma_px^2; rms_px (m,) per point, both axes;
    doubles (m, 4, 4) the best pose of the mirrored kind, doubles_rms_px its residual. When that is hardly larger,
    the view cannot tell the two apart.
    """

    T_camera_target: Array
    covariance: Array
    rms_px: Array
    doubles: Array
    doubles_rms_px: Array


def target_poses(camera: Camera, views: Sequence[View], *, loss: Loss | None = None, sigma: float = 1.0) -> TargetPoses:
    """Pose of the target in every view by least squares on the reprojection error, camera held.

    loss: squared by default; a robust one needs sigma, the noise per axis in pixels (for weights that differ, of the
    typical point).
    Raises: InputError for a view whose points do not determine a pose, naming it.
    """
    stacked = stack(views)
    planar = planar_start.in_plane(stacked.points)
    rays = camera.unproject(stacked.uv)
    lost = ~np.isfinite(rays).all(axis=1)
    if lost.any():
        view = views[int(np.searchsorted(stacked.offsets, np.flatnonzero(lost)[0], side="right") - 1)]
        raise InputError(
            f"view {view.id!r} has points outside the camera's valid field; is it the camera that took it?"
        )
    T_plane, good = camera_start.poses_of_rays(planar.xy, rays, stacked.offsets)
    if not good.all():
        view = views[int(np.flatnonzero(~good)[0])]
        raise InputError(f"view {view.id!r}: its {len(view)} points determine no pose (fewer than 4, or on a line)")
    first, first_covariance, first_rms = _refine(camera, stacked, T_plane @ planar.T_plane_target, loss, sigma)
    mirrored = _mirrored(first @ se3.inverse(planar.T_plane_target), planar.xy, stacked)
    hidden = _hidden(camera, mirrored @ planar.T_plane_target, stacked)
    mirrored[hidden] = (first @ se3.inverse(planar.T_plane_target))[hidden]
    second, second_covariance, second_rms = _refine(camera, stacked, mirrored @ planar.T_plane_target, loss, sigma)
    swap = second_rms < first_rms
    pick = swap[:, None, None]
    return TargetPoses(
        np.where(pick, second, first),
        np.where(pick, second_covariance, first_covariance),
        np.where(swap, second_rms, first_rms),
        np.where(pick, first, second),
        np.where(swap, first_rms, second_rms),
    )


def _refine(
    camera: Camera, views: StackedViews, start: Array, loss: Loss | None, sigma: float
) -> tuple[Array, Array, Array]:
    """Poses, covariances for noise `sigma` and rms of independent views."""
    m = len(start)
    factor = ReprojectionFactor(
        "reprojection",
        model=camera.model,
        camera="camera",
        chain=[Link("T_camera_target", np.arange(m))],
        views=views,
        loss=loss,
    )
    held = vector("camera", camera.values, camera.model.parameter_names, held=camera.model.parameter_names)
    problem = Problem((Variable("T_camera_target", SE3(), start), held), (factor,), {"pixel": sigma})
    solution = solve(problem)
    squares = np.sum(solution.residuals("reprojection") ** 2, axis=1)
    rms = np.sqrt(np.add.reduceat(squares, views.offsets[:-1]) / np.diff(views.offsets))
    return solution.value("T_camera_target"), solution.covariances("T_camera_target"), rms


def _hidden(camera: Camera, T_camera_target: Array, views: StackedViews) -> NDArray[np.bool_]:
    """Which views (m,) have a point that the camera cannot see at these poses."""
    edge = np.repeat(np.arange(len(T_camera_target)), np.diff(views.offsets))
    unseen = ~camera.model.sees(camera.values, se3.apply(T_camera_target[edge], views.points))
    return np.logical_or.reduceat(unseen, views.offsets[:-1])


def _mirrored(T_camera_plane: Array, xy: Array, views: StackedViews) -> Array:
    """Poses with the plane's normal reflected at the line of sight to the points' centroid, centroid kept."""
    counts = np.diff(views.offsets)[:, None]
    centroid = np.concatenate(
        [np.add.reduceat(xy, views.offsets[:-1], axis=0) / counts, np.zeros((len(counts), 1))], axis=1
    )
    seen = se3.apply(T_camera_plane, centroid)
    sight = seen / np.linalg.norm(seen, axis=1, keepdims=True)
    normal = T_camera_plane[:, :3, 2]
    target = 2 * np.sum(normal * sight, axis=1, keepdims=True) * sight - normal
    axis = np.cross(normal, target)
    sine = np.linalg.norm(axis, axis=1, keepdims=True)
    angle = np.arctan2(sine[:, 0], np.sum(normal * target, axis=1))
    turn = so3.exp(axis / np.maximum(sine, 1e-12) * angle[:, None])
    R = turn @ T_camera_plane[:, :3, :3]
    return se3.make(R, seen - (R @ centroid[:, :, None])[..., 0])
