"""What one view says about a camera's mounting: its information, by the source of its noise.

The unknowns are x = (X, Z), camera and target transform, and the nuisances c = (camera, target scale). A view's robot
pose r is eliminated: with its normal block H_rr (all sources), K = H_rr^-1 H_rs, completing the square gives the
reduced normal matrix exactly as a sum over sources, S = sum_k [I; -K]^T H_k [I; -K].
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.cell.problem.camera_role import CameraRole
from calibrant.calibrate.cell.problem.groups import PIXEL, pixel_group, robot_groups
from calibrant.calibrate.cell.problem.layout import ONLY_ROBOT
from calibrant.calibrate.cell.problem.problem import cell_of_one, cell_problem
from calibrant.calibrate.solvers.setup import Setup
from calibrant.cameras import Camera
from calibrant.data import DEFAULT_CAMERA, View
from calibrant.optimize.factors import FactorBlocks

PIXELS, ROBOT_ROTATION, ROBOT_TRANSLATION = "pixels", "robot rotation", "robot translation"


@dataclass(frozen=True)
class NoiseLevels:
    """1 sigma per axis: pixels, and the robot's poses in radians and metres."""

    pixel: float
    robot_rotation: float
    robot_translation: float


def view_information(
    setup: Setup, views: Sequence[View], T_base_gripper: Array, camera: Camera, X: Array, Z: Array, noise: NoiseLevels
) -> dict[str, Array]:
    """Information of each view about (X, Z, camera, target scale), its robot pose eliminated, by noise source.

    Returns arrays (n, 13 + k, 13 + k) by source; over the sources they sum to the view's reduced normal matrix.
    """
    cell = cell_of_one(setup, T_base_gripper, views, CameraRole(camera, ()))
    rotation, translation = robot_groups(ONLY_ROBOT)
    levels = {
        pixel_group(DEFAULT_CAMERA): noise.pixel,
        rotation: noise.robot_rotation,
        translation: noise.robot_translation,
    }
    problem = cell_problem(cell, cell.placed(X, Z), levels, free_sizes=cell.layout.target_names)
    k = len(camera.values)
    sizes = (6, 6, 6, k, 1)
    robot = slice(6, 12)  # after X, before Z, in the order of the links
    information = {}
    for number, factor in enumerate(problem.factors):
        blocks = factor.blocks(problem.gather(number, problem.start), sigma=levels[factor.noise])
        H = np.zeros((len(views), 19 + k, 19 + k))
        if factor.noise.startswith(PIXEL):
            H = stacked(blocks, sizes)
        else:
            H[:, robot, robot] = stacked(blocks, (6,))
        source = {rotation: ROBOT_ROTATION, translation: ROBOT_TRANSLATION}.get(factor.noise, PIXELS)
        information[source] = H
    return _without_robot(information, robot)


def _without_robot(information: Mapping[str, Array], robot: slice) -> dict[str, Array]:
    """Information (n, m, m) by source with each view's robot pose eliminated: L^T H_k L, L = [I; -K] (see above)."""
    H = np.sum(list(information.values()), axis=0)
    shared = np.r_[0 : robot.start, robot.stop : H.shape[-1]]
    lift = np.zeros((len(H), H.shape[-1], len(shared)))
    lift[:, shared, np.arange(len(shared))] = 1.0
    lift[:, robot] = -np.linalg.solve(H[:, robot, robot], H[:, robot][..., shared])
    return {name: np.swapaxes(lift, -1, -2) @ S @ lift for name, S in information.items()}


def stacked(blocks: FactorBlocks, sizes: Sequence[int]) -> Array:
    """Hessian blocks of a factor's slots as one matrix an edge, (m, sum sizes, sum sizes)."""
    starts = np.concatenate([[0], np.cumsum(sizes)])
    m = len(blocks.gradient[0])
    H = np.zeros((m, int(starts[-1]), int(starts[-1])))
    for (a, b), block in blocks.hessian.items():
        rows, columns = slice(starts[a], starts[a + 1]), slice(starts[b], starts[b + 1])
        H[:, rows, columns] = block
        H[:, columns, rows] = np.swapaxes(block, -1, -2)
    return H
