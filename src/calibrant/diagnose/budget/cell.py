"""Where the uncertainty of several cameras and robots comes from: the budget of `error_budget`, over all of them.

The unknowns x are all transforms of the cell, the nuisances c all lenses and target sizes. The robots' poses r are
eliminated, K = H_rr^-1 H_rs, and S = [I; -K]^T H_k [I; -K] is what noise source k puts into
the normal matrix over (x, c); the rest follows as there. A camera's budget is its part of the whole: its own transform,
its target's and its lens, with what it owes to the other cameras already in their covariance.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csc_array
from scipy.sparse.linalg import splu

from calibrant.calibrate.cell.problem.camera_role import CameraRole
from calibrant.calibrate.cell.problem.layout import Layout, Pictures, poses_variable, variable
from calibrant.calibrate.cell.problem.problem import (
    Several,
    lens_variable,
    pixel_group,
    robot_groups,
    scale_variable,
    several_problem,
)
from calibrant.calibrate.cell.stated import stated_layout
from calibrant.calibrate.cell.views import from_observations
from calibrant.calibrate.solvers.setup import get_setup
from calibrant.data import CalibrationResult
from calibrant.data.details import RobotParameters
from calibrant.diagnose.budget.single import (
    INTRINSICS,
    PIXELS,
    ROBOT_ROTATION,
    ROBOT_TRANSLATION,
    TARGET,
    ErrorBudget,
    inverse_information,
    with_motion,
)
from calibrant.errors import InputError
from calibrant.optimize.factors import Factor, FactorBlocks
from calibrant.optimize.problem import Problem

Array = NDArray[np.float64]
Columns = dict[str, NDArray[np.int64]]


@dataclass(frozen=True, eq=False)
class CameraBudget:
    """A camera of several: its budget, the robot poses (n, 4, 4) it looked from (the identity for a camera that stands
    still), where the target was in that robot's base, and its middle (3,), target frame.

    parent: the frame that a workspace is given in: the base of the robot that carries it, else the first robot's.
    """

    budget: ErrorBudget
    T_base_gripper: Array
    T_base_target: Array
    middle: Array
    parent: str


def several_budgets(result: CalibrationResult, *, target_sigma: float) -> dict[str, CameraBudget] | None:
    """The budget of every camera; None for a result of one camera and one robot.

    Raises: InputError for a result whose robot's joints were free: its file does not hold their readings.
    """
    layout = stated_layout(result)
    if layout is None:
        return None
    if result.detail(RobotParameters) is not None:
        raise InputError(
            "the uncertainty in a workspace is not available with --identify: what the offsets add to it is not in the "
            "result; calibrate with the corrected robot (its poses), without --identify"
        )
    several = _several(result, layout)
    problem, levels = _problem(result, several)
    shared, poses = _columns(problem)
    totals = _information(problem, levels, shared, poses)
    columns = {name: c.ravel() for name, c in shared.items()}
    # The result states the size that the motion tells where there is one target.
    stated = dict.fromkeys((p.target for p in layout.pictures), with_motion(result.target_scale, target_sigma))
    sources = _sources(result, layout, columns, totals, stated)
    notes = tuple(
        f"{name} was given without a covariance: its lens' error is not counted."
        for name, camera in result.cameras.items()
        if camera.covariance is None
    )
    notes += ("What the noise levels are themselves uncertain by, a few percent, is not counted.",)
    out: dict[str, CameraBudget] = {}
    for i, p in enumerate(layout.pictures):
        if p.camera not in out:
            out[p.camera] = _of_camera(result, several, i, columns, sources, stated[p.target], notes)
    return out


def _several(result: CalibrationResult, layout: Layout) -> Several:
    data = tuple(
        from_observations(layout.robots[p.robot], p.observations, result.cameras[p.camera]) for p in layout.pictures
    )
    roles = {name: CameraRole(camera, ()) for name, camera in result.cameras.items()}
    return Several(layout, data, roles, {})


def _problem(result: CalibrationResult, several: Several) -> tuple[Problem, dict[str, float]]:
    """The joint problem at the result, sizes free, and the noise levels it states."""
    layout, cell = several.layout, result.cell
    transforms = {f: result.transform(*f).matrix for f in layout.unknown}
    pixels = cell.sigma_px if cell is not None else {}
    levels = {pixel_group(c): float(pixels.get(c, result.sigma_px or 0.0)) for c in layout.cameras}
    for robot in layout.robots:
        stated = (cell.sigma_robot if cell is not None else {}).get(robot, result.sigma_robot)
        if stated is not None:
            levels |= dict(zip(robot_groups(robot), (float(np.deg2rad(stated.deg)), 1e-3 * stated.mm)))
    return several_problem(several, transforms, levels, free_scale=True), levels


def _columns(problem: Problem) -> tuple[Columns, Columns]:
    """Columns of all unknowns but the robots' poses, and behind them those of the poses: (count, size) by name."""
    shared: Columns = {}
    poses: Columns = {}
    at = 0
    arms = [v for v in problem.variables if v.name.startswith(poses_variable(""))]
    for v in (*(v for v in problem.variables if v not in arms), *arms):
        size = len(v.manifold.natural_names)
        (poses if v in arms else shared)[v.name] = at + np.arange(v.count * size).reshape(v.count, size)
        at += v.count * size
    return shared, poses


