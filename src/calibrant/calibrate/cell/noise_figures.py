"""The noise levels of a cell in a reader's words: pixels of all cameras, and what a robot's poses err by."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calibrant.calibrate.cell.fitted import pose_noise
from calibrant.calibrate.cell.problem.groups import geometry_variable, joint_group, robot_groups
from calibrant.calibrate.cell.problem.problem import Cell
from calibrant.data import CellLayout, PictureList, SigmaRobot
from calibrant.data.details import RobotParameter, RobotParameters
from calibrant.optimize.noise import NoiseEstimate, NoiseLevel
from calibrant.optimize.solution import Solution


def sigma_px(cell: Cell, noise: NoiseEstimate) -> float | None:
    """One noise level for all cameras; None without images."""
    return pooled([cell.pixel_level(noise.levels, c) for c in cell.roles]) if cell.roles else None


def pooled(levels: Sequence[NoiseLevel]) -> float:
    """The mean square over what each camera's level rests on."""
    if len(levels) == 1:
        return levels[0].sigma
    weight = np.array([level.redundancy for level in levels])
    return float(np.sqrt(np.sum(weight * [level.sigma**2 for level in levels]) / weight.sum()))


def sigma_robot(cell: Cell, noise: NoiseEstimate, robot: str) -> SigmaRobot | None:
    """Noise of a robot's poses, that of its joints with it: root mean square over its poses and axes.

    None for a robot that no image tells apart from the target poses that were measured.
    """
    levels = noise.levels
    rotation, translation = (levels.get(g) for g in robot_groups(robot))
    if rotation is None or translation is None or robot not in cell.robots_in_images:
        return None
    of_rotation, of_translation = rotation.sigma**2, translation.sigma**2
    joint = levels.get(joint_group(robot))
    if joint is not None:
        C = pose_noise(cell, noise.solution, robot).mean(axis=0)
        of_rotation, of_translation = float(np.trace(C[:3, :3])) / 3, float(np.trace(C[3:, 3:])) / 3
    deg, deg_sigma = _with_joints(rotation, joint, of_rotation)
    mm, mm_sigma = _with_joints(translation, joint, of_translation)
    return SigmaRobot(
        1e3 * mm,
        float(np.rad2deg(deg)),
        None if mm_sigma is None else 1e3 * mm_sigma,
        None if deg_sigma is None else float(np.rad2deg(deg_sigma)),
    )


def _with_joints(own: NoiseLevel, joint: NoiseLevel | None, variance: float) -> tuple[float, float | None]:
    """Root of a variance s^2 = own^2 + by joints^2, and its deviation, 4 s^2 var(s) = var(own^2) + var(by joints^2)."""
    known = [own.sigma**2 * own.deviation**2] if np.isfinite(own.deviation) else []
    if joint is not None and joint.sigma > 0 and np.isfinite(joint.deviation):
        known.append((max(variance - own.sigma**2, 0.0) * joint.deviation / joint.sigma) ** 2)
    sigma = float(np.sqrt(variance))
    return sigma, float(np.sqrt(sum(known)) / sigma) if known and sigma > 0 else None


def noise_by_name(cell: Cell, noise: NoiseEstimate) -> CellLayout:
    """Who stands where, and the noise by camera and robot, which the one number of a result cannot hold."""
    layout = cell.layout
    robots = {r: sigma_robot(cell, noise, r) for r in layout.robots} if len(layout.robots) > 1 else {}
    joints = {r: noise.levels.get(joint_group(r)) for r in cell.free}
    return CellLayout(
        tuple(PictureList(p.camera, p.robot, p.setup, p.target, p.other) for p in layout.pictures),
        {c: cell.pixel_level(noise.levels, c).sigma for c in cell.roles} if len(cell.roles) > 1 else {},
        {r: sigma for r, sigma in robots.items() if sigma is not None},
        {r: float(np.rad2deg(level.sigma)) for r, level in joints.items() if level is not None},
    )


def robot_parameters(cell: Cell, solution: Solution) -> tuple[RobotParameters, ...]:
    """The robots' own errors; nothing where no joints were free."""
    robots = {
        robot: tuple(
            RobotParameter(
                p.parameter.name, p.parameter.unit, p.correction, p.sigma, p.reason if p.sigma is None else None
            )
            for p in free.parameters(solution, geometry_variable(robot))
        )
        for robot, free in cell.free.items()
    }
    return (RobotParameters(robots),) if robots else ()
