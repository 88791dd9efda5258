"""The pose of a target that a moving thing bears, in one picture, with its covariance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.pose.target_poses import target_poses
from calibrant.cameras import Camera
from calibrant.data import Picture, View
from calibrant.detection.detection import Detection
from calibrant.errors import InputError
from calibrant.geometry import so3
from calibrant.servoing.conveyor.grasp import Sighting
from calibrant.servoing.sight.eye import LEAST_FOR_POSE, Model

FLAT = 2.0
"""Times the better residual that a plane's mirrored pose may have and be taken, where it alone lies as expected."""


@dataclass(frozen=True, eq=False)
class TargetSight:
    """Finds a target on a thing: camera; find and model of the target; T_target_object (4, 4); sigma_px where the
    detector says none; into (3,): the direction in the base in which the target's z points, by which a plane's two
    poses are told apart."""

    camera: Camera
    find: Callable[[Picture], Detection]
    model: Model
    T_target_object: Array
    sigma_px: float = 0.2
    into: Array | None = None

    def __call__(self, picture: Picture, T_base_camera: Array) -> Sighting | str:
        """The object's pose in the camera, or why there is none."""
        found = self.find(picture)
        if not found.found:
            return found.reason or "no target"
        if len(found.uv) < LEAST_FOR_POSE:
            return f"{len(found.uv)} points of the target, a pose needs {LEAST_FOR_POSE}"
        sigma = np.full(len(found.uv), self.sigma_px) if found.sigma_px is None else found.sigma_px
        try:
            view = View(picture.name, self.model.of(found.point_ids), found.uv, found.point_ids)
            poses = target_poses(self.camera, [view])
        except InputError as error:
            return str(error)
        T, C, rms = poses.T_camera_target[0], poses.covariance[0], float(poses.rms_px[0])
        if self.into is not None:
            direction, other = T_base_camera[:3, :3].T @ self.into, poses.doubles[0]
            better = other[:3, 2] @ direction > T[:3, 2] @ direction
            if better and float(poses.doubles_rms_px[0]) < max(FLAT * rms, 3 * float(sigma.mean())):
                T, C = other, poses.doubles_covariance[0]
        # The object's origin is an arm away from the target's: d p_object = d p_target + omega x r
        r = T[:3, :3] @ self.T_target_object[:3, 3]
        J = np.eye(6)
        J[3:, :3] = -so3.hat(r)
        spread = float(np.mean(sigma**2)) * C
        return Sighting(T @ self.T_target_object, J @ spread @ J.T)
