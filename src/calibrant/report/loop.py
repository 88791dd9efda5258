"""Where the target is by two ways: as the camera sees it, and as the robot carries it; by view, for hand-eye results.

Eye-in-hand: T_base_target is T_base_gripper T_gripper_camera T_camera_target by the camera, and the result's constant
by the robot. Eye-to-hand: T_base_camera T_camera_target by the camera, T_base_gripper T_gripper_target by the robot.
All stand in the base frame: the pairs lie on each other when all is well (document 003, figure 8.6).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrant.data import CalibrationResult, TransformEstimate
from calibrant.diagnose.residuals import seen_poses
from calibrant.geometry import se3

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LoopView:
    """One robot pose: T_base_gripper, T_base_camera, the target by camera (when seen) and by robot, all in base.

    mm is the distance of the target's centre by the two ways, deg the angle between them; None where it was not seen.
    """

    id: str
    T_base_gripper: Array
    T_base_camera: Array
    T_base_target_by_robot: Array
    T_base_target_by_camera: Array | None = None
    mm: float | None = None
    deg: float | None = None


def loop_views(result: CalibrationResult) -> tuple[LoopView, ...]:
    """The loop of every robot pose in order; empty for results without robot poses or hand-eye transforms.

    The camera's pose of the target comes from its picture alone: a joint fit's would already lean on the robot.
    """
    pair = hand_eye_pair(result)
    if pair is None or result.robot_poses is None:
        return ()
    T_x_camera, T_x_target = pair
    in_hand = T_x_camera.parent == "gripper"
    seen = _seen_by_pose(result)
    centre = target_centre(result)
    views = []
    for name, T_base_gripper in zip(result.robot_poses.ids, result.robot_poses.T_base_gripper, strict=True):
        T_base_camera = T_base_gripper @ T_x_camera.matrix if in_hand else T_x_camera.matrix
        by_robot = T_x_target.matrix if in_hand else T_base_gripper @ T_x_target.matrix
        T_camera_target = seen.get(name)
        if T_camera_target is None:
            views.append(LoopView(name, T_base_gripper, T_base_camera, by_robot))
            continue
        by_camera = T_base_camera @ T_camera_target
        mm = 1e3 * float(np.linalg.norm(se3.apply(by_camera, centre) - se3.apply(by_robot, centre)))
        deg = float(np.rad2deg(np.linalg.norm(se3.local(by_robot, by_camera)[:3])))
        views.append(LoopView(name, T_base_gripper, T_base_camera, by_robot, by_camera, mm, deg))
    return tuple(views)


def by_view(result: CalibrationResult, loop: Sequence[LoopView]) -> dict[str, LoopView]:
    """The loop by view id: a view belongs to the robot pose of its moment, a pose without views to itself."""
    poses = {step.id: step for step in loop}
    views = {
        view.id: poses[view.moment]
        for view in (result.observations.views if result.observations else ())
        if view.moment in poses
    }
    return poses | views


def hand_eye_pair(result: CalibrationResult) -> tuple[TransformEstimate, TransformEstimate] | None:
    """X and Z of A X B = Z: gripper -> camera and base -> target, or base -> camera and gripper -> target, or None."""
    for X in result.transforms:
        other = {"gripper": "base", "base": "gripper"}.get(X.parent)
        for Z in result.transforms:
            if X.child in ("camera", *result.cameras) and (Z.parent, Z.child) == (other, "target"):
                return X, Z
    return None


def target_centre(result: CalibrationResult) -> Array:
    """Middle (3,) of all target points seen, metres, target frame; its origin when no points are known."""
    corners = target_outline(result)
    return np.zeros(3) if corners is None else corners.mean(axis=0)


def target_outline(result: CalibrationResult) -> Array | None:
    """Corners (4, 3) of the rectangle around all target points seen, metres, from the origin along x first."""
    if result.observations is None or not result.observations.views:
        return None
    points = np.concatenate([view.points for view in result.observations.views])
    (x0, y0, z0), (x1, y1, _) = points.min(axis=0), points.max(axis=0)
    return np.array([[x0, y0, z0], [x1, y0, z0], [x1, y1, z0], [x0, y1, z0]])


def _seen_by_pose(result: CalibrationResult) -> dict[str, Array]:
    if result.T_camera_target is not None and result.robot_poses is not None:
        return dict(zip(result.robot_poses.ids, result.T_camera_target, strict=True))
    poses = seen_poses(result)
    names = set(result.robot_poses.ids) if result.robot_poses else set()
    seen = {}
    for view in result.observations.views if result.observations else ():
        if (view.camera, view.id) in poses:
            seen[view.moment if view.moment in names else view.id] = poses[view.camera, view.id]
    return seen