def _information(problem: Problem, levels: Mapping[str, float], shared: Columns, poses: Columns) -> dict[str, Array]:
    """Normal matrices over the shared unknowns by source, robot poses eliminated."""
    columns = shared | poses
    size = 1 + max(int(c.max()) for c in columns.values())
    first = min(int(c.min()) for c in poses.values())
    H = {source: csc_array((size, size)) for source in (PIXELS, ROBOT_ROTATION, ROBOT_TRANSLATION)}
    for k, factor in enumerate(problem.factors):
        blocks = factor.blocks(problem.gather(k, problem.start), sigma=problem.sigma(factor, levels))
        source = _source_of(factor)
        H[source] = H[source] + _sparse(factor, blocks, columns, size)
    total = H[PIXELS] + H[ROBOT_ROTATION] + H[ROBOT_TRANSLATION]
    K = splu(total[first:, first:]).solve(total[first:, :first].toarray())
    lift = np.concatenate([np.eye(first), -K])
    return {source: lift.T @ (part @ lift) for source, part in H.items()}


def _source_of(factor: Factor) -> str:
    rotation, translation = robot_groups("")
    if factor.noise.startswith(rotation):
        return ROBOT_ROTATION
    return ROBOT_TRANSLATION if factor.noise.startswith(translation) else PIXELS


def _sparse(factor: Factor, blocks: FactorBlocks, columns: Columns, size: int) -> csc_array:
    """A factor's normal matrix over all unknowns."""
    rows: list[NDArray[np.int64]] = []
    cols: list[NDArray[np.int64]] = []
    values: list[Array] = []
    for (a, b), block in blocks.hessian.items():
        i = columns[factor.variables[a]][factor.indices[a]][:, :, None]
        j = columns[factor.variables[b]][factor.indices[b]][:, None, :]
        i, j = np.broadcast_arrays(i, j)
        rows.append(i.ravel())
        cols.append(j.ravel())
        values.append(block.ravel())
        if a != b:
            rows.append(j.ravel())
            cols.append(i.ravel())
            values.append(block.ravel())
    entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(cols)))
    return csc_array(coo_array(entries, shape=(size, size)))


def _sources(
    result: CalibrationResult,
    layout: Layout,
    columns: Columns,
    totals: Mapping[str, Array],
    sizes: Mapping[str, float],
) -> dict[str, Array]:
    """Covariance over all shared unknowns by source."""
    H = np.sum(list(totals.values()), axis=0)
    size = len(H)
    x = np.concatenate([columns[variable(f)] for f in layout.unknown])
    C = inverse_information(H[np.ix_(x, x)])
    out = {}
    for name, S in totals.items():
        out[name] = np.zeros((size, size))
        out[name][np.ix_(x, x)] = C @ S[np.ix_(x, x)] @ C
    out[INTRINSICS], out[TARGET] = np.zeros((size, size)), np.zeros((size, size))
    for name, camera in result.cameras.items():
        if camera.covariance is not None and lens_variable(name) in columns:
            lift = _lift(H, C, x, columns[lens_variable(name)])
            out[INTRINSICS] += lift @ camera.covariance @ lift.T
    for target, sigma in sizes.items():
        if scale_variable(target) in columns:
            lift = _lift(H, C, x, columns[scale_variable(target)])
            out[TARGET] += sigma**2 * lift @ lift.T
    return out


def _lift(H: Array, C: Array, x: NDArray[np.int64], c: NDArray[np.int64]) -> Array:
    """What an error of the nuisances c does to everything: to x by -C H_xc, to themselves as it is."""
    lift = np.zeros((len(H), len(c)))
    lift[x] = -C @ H[np.ix_(x, c)]
    lift[c, np.arange(len(c))] = 1.0
    return lift


def _of_camera(
    result: CalibrationResult,
    several: Several,
    i: int,
    columns: Columns,
    sources: Mapping[str, Array],
    size: float,
    notes: tuple[str, ...],
) -> CameraBudget:
    layout, p = several.layout, several.layout.pictures[i]
    at, on = (layout.camera_parent(p), p.camera), (layout.target_parent(p), layout.target(p))
    mine = np.concatenate([columns[variable(at)], columns[variable(on)], columns[lens_variable(p.camera)]])
    setup = get_setup("eye-in-hand" if p.camera_robot is not None else "eye-to-hand")
    budget = ErrorBudget(
        setup,
        result.transform(*at).matrix,
        result.transform(*on).matrix,
        result.cameras[p.camera],
        None,
        {name: C[np.ix_(mine, mine)] for name, C in sources.items()},
        size,
        notes,
    )
    parent = layout.root if p.camera_robot is None else layout.base(p.camera_robot)
    seen = np.concatenate([v.points for v in p.observations.views])
    T_base_target = several.data[i].T_base_gripper @ budget.X @ several.data[i].B
    return CameraBudget(budget, _looks(several, i, p), T_base_target[0], seen.mean(axis=0), parent)


def _looks(several: Several, i: int, p: Pictures) -> Array:
    """Robot poses of the used views; the identity where no robot carries the camera."""
    return np.eye(4)[None] if p.camera_robot is None else several.data[i].T_base_gripper
