"""Which views contradict the others, judged by what their noise allows.

Each view puts the target at Z_i = A_i X B_i. Its deviation d_i from Z has the covariance that the pixels leave in B_i
and the robot's noise leaves in A_i, both carried to Z_i; d_i^T C_i^-1 d_i is chi-square with 6 degrees of freedom. The
statistics are divided by their median over that of chi-square, so that noise levels estimated too low (by few poses,
or by a model that does not fit) do not condemn good views.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calibrant.calibrate.cell.problem.camera_role import PIXEL, ROBOT_ROTATION, ROBOT_TRANSLATION
from calibrant.calibrate.cell.problem.pose_pairs import FLANGE_ROTATION, TARGET_ROTATION, TARGET_TRANSLATION
from calibrant.calibrate.cell.views import HandEyeViews
from calibrant.calibrate.reprojection.links import Link, link_maps
from calibrant.calibrate.solvers.setup import Setup
from calibrant.geometry import se3
from calibrant.optimize.noise import NoiseEstimate

Array = NDArray[np.float64]

CHI2_6_LIMIT = 27.86
"""chi-square of 6 degrees of freedom at P = 1e-4: in a thousand views, 0.1 would be left out by chance."""
CHI2_6_MEDIAN = 5.348
ROUNDING = 1e-12
"""Squared deviations (rad^2, m^2) below this are rounding, whose distribution means nothing."""


def inconsistent_views(setup: Setup, data: HandEyeViews, noise: NoiseEstimate) -> NDArray[np.bool_]:
    """True for each used view that disagrees with the others beyond its noise."""
    statistic, size = loop_statistics(setup, data, noise)
    scale = max(float(np.median(statistic)) / CHI2_6_MEDIAN, 1.0)
    return (statistic / scale > CHI2_6_LIMIT) & (size > ROUNDING)


def loop_statistics(setup: Setup, data: HandEyeViews, noise: NoiseEstimate) -> tuple[Array, Array]:
    """d_i^T C_i^-1 d_i and |d_i|^2 of every used view."""
    solution = noise.solution
    X, Z = solution.value(setup.camera_transform)[0], solution.value(setup.target_transform)[0]
    use = data.use
    robot, B = data.T_base_gripper[use], data.B[use]
    rows = np.arange(len(B))
    chain = [Link("A", rows, inverted=setup.robot_inverted), Link("X", rows), Link("B", rows)]
    values = [robot, np.broadcast_to(X, B.shape), B]
    to_A, _, to_B = link_maps(chain, values)
    levels = solution.sigmas
    if data.views is None:
        of_A = _diagonal(levels[FLANGE_ROTATION], levels[TARGET_TRANSLATION])
        of_B = _diagonal(levels[TARGET_ROTATION], levels[TARGET_TRANSLATION])
    else:
        of_A = _diagonal(levels[ROBOT_ROTATION], levels[ROBOT_TRANSLATION])
        of_B = data.covariance[use] * levels[PIXEL] ** 2
    C = to_A @ of_A @ np.swapaxes(to_A, -1, -2) + to_B @ of_B @ np.swapaxes(to_B, -1, -2)
    d = se3.local(Z, setup.normal_form(robot) @ X @ B)
    return np.einsum("ni,ni->n", d, np.linalg.solve(C, d[..., None])[..., 0]), np.sum(d * d, axis=1)


def _diagonal(rotation: float, translation: float) -> Array:
    return np.diag([rotation**2] * 3 + [translation**2] * 3)
