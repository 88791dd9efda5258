"""The problem that a result was found from, at its end, built again from what its file holds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.cell.held_out import nearest_start
from calibrant.calibrate.cell.problem.camera_role import CameraRole
from calibrant.calibrate.cell.problem.groups import PHOTO_FLOORS, PIXEL, pixel_group, robot_groups
from calibrant.calibrate.cell.problem.groups import ROBOT_ROTATION as TURNS
from calibrant.calibrate.cell.problem.groups import ROBOT_TRANSLATION as PLACES
from calibrant.calibrate.cell.problem.layout import Layout, Pictures, TargetPoses
from calibrant.calibrate.cell.problem.problem import Cell, cell_problem
from calibrant.calibrate.cell.problem.views import HandEyeViews, from_target_poses
from calibrant.calibrate.cell.stated import cell_layout
from calibrant.calibrate.reprojection.weights import completed
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, RobotPoses, View, ViewResult
from calibrant.diagnose.budget.views import NoiseLevels
from calibrant.errors import InputError
from calibrant.geometry import se3
from calibrant.optimize.noise import estimate_noise
from calibrant.optimize.problem import Problem, Values

LEVEL_START = (1e-3, 1e-3)
"""Radians and metres: where the levels of measured target poses are looked for."""


@dataclass(frozen=True, eq=False)
class CellAgain:
    """The cell as the fit left it, its problem with all target sizes free, the values it ended with, its levels."""

    cell: Cell
    problem: Problem
    values: Values
    levels: Mapping[str, float]

    def noise_of(self, p: Pictures) -> NoiseLevels:
        """Noise of a list's camera and robot."""
        rotation, translation = robot_groups(p.robot)
        return NoiseLevels(self.levels[pixel_group(p.camera)], self.levels[rotation], self.levels[translation])


def fit_again(result: CalibrationResult) -> CellAgain:
    """Raises: InputError for a result without the data it was made from."""
    layout = cell_layout(result)
    if layout is None:
        raise InputError("the result holds neither observations nor target poses; calibrate again with this version")
    if any(p.handheld for p in layout.pictures):
        raise InputError(
            "the result is of a cell with targets moved by hand: the error budget takes robots alone; its "
            "joint_covariance holds what all pictures say"
        )
    cameras = {p.camera: _camera_of(result, p.camera) for p in layout.pictures if p.seen is not None}
    data = tuple(_as_fitted(result, layout, p, cameras.get(p.camera)) for p in layout.pictures)
    layout = _with_fitted_poses(result, layout, data)
    data = tuple(
        replace(d, T_base_gripper=layout.robots[p.robot].only(d.ids).T_base_gripper) if p.movers else d
        for p, d in zip(layout.pictures, data)
    )
    cell = Cell(layout, data, {n: CameraRole(c, ()) for n, c in cameras.items()}, {})
    transforms = {f: result.transform(*f).matrix for f in layout.unknown}
    sizes = layout.target_names
    if len(cameras) < len(layout.cameras):
        held = {n: CameraRole(c, c.model.parameter_names) for n, c in cameras.items()}
        start = cell_problem(replace(cell, roles=held), transforms, cell.levels(LEVEL_START))
        fit = estimate_noise(start, floors=cell.floors()).solution
        problem = cell_problem(cell, transforms, fit.sigmas, free_sizes=sizes)
        return CellAgain(cell, problem, nearest_start(problem, fit), fit.sigmas)
    levels = _stated_levels(result, layout)
    problem = cell_problem(cell, transforms, levels, free_sizes=sizes)
    return CellAgain(cell, problem, problem.start, levels)


def _camera_of(result: CalibrationResult, name: str) -> Camera:
    return result.cameras[name] if len(result.cameras) > 1 else result.camera


