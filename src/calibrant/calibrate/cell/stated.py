"""The layout of a cell, from what its result's file holds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibrant.calibrate.cell.problem.layout import (
    IN_HAND,
    ONLY_ROBOT,
    TO_HAND,
    Layout,
    Pictures,
    TargetPoses,
    id_prefix,
)
from calibrant.data import DEFAULT_CAMERA, CalibrationResult, Observations, RobotPoses


def stated_layout(result: CalibrationResult, *, used_only: bool = True) -> Layout | None:
    """The cell's frames and pictures with the views that the calibration used, robot poses as the result holds them.

    used_only: False for all views in which a target was found.
    None for a result of one list, or one whose file does not hold its pictures; see `cell_layout`.
    """
    if result.cell is None or result.observations is None or result.robot_poses is None:
        return None
    stated = result.cell.pictures
    lists = [(p.camera, p.robot) for p in stated]
    names = list(dict.fromkeys(r for p in stated for r in (p.robot, p.other) if r))
    robots = {name: _poses_of(result.robot_poses, name, alone=len(names) == 1) for name in names}
    pictures = []
    for i, p in enumerate(stated):
        seen = _seen_by(result.observations, lists, i, alone=len(names) == 1)
        if used_only:
            used = {v.id for v in result.views if v.used and v.camera == p.camera}
            seen = replace(seen, views=tuple(v for v in seen.views if v.id in used))
        pictures.append(Pictures(p.camera, p.setup, seen, p.robot, p.target, p.other))
    return Layout(robots, tuple(pictures))


def cell_layout(result: CalibrationResult) -> Layout | None:
    """The cell's frames and pictures with the views that the calibration used; a single list has no names in its file.

    None where the file does not hold what the calibration was made from.
    """
    stated = stated_layout(result)
    poses, seen = result.robot_poses, result.observations
    if stated is not None or poses is None or (seen is None and result.T_camera_target is None):
        return stated
    on_robot = next((t for t in result.transforms if t.child in {*result.cameras, DEFAULT_CAMERA}), None)
    target = next((t.child for t in result.transforms if on_robot is not None and t.child != on_robot.child), None)
    if on_robot is None or target is None:
        return None
    setup = IN_HAND if on_robot.parent == "gripper" else TO_HAND
    if seen is None:
        used = [k for k, v in enumerate(result.views) if v.used] if result.views else list(range(len(poses)))
        measured = TargetPoses(tuple(poses.ids[k] for k in used), np.asarray(result.T_camera_target)[used])
        return Layout({ONLY_ROBOT: poses}, (Pictures(on_robot.child, setup, measured, target=target),))
    kept = {v.id for v in result.views if v.used}
    views = tuple(v for v in seen.views if v.id in kept or v.moment in kept)
    pictures = Pictures(on_robot.child, setup, replace(seen, views=views, missed=()), target=target)
    return Layout({ONLY_ROBOT: poses}, (pictures,))


def _poses_of(poses: RobotPoses, robot: str, *, alone: bool) -> RobotPoses:
    if alone:
        return poses
    mine = [k for k, name in enumerate(poses.ids) if name.startswith(f"{robot}/")]
    ids = tuple(poses.ids[k].removeprefix(f"{robot}/") for k in mine)
    return replace(poses, ids=ids, T_base_gripper=poses.T_base_gripper[np.array(mine, dtype=np.int64)])


def _seen_by(observations: Observations, lists: list[tuple[str, str]], i: int, *, alone: bool) -> Observations:
    """The views of list i; their moments are ids of the robot's poses."""
    camera, robot = lists[i]
    prefix = id_prefix(lists, i)
    others = [id_prefix(lists, k) for k in range(len(lists)) if k != i and lists[k][0] == camera]
    longer = tuple(o for o in others if len(o) > len(prefix) and o.startswith(prefix))
    views = []
    for v in observations.views:
        if v.camera != camera or not v.id.startswith(prefix) or v.id.startswith(longer):
            continue
        views.append(v if alone else replace(v, moment=v.moment.removeprefix(f"{robot}/")))
    return replace(observations, views=tuple(views), image_sizes={camera: observations.image_sizes[camera]}, missed=())
