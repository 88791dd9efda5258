"""Teaching: what the camera sees from where it is wanted, from its own pictures or, beforehand, from stereo."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.calibrate.pose.target_poses import target_poses
from calibrant.cameras import Camera
from calibrant.data import View
from calibrant.data.records.servoing import TaughtFeatures
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3, so3, triangulation
from calibrant.servoing.sight.eye import Eye
from calibrant.servoing.sight.features import Features, averaged, features_of
from calibrant.servoing.sight.mounting import Setup

LEAST_SHARED = 4
PICTURES = 40
"""Of one place: the wanted pose is then six times as certain as one picture tells, and seldom the weaker part."""


def taught_by(eye: Eye, pictures: int = PICTURES) -> Features:
    """What the eye sees now, the mean of several pictures; camera and target stand still meanwhile.

    Raises: RefusedError when the target is not in all of them; DeviceError as the camera.
    """
    if pictures < 1:
        raise InputError(f"teaching takes 1 picture or more, asked for {pictures}")
    seen: list[Features] = []
    for k in range(pictures):
        found = eye.look(seen[-1] if seen else None)
        if isinstance(found, str):
            raise RefusedError(
                f"picture {k + 1} of {pictures} does not show the target: {found}. Teach from a place from "
                f"which camera {eye.source.name} sees all of it"
            )
        seen.append(found)
    return averaged(seen)


def taught_in(camera: Camera, views: Sequence[View], *, sigma_px: float = 0.2) -> tuple[Features, float]:
    """The mean of what pictures of one place show, and how far they scatter, in sigmas of their points.

    Raises: InputError for views that determine no pose, or share fewer points than one has; RefusedError for none.
    """
    if not views:
        raise RefusedError("no picture shows the target: teach from a place from which the camera sees all of it")
    poses = target_poses(camera, views).T_camera_target
    several = []
    for view, T in zip(views, poses):
        sigma = np.full(len(view), sigma_px) if view.sigma_px is None else view.sigma_px
        depth = se3.apply(T, view.points)[:, 2]
        several.append(
            features_of(camera, view.point_ids, view.uv, sigma, depth, points=view.points, T_camera_target=T)
        )
    mean = averaged(several)
    if len(mean) < LEAST_SHARED:
        raise InputError(
            f"the {len(views)} pictures share {len(mean)} points; {LEAST_SHARED} are needed: were they taken from one "
            "place?"
        )
    return mean, told_apart(mean, several) if len(several) > 1 else 1.0


def placed(points: Array, measured: Array) -> Array:
    """T_measured_points (4, 4) that brings a target's points (n, 3) nearest to those measured, in another frame.

    R = nearest rotation to sum of (m - m_mean)(p - p_mean)^T (Arun, Huang and Blostein 1987).
    """
    p, m = points.mean(axis=0), measured.mean(axis=0)
    U, _, Vt = np.linalg.svd((measured - m).T @ (points - p))
    R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    return se3.make(R, m - R @ p)


def facing(points: Array, distance: float, *, turn: float = 0.0) -> Array:
    """T_camera_target (4, 4) of a camera that looks straight at the middle of points (n, 3) from a distance, metres.

    The target's z points away from who looks at it: the camera looks along it, its x along the target's, turned about
    its line of sight by `turn`, radians.
    """
    R = so3.exp([0.0, 0.0, -turn])
    return se3.make(R, np.array([0.0, 0.0, distance]) - R @ points.mean(axis=0))


def seen_from(
    camera: Camera, ids: NDArray[np.int64], points: Array, T_camera_points: Array, covariance: Array | None = None
) -> Features:
    """What a camera will see of points (n, 3) from a pose; covariance (n, 3, 3) of the points, m^2.

    Raises: RefusedError for points that will not be in the picture.
    """
    p = se3.apply(T_camera_points, points)
    uv, slope, _ = camera.model.project_with_jacobians(camera.values, p)
    size = np.array(camera.image_size)
    if not np.isfinite(uv).all() or np.any(uv < 0) or np.any(uv > size - 1):
        inside = int(np.sum(np.all((uv >= 0) & (uv <= size - 1), axis=1)))
        raise RefusedError(
            f"from the wanted pose the camera sees {inside} of {len(points)} features: stand farther away, or turn"
        )
    sigma = np.full(len(points), 1e-3)
    if covariance is not None:
        J = slope @ T_camera_points[:3, :3]
        C = np.einsum("nij,njk,nlk->nil", J, covariance, J)
        sigma = np.sqrt(0.5 * np.trace(C, axis1=1, axis2=2) + 1e-6)
    return features_of(camera, ids, uv, sigma, p[:, 2], points=points, T_camera_target=T_camera_points)


def by_stereo(
    left: Camera, right: Camera, T_left_right: Array, uv_left: Array, uv_right: Array, sigma_px: float
) -> tuple[Array, Array]:
    """Points (n, 3) in the left camera's frame, metres, from pixels (n, 2) of both, and their covariance (n, 3, 3)."""
    rays = np.stack([left.unproject(uv_left), right.unproject(uv_right)])
    T = np.stack([np.eye(4), T_left_right])
    points = triangulation.triangulate(rays, T_world_camera=T)
    blocks = []
    for camera, T_camera_left in ((left, np.eye(4)), (right, se3.inverse(T_left_right))):
        _, J, _ = camera.model.project_with_jacobians(camera.values, se3.apply(T_camera_left, points))
        blocks.append(J @ T_camera_left[:3, :3])
    J = np.concatenate(blocks, axis=1)
    return points, np.asarray(sigma_px**2 * np.linalg.inv(np.swapaxes(J, 1, 2) @ J), dtype=np.float64)