def _stated_levels(result: CalibrationResult, layout: Layout) -> dict[str, float]:
    """The noise levels that a result made from images states. Raises: InputError when it does not."""
    pixels, robots = ({}, {}) if result.cell is None else (result.cell.sigma_px, result.cell.sigma_robot)
    out = {}
    for camera in layout.cameras:
        level = pixels.get(camera, result.sigma_px)
        if level is None:
            raise InputError("the result states no noise of pixels and robot; calibrate again from images")
        out[pixel_group(camera)] = max(level, PHOTO_FLOORS[PIXEL])
    for robot in {r for p in layout.pictures for r in p.movers}:
        stated = robots.get(robot, result.sigma_robot)
        if stated is None:
            raise InputError("the result states no noise of pixels and robot; calibrate again from images")
        # A level of 0 would be infinite information.
        turns, places = float(np.deg2rad(stated.deg)), 1e-3 * stated.mm
        out |= dict(zip(robot_groups(robot), (max(turns, PHOTO_FLOORS[TURNS]), max(places, PHOTO_FLOORS[PLACES]))))
    return out


def _as_fitted(result: CalibrationResult, layout: Layout, p: Pictures, camera: Camera | None) -> HandEyeViews:
    """A list's views as the fit used them: without the points it left out, with the target poses it ended with."""
    poses = layout.robots[p.robot]
    if isinstance(p.observations, TargetPoses) or camera is None:
        given = p.observations
        if not isinstance(given, TargetPoses):
            raise InputError(f"the result holds no intrinsics of camera {p.camera!r}; calibrate again")
        return from_target_poses(poses.only(given.ids), given.T_camera_target)
    of_id = {v.id: v for v in result.views if v.used and v.T_camera_target is not None}
    found = [(v, of_id.get(v.id) or of_id.get(v.moment)) for v in p.observations.views]
    pairs = [(v, fitted) for v, fitted in found if fitted is not None]
    least = 3 if len(layout.pictures) == 1 else 1
    if len(pairs) < least:
        raise InputError(
            f"the result names {len(pairs)} used views with their observations, at least {least} are needed; "
            "calibrate again with this version"
        )
    B = np.array([fitted.T_camera_target for _, fitted in pairs]).reshape(-1, 4, 4)
    views = _weighed(pairs, camera, B)
    ids = tuple(v.moment for v in views)
    robot = poses.only(ids).T_base_gripper if p.movers else np.tile(np.eye(4), (len(ids), 1, 1))
    return replace(from_target_poses(RobotPoses(ids, robot), B), views=views)


def _weighed(pairs: list[tuple[View, ViewResult]], camera: Camera, B: Array) -> tuple[View, ...]:
    """The views without the points that were left out, weighed as in the calibration."""
    kept, squares = [], []
    for (view, fitted), T in zip(pairs, B):
        size = np.sum(view.residuals(camera, T) ** 2, axis=1)
        keep = np.ones(len(view), dtype=bool)
        if fitted.points_left_out:  # the worst ones
            keep[np.argsort(size)[-fitted.points_left_out :]] = False
        kept.append(view.subset(keep))
        squares.append(size[keep])
    every = np.concatenate(squares)
    return completed(kept, every, keep=np.ones(len(every), dtype=bool), unknowns=6 * len(kept))


def _with_fitted_poses(result: CalibrationResult, layout: Layout, data: tuple[HandEyeViews, ...]) -> Layout:
    """The layout with robot poses as the fit ended with, where a list of one moving robot shows them."""
    fitted: dict[tuple[str, str], Array] = {}
    for p, d in zip(layout.pictures, data):
        if not p.alone or p.seen is None:
            continue
        X = result.transform(layout.camera_parent(p), p.camera).matrix
        Z = result.transform(layout.target_parent(p), layout.target(p)).matrix
        base = layout.base(p.robot)
        T_base_root = np.eye(4) if base == layout.root else se3.inverse(result.transform(layout.root, base).matrix)
        if p.camera_robot is not None:
            A = T_base_root @ Z @ se3.inverse(d.B) @ se3.inverse(X)
        else:
            A = T_base_root @ X @ d.B @ se3.inverse(Z)
        fitted |= {(p.robot, name): T for name, T in zip(d.ids, A)}
    robots = {
        name: replace(
            poses,
            T_base_gripper=np.stack([fitted.get((name, i), T) for i, T in zip(poses.ids, poses.T_base_gripper)]),
        )
        for name, poses in layout.robots.items()
    }
    return replace(layout, robots=robots)
