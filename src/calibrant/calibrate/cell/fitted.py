"""What a fit of a cell says: cameras, transforms, robot poses, and where each view should see its target."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from calibrant.arrays import Array, Mask
from calibrant.calibrate.cell.problem.groups import geometry_variable, joint_group, lens_variable, robot_groups
from calibrant.calibrate.cell.problem.layout import Frame, Pictures, poses_variable, variable
from calibrant.calibrate.cell.problem.problem import Cell, Rows, places
from calibrant.calibrate.reprojection.links import Link, link_maps, product
from calibrant.cameras import Camera
from calibrant.geometry import se3
from calibrant.optimize.solution import Solution

Value = Callable[[str], Array]
"""Values (count, …) of an unknown by its name: `Solution.value`, or of a step away from one."""


def fitted_cameras(cell: Cell, solution: Solution) -> dict[str, Camera]:
    """The cameras as refined; those without a picture left, as they were."""
    there = {v.name for v in solution.problem.variables}
    out = {}
    for name, role in cell.roles.items():
        lens, camera = lens_variable(name), role.camera
        if lens not in there:
            out[name] = camera
            continue
        covariance = None if role.exact else solution.covariance(lens)
        out[name] = Camera(camera.model, camera.image_size, solution.value(lens)[0], covariance)
    return out


def fitted_transforms(cell: Cell, solution: Solution) -> dict[Frame, Array]:
    """The unknown transforms as refined."""
    return {f: solution.value(variable(f))[0] for f in cell.layout.unknown}


def fitted_places(cell: Cell, solution: Solution) -> dict[Frame, Array]:
    """All that a fit starts from: the unknown transforms as refined, and handheld targets' (m, 4, 4) by moment."""
    return fitted_transforms(cell, solution) | {f: solution.value(variable(f)) for f in cell.layout.handheld}


def said_poses(cell: Cell, value: Value, robot: str) -> Array:
    """T_base_gripper (n, 4, 4) of all a robot's poses: as reported, or by its geometry as fitted."""
    poses, free = cell.layout.robots[robot], cell.free.get(robot)
    if free is None:
        return poses.T_base_gripper
    rows = [free.readings.ids.index(m) for m in poses.ids]
    return free.at(value(geometry_variable(robot))[0]).predict(free.readings.q[rows])


def pose_noise(cell: Cell, solution: Solution, robot: str) -> Array:
    """Covariance (n, 6, 6) of what all of a robot's poses are off by, in `se3.retract`'s chart: the poses' own noise,
    and what their joints' noise makes of them."""
    levels = solution.sigmas
    rotation, translation = (levels[g] for g in robot_groups(robot))
    C = np.diag([rotation**2] * 3 + [translation**2] * 3)
    ids, free = cell.layout.robots[robot].ids, cell.free.get(robot)
    if free is None:
        return np.broadcast_to(C, (len(ids), 6, 6))
    rows = [free.readings.ids.index(m) for m in ids]
    J = free.at(solution.value(geometry_variable(robot))[0]).joint_jacobian(free.readings.q[rows])
    return np.asarray(C + levels[joint_group(robot)] ** 2 * J @ np.swapaxes(J, -1, -2))


def pose_rows(cell: Cell, i: int, rows: Mask) -> dict[str, Rows]:
    """Which poses of each robot between camera and target the rows of list i were taken at."""
    ids = [name for name, r in zip(cell.data[i].ids, rows) if r]
    layout = cell.layout
    return {robot: places(layout.robots[robot].ids, ids) for robot in layout.pictures[i].movers}


def prediction(cell: Cell, value: Value, i: int, rows: Mask) -> Array:
    """T_camera_target (m, 4, 4) of the rows of list i by what the robots said."""
    links, values, _ = _links_of(cell, value, i, rows)
    return product(links, values)


def pose_maps(cell: Cell, value: Value, i: int, rows: Mask) -> dict[str, Array]:
    """By robot, how the predicted T_camera_target answers an error of its poses, (m, 6, 6) or (6, 6)."""
    links, values, arms = _links_of(cell, value, i, rows)
    return {arms[k.variable]: m for k, m in zip(links, link_maps(links, values)) if k.variable in arms}


def _links_of(cell: Cell, value: Value, i: int, rows: Mask) -> tuple[list[Link], list[Array], dict[str, str]]:
    """Links of list i's prediction at these rows, their values, and the robots by the name of their poses."""
    layout, p = cell.layout, cell.layout.pictures[i]
    links = layout.links(p, pose_rows(cell, i, rows), int(rows.sum()))
    arms = {poses_variable(robot): robot for robot in p.movers}
    values = [
        said_poses(cell, value, arms[k.variable])[k.indices] if k.variable in arms else value(k.variable)[k.indices]
        for k in links
    ]
    return links, values, arms


def robot_side(cell: Cell, value: Value, i: int, rows: Mask) -> Array:
    """T_base_gripper (m, 4, 4) that list i's robot said at these rows."""
    p = cell.layout.pictures[i]
    return said_poses(cell, value, p.robot)[pose_rows(cell, i, rows)[p.robot]]


def mounting(cell: Cell, value: Value, p: Pictures) -> Array:
    """X of these pictures' own problem: the camera in the gripper, or in this robot's base."""
    layout, (at, camera) = cell.layout, cell.layout.constants(p)[0]
    X = value(variable((layout.camera_parent(p), camera)))[0]
    if at == layout.camera_parent(p):
        return X
    return np.asarray(se3.inverse(value(variable((layout.root, at)))[0]) @ X)
