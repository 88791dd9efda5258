"""Where the target is by two ways: as the camera sees it, and as the robot carries it; by view, for hand-eye results.

Eye-in-hand: T_base_target is T_base_gripper T_gripper_camera T_camera_target by the camera, and the result's constant
by the robot. Eye-to-hand: T_base_camera T_camera_target by the camera, T_base_gripper T_gripper_target by the robot.
All stand in the base frame: the pairs lie on each other when all is well (document 003, figure 8.6).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.cell.problem.layout import STANDING, Layout, Pictures, TargetPoses
from calibrant.calibrate.cell.stated import cell_layout, stated_layout
from calibrant.calibrate.review.residuals import seen_poses
from calibrant.data import CalibrationResult
from calibrant.geometry import se3


@dataclass(frozen=True, eq=False)
class LoopView:
    """One robot pose: T_base_gripper, T_base_camera, the target by camera (when seen) and by robot, all in base.

    mm is the distance of the target's centre by the two ways, deg the angle between them; None where it was not seen.
    camera: its name; view: the id of its picture; in_hand: whether a robot carries it; target_carried: whether one
    carries the target. Of several robots all stand in
    the first one's base.
    """

    id: str
    T_base_gripper: Array
    T_base_camera: Array
    T_base_target_by_robot: Array
    T_base_target_by_camera: Array | None = None
    mm: float | None = None
    deg: float | None = None
    camera: str = ""
    view: str = ""
    in_hand: bool = True
    target_carried: bool = False

    @property
    def key(self) -> str:
        """The view's key on the page."""
        return f"{self.camera}/{self.view or self.id}"


def loop_views(result: CalibrationResult) -> tuple[LoopView, ...]:
    """The loop of every robot pose in order; empty for results without robot poses or hand-eye transforms.

    The camera's pose of the target comes from its picture alone: a joint fit's would already lean on the robot.
    """
    layout = cell_layout(result, used_only=False)
    return () if layout is None else tuple(view for p in layout.pictures for view in _of_pictures(result, layout, p))


def _of_pictures(result: CalibrationResult, layout: Layout, p: Pictures) -> list[LoopView]:
    """The loop of one list: at every pose of the robot, or, of several lists, at those that it has a view of.

    None for a camera and a target that both stand still.
    """
    if not p.movers:
        return []
    X = result.transform(layout.camera_parent(p), p.camera).matrix
    Z = result.transform(layout.target_parent(p), layout.target(p)).matrix
    camera, target = (_grippers(result, layout, robot) for robot in (p.camera_robot, p.target_robot))
    hand = camera or target
    seen = _seen_by_moment(result, p, hand)
    centre = target_centre(replace(result, observations=p.seen))
    robot = "" if len(layout.robots) == 1 else f"{p.robot} "
    # Of target poses without a camera's model the views have a camera's name all the same.
    name = p.camera if p.camera in result.cameras or any(v.camera == p.camera for v in result.views) else ""
    out = []
    for moment in hand if len(layout.pictures) == 1 else seen:
        view, T = seen.get(moment, (moment, None))
        T_root_camera = camera[moment] @ X if camera else X
        by_robot = target[moment] @ Z if target else Z
        step = _loop_view(f"{robot}{moment}", hand[moment], T_root_camera, by_robot, T, centre)
        out.append(replace(step, camera=name, view=view, in_hand=bool(camera), target_carried=bool(target)))
    return out


def _seen_by_moment(
    result: CalibrationResult, p: Pictures, hand: Mapping[str, Array]
) -> dict[str, tuple[str, Array | None]]:
    """A list's views by the pose of the robot that they were taken at: their ids and T_camera_target, where known."""
    if isinstance(p.observations, TargetPoses):
        return {i: (i, T) for i, T in zip(p.observations.ids, p.observations.T_camera_target)}
    poses = seen_poses(result)
    views = ((v.moment if v.moment in hand else v.id, v) for v in p.observations.views)
    return {moment: (v.id, poses.get((v.camera, v.id))) for moment, v in views if moment in hand}


def _grippers(result: CalibrationResult, layout: Layout, robot: str | None) -> dict[str, Array]:
    """T_root_gripper of a robot by its poses' ids; empty for no robot."""
    if robot is None:
        return {}
    base, poses = layout.base(robot), layout.robots[robot]
    T_root_base = np.eye(4) if base == layout.root else result.transform(layout.root, base).matrix
    return dict(zip(poses.ids, T_root_base @ poses.T_base_gripper, strict=True))


def _loop_view(
    name: str,
    T_base_gripper: Array,
    T_base_camera: Array,
    by_robot: Array,
    T_camera_target: Array | None,
    centre: Array,
) -> LoopView:
    if T_camera_target is None:
        return LoopView(name, T_base_gripper, T_base_camera, by_robot)
    by_camera = T_base_camera @ T_camera_target
    mm = 1e3 * float(np.linalg.norm(se3.apply(by_camera, centre) - se3.apply(by_robot, centre)))
    deg = float(se3.deviation(by_robot, by_camera)[1])
    return LoopView(name, T_base_gripper, T_base_camera, by_robot, by_camera, mm, deg)


def other_bases(result: CalibrationResult) -> dict[str, Array]:
    """T_root_base (4, 4) of every robot's base but the first's, by frame."""
    layout = stated_layout(result)
    if layout is None:
        return {}
    bases = (layout.base(robot) for robot in layout.robots)
    return {base: result.transform(layout.root, base).matrix for base in bases if base != layout.root}


def standing_cameras(result: CalibrationResult) -> dict[str, Array]:
    """T_root_camera (4, 4) of cameras that stand still and see targets that do: their loop has no robot."""
    layout = stated_layout(result)
    if layout is None:
        return {}
    names = dict.fromkeys(p.camera for p in layout.pictures if p.setup == STANDING)
    return {name: result.transform(layout.root, name).matrix for name in names}


def by_view(loop: Sequence[LoopView]) -> dict[tuple[str, str], LoopView]:
    """The loop by camera and view id; a pose without a view goes by its own name."""
    return {(step.camera, step.view): step for step in loop}


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
