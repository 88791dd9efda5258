"""The targets' sizes by the robots' motion, and the images' share of the noise, list by list.

Each list that is a hand-eye problem of its own tells its target's size by its loop (`loop.target_size`), from the
target poses that each view gave by itself. Lists that see one target are averaged, weighed by their certainty; lists at
poses of one robot share its errors, which counts as if all of their errors were common. Where a target is only seen by
cameras of other moving robots, the whole problem with its size free tells it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibrant.calibrate.cell.certainty.given_lens import freed_role
from calibrant.calibrate.cell.certainty.size import FreeSizes
from calibrant.calibrate.cell.fitted import fitted_places, mounting, robot_side
from calibrant.calibrate.cell.held_out import nearest_start
from calibrant.calibrate.cell.loop.image_poses import ImagePoses, image_poses
from calibrant.calibrate.cell.loop.noise import LoopNoise
from calibrant.calibrate.cell.loop.target_size import target_size
from calibrant.calibrate.cell.problem.groups import lens_variable, scale_variable
from calibrant.calibrate.cell.problem.problem import Cell, cell_problem
from calibrant.calibrate.cell.problem.views import HandEyeViews
from calibrant.calibrate.solvers.setup import get_setup
from calibrant.cancel import checkpoint
from calibrant.data import Measured
from calibrant.optimize.levenberg_marquardt import CLOSE_ENOUGH, solve
from calibrant.optimize.solution import Solution


@dataclass(frozen=True, eq=False)
class Sizes:
    """loops and images: what each list that tells by itself says, by its number; targets: the size of each target, in
    units of the one given, where it can be told."""

    loops: Mapping[int, LoopNoise]
    images: Mapping[int, ImagePoses]
    targets: Mapping[str, Measured]


def target_sizes(cell: Cell, begin: Sequence[HandEyeViews], solution: Solution) -> Sizes:
    """begin: every list with the target poses that it started with."""
    loops: dict[int, LoopNoise] = {}
    images: dict[int, ImagePoses] = {}
    for i, p, data in cell.lists:
        checkpoint()
        if not p.alone:
            continue
        setup, role = get_setup(p.setup), cell.roles.get(p.camera)
        everywhere = np.ones(len(data), dtype=bool)
        own = replace(begin[i], use=data.use, T_base_gripper=robot_side(cell, solution.value, i, everywhere))
        camera = None if role is None else role.camera
        loop = target_size(setup, own, mounting(cell, solution.value, p), used=data.use, camera=camera)
        shares = image_poses(setup, own, loop, camera=camera)
        loops |= {} if loop is None else {i: loop}
        images |= {} if shares is None else {i: shares}
    targets: dict[str, Measured] = {}
    for target in cell.layout.target_names:
        mine = [i for i in loops if cell.layout.pictures[i].target == target]
        if mine:
            size = _averaged(cell, loops, mine)
        elif any(p.alone and p.target == target for p in cell.layout.pictures):
            size = None
        else:
            size = _by_all(cell, solution, target)
        targets |= {} if size is None else {target: size}
    return Sizes(loops, images, targets)


def _averaged(cell: Cell, loops: Mapping[int, LoopNoise], lists: Sequence[int]) -> Measured:
    """The mean over lists; see the module for its sigma."""
    if len(lists) == 1:
        return loops[lists[0]].size
    value, sigma = (np.array([getattr(loops[i].size, name) for i in lists]) for name in ("value", "sigma"))
    weight = sigma**-2 / np.sum(sigma**-2)
    robots = np.array([cell.layout.pictures[i].robot for i in lists])
    common = robots[:, None] == robots
    variance = (weight * sigma) @ common @ (weight * sigma)
    return Measured(float(weight @ value), float(np.sqrt(variance)))


def with_sizes_free(cell: Cell, solution: Solution, sizes: Mapping[str, Measured]) -> FreeSizes | None:
    """The fit, at its values, with the size of every target that is told one unknown more; None for none."""
    if cell.layout.rig or not sizes:  # images alone have no size of their own
        return None
    problem = cell_problem(cell, fitted_places(cell, solution), solution.sigmas, free_sizes=tuple(sizes))
    values = nearest_start(problem, solution)
    equations = problem.linearize(values, solution.sigmas)
    freed = replace(solution, problem=problem, values=values, equations=equations, around=(), beside=None)
    one = len(cell.data) == len(sizes) == 1 and not cell.layout.touches
    return FreeSizes(tuple(map(scale_variable, sizes)), freed, next(iter(sizes.values())) if one else None)


def with_lens_free(cell: Cell, solution: Solution, camera: str) -> tuple[Cell, Solution] | None:
    """The cell and its fit, at its values, with a lens free that was given as exact; None where it has to be held."""
    role = freed_role(cell.roles[camera].camera)
    if role is None or lens_variable(camera) not in {v.name for v in solution.problem.variables}:
        return None
    freed = replace(cell, roles={**cell.roles, camera: role})
    problem = cell_problem(freed, fitted_places(cell, solution), solution.sigmas)
    values = nearest_start(problem, solution)
    equations = problem.linearize(values, solution.sigmas)
    return freed, replace(solution, problem=problem, values=values, equations=equations, around=(), beside=None)


def _by_all(cell: Cell, solution: Solution, target: str) -> Measured | None:
    """The size of one target with all else free; None where the motions do not tell it."""
    told = any(p.target == target and (p.movers or p.handheld) for p in cell.layout.pictures)
    told |= any(t.target == target for t in cell.layout.touches)
    if cell.layout.rig or not told:
        return None
    problem = cell_problem(cell, fitted_places(cell, solution), solution.sigmas, free_sizes=(target,))
    freed = solve(problem, start=nearest_start(problem, solution), options=CLOSE_ENOUGH)
    if freed.unobservable:
        return None
    name = scale_variable(target)
    return Measured(1 + float(freed.value(name)[0, 0]), float(np.sqrt(freed.covariance(name)[0, 0])))
