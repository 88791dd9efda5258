"""The layout of a cell, from what its result's file holds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibrant.calibrate.cell.problem.layout import (
    HANDHELD,
    IN_HAND,
    ONLY_ROBOT,
    TARGET,
    TO_HAND,
    Layout,
    Pictures,
    TargetPoses,
    id_prefix,
)
from calibrant.data import DEFAULT_CAMERA, CalibrationResult, Observations, RobotPoses, TransformEstimate


def stated_layout(result: CalibrationResult, *, used_only: bool = True) -> Layout | None:
    """The cell's frames and pictures with the views that the calibration used, robot poses as the result holds them.

    used_only: False for all views in which a target was found.
    None for a result of one list, or one whose file does not hold its pictures; see `cell_layout`.
    """
    if result.cell is None or result.observations is None or result.robot_poses is None:
        return None
    stated = result.cell.pictures
    lists = [(p.camera, p.target if p.setup == HANDHELD else p.robot) for p in stated]
    names = list(dict.fromkeys(r for p in stated for r in (p.robot, p.other) if r))
    robots = {name: _poses_of(result.robot_poses, name, alone=len(names) == 1) for name in names}
    pictures = []
    for i, p in enumerate(stated):
        # Moments carry the name of what they are of where they are not those of the only robot.
        named = f"{p.robot or HANDHELD}/" if len(names) > 1 or not p.robot else ""
        seen = _seen_by(result.observations, lists, i, named)
        if used_only:
            used = {v.id for v in result.views if v.used and v.camera == p.camera}
            seen = replace(seen, views=tuple(v for v in seen.views if v.id in used))
        pictures.append(Pictures(p.camera, p.setup, seen, p.robot, p.target, p.other))
    return Layout(robots, tuple(pictures))


def cell_layout(result: CalibrationResult, *, used_only: bool = True) -> Layout | None:
    """The cell's frames and pictures with the views that the calibration used; a single list has no names in its file.

    used_only: False for all views, or none, that the file holds.
    None where the file does not hold what the calibration was made from.
    """
    stated = stated_layout(result, used_only=used_only)
    pair = hand_eye_pair(result)
    if stated is not None or pair is None or result.robot_poses is None:
        return stated
    X, Z = pair
    seen = _single_seen(result, used_only=used_only)
    if seen is None:
        return None
    setup = IN_HAND if X.parent == "gripper" else TO_HAND
    return Layout({ONLY_ROBOT: result.robot_poses}, (Pictures(X.child, setup, seen, target=Z.child),))


def hand_eye_pair(result: CalibrationResult) -> tuple[TransformEstimate, TransformEstimate] | None:
    """X and Z of A X B = Z: gripper -> camera and base -> target, or base -> camera and gripper -> target, or None."""
    for X in result.transforms:
        other = {"gripper": "base", "base": "gripper"}.get(X.parent)
        for Z in result.transforms:
            if X.child in (DEFAULT_CAMERA, *result.cameras) and (Z.parent, Z.child) == (other, TARGET):
                return X, Z
    return None


def _single_seen(result: CalibrationResult, *, used_only: bool) -> Observations | TargetPoses | None:
    """What the only list saw: its views, or the target poses that were measured in their place."""
    poses, seen = result.robot_poses, result.observations
    if poses is not None and result.T_camera_target is not None and seen is None:
        some = used_only and result.views
        used = [k for k, v in enumerate(result.views) if v.used] if some else list(range(len(poses)))
        return TargetPoses(tuple(poses.ids[k] for k in used), np.asarray(result.T_camera_target)[used])
    if seen is None:
        return None if used_only else TargetPoses((), np.zeros((0, 4, 4)))
    if not used_only:
        return seen
    kept = {v.id for v in result.views if v.used}
    return replace(seen, views=tuple(v for v in seen.views if v.id in kept or v.moment in kept), missed=())


def _poses_of(poses: RobotPoses, robot: str, *, alone: bool) -> RobotPoses:
    if alone:
        return poses
    mine = [k for k, name in enumerate(poses.ids) if name.startswith(f"{robot}/")]
    ids = tuple(poses.ids[k].removeprefix(f"{robot}/") for k in mine)
    return replace(poses, ids=ids, T_base_gripper=poses.T_base_gripper[np.array(mine, dtype=np.int64)])


def _seen_by(observations: Observations, lists: list[tuple[str, str]], i: int, named: str) -> Observations:
    """The views of list i; their moments are ids of the robot's poses, without what they are named by."""
    camera, _ = lists[i]
    prefix = id_prefix(lists, i)
    others = [id_prefix(lists, k) for k in range(len(lists)) if k != i and lists[k][0] == camera]
    longer = tuple(o for o in others if len(o) > len(prefix) and o.startswith(prefix))
    views = []
    for v in observations.views:
        if v.camera != camera or not v.id.startswith(prefix) or v.id.startswith(longer):
            continue
        views.append(replace(v, moment=v.moment.removeprefix(named)))
    return replace(observations, views=tuple(views), image_sizes={camera: observations.image_sizes[camera]}, missed=())