def record_of(
    features: Features,
    *,
    target: str,
    setup: Setup,
    image_size: tuple[int, int],
    pictures: int,
    source: str,
    T_base_gripper: Array | None = None,
) -> TaughtFeatures:
    """For the target file."""
    return TaughtFeatures(
        target=target, setup=setup, image_size=image_size, ids=tuple(int(i) for i in features.ids),
        uv_px=_rows(features.uv), sigma_px=tuple(features.sigma_px.tolist()), depth_m=tuple(features.depth.tolist()),
        points_m=() if features.points is None else _rows(features.points),
        T_camera_target=() if features.T_camera_target is None else _rows(features.T_camera_target),
        from_=source, pictures=pictures, T_base_gripper=() if T_base_gripper is None else _rows(T_base_gripper),
    )  # fmt: skip


def features_from(record: TaughtFeatures, camera: Camera) -> Features:
    """Of a target file. Raises: InputError where camera and record are of pictures of different sizes."""
    if record.image_size != camera.image_size:
        raise InputError(
            f"the features were taught in pictures of {record.image_size[0]}x{record.image_size[1]} px, the camera is "
            f"calibrated for {camera.image_size[0]}x{camera.image_size[1]} px"
        )
    found = features_of(
        camera, np.array(record.ids, np.int64), np.array(record.uv_px), np.array(record.sigma_px),
        np.array(record.depth_m),
    )  # fmt: skip
    return replace(
        found,
        points=np.array(record.points_m) if record.points_m else None,
        T_camera_target=np.array(record.T_camera_target) if record.T_camera_target else None,
    )


def told_apart(features: Features, spread: Sequence[Features]) -> float:
    """Sigmas by which the pictures of one place scatter about their mean: 1 where the detector's sigma is right."""
    offs = [(f.only(features.ids).uv - features.uv) / f.only(features.ids).sigma_px[:, None] for f in spread]
    return float(np.sqrt(np.mean(np.square(offs)) * len(offs) / max(len(offs) - 1, 1)))


def _rows(values: Array) -> tuple:
    return tuple(tuple(row) for row in values.tolist())
