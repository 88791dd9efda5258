"""From photos to what the hand-eye problem takes: target poses, the camera's role, the views ruled out before."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibrant.calibrate.hand_eye.joint import CameraRole, prior_camera
from calibrant.calibrate.hand_eye.views import (
    LEAST_SIGMA_PX,
    HandEyeViews,
    from_observations,
    unsharp_views,
    weighed,
)
from calibrant.calibrate.intrinsics import MINIMUM_POINTS, calibrate_keeping
from calibrant.cameras import Camera
from calibrant.data import Observations, RobotPoses
from calibrant.errors import InputError


@dataclass(frozen=True, eq=False)
class Photos:
    """Views with their target poses, the camera's role in the joint problem, the pixel noise to start from."""

    data: HandEyeViews
    role: CameraRole
    sigma_px: float


def named_by_poses(observations: Observations, poses: RobotPoses, *, given_ids: bool) -> Observations:
    """Views that carry the poses' ids: by name when the poses have names, else by order."""
    if len(observations.image_sizes) != 1:
        raise InputError(f"hand-eye calibration takes one camera, got {', '.join(observations.image_sizes)}")
    if given_ids:
        return observations
    if len(observations.views) != len(poses):
        raise InputError(
            f"{len(poses)} robot poses without names but {len(observations.views)} views with a target; "
            "give RobotPoses with the views' ids, or one pose a view"
        )
    views = tuple(replace(v, moment=i) for v, i in zip(observations.views, poses.ids))
    return replace(observations, views=views)


def prepare_photos(
    poses: RobotPoses, observations: Observations, camera: Camera | None, model: str, fix: Sequence[str]
) -> Photos:
    """Photos with a camera that is given, or that they calibrate. Raises as `calibrate_intrinsics` does."""
    remarks = unsharp_views(observations.views)
    if camera is not None:
        observations = replace(observations, views=weighed(observations.views, camera))
        data = from_observations(poses, observations, camera).noted(remarks)
        return Photos(data, prior_camera(camera), data.sigma_px)
    kept = calibrate_keeping(observations, model=model, fix=fix)
    result = kept.result
    sigma = max(result.sigma_px or 0.0, LEAST_SIGMA_PX)
    data = from_observations(poses, replace(observations, views=kept.views), result.camera, sigma).noted(remarks)
    data = replace(data, left_out=tuple(v for v in result.views if not v.used))
    return Photos(data, _calibrated(result.camera, data), sigma)


def _calibrated(camera: Camera, data: HandEyeViews) -> CameraRole:
    """A camera that the same photos determine: those without a use for the robot still count for it."""
    held = tuple(n for n, s in camera.sigma.items() if s == 0)
    extra = [(v, T) for v, T, use in zip(data.views or (), data.B, data.use) if not use and len(v) >= MINIMUM_POINTS]
    usable = [(v, T) for v, T in extra if not np.allclose(T, np.eye(4))]
    return CameraRole(
        camera,
        held,
        extra=tuple(v for v, _ in usable),
        extra_poses=np.array([T for _, T in usable]).reshape(-1, 4, 4),
    )
