"""Which views contradict the others, judged by what their noise allows.

Each view sees its target at B_i, and the robots say where it should be. The deviation d_i = local(predicted, B_i) has
the covariance C_i that the view leaves in B_i and the robots' noise leaves in the prediction; d_i^T C_i^-1 d_i is
chi-square with 6 degrees of freedom. The statistics of a list are divided by their median over that of chi-square, so
that noise levels estimated too low (by few poses, or by a model that does not fit) do not condemn good views.
"""

from __future__ import annotations

import numpy as np

from calibrant.arrays import Array, Mask
from calibrant.calibrate.cell.fitted import pose_maps, pose_noise, pose_rows, prediction
from calibrant.calibrate.cell.problem.problem import Cell
from calibrant.geometry import se3
from calibrant.optimize.chances import CHI2_6_LIMIT, CHI2_6_MEDIAN
from calibrant.optimize.solution import Solution

ROUNDING = 1e-12
"""Squared deviations (rad^2, m^2) below this are rounding, whose distribution means nothing."""


def inconsistent_views(cell: Cell, solution: Solution, i: int) -> Mask:
    """True for each row of list i that is used and disagrees with the others beyond its noise."""
    use = cell.data[i].use
    out = np.zeros(len(use), dtype=bool)
    if use.any():
        statistic, size = loop_statistics(cell, solution, i)
        scale = max(float(np.median(statistic)) / CHI2_6_MEDIAN, 1.0)
        out[np.flatnonzero(use)] = (statistic / scale > CHI2_6_LIMIT) & (size > ROUNDING)
    return out


def loop_statistics(cell: Cell, solution: Solution, i: int) -> tuple[Array, Array]:
    """d_i^T C_i^-1 d_i and |d_i|^2 of every row of list i that is used."""
    data, p = cell.data[i], cell.layout.pictures[i]
    use, levels = data.use, solution.sigmas
    d = se3.local(prediction(cell, solution.value, i, use), data.B[use])
    if p.seen is None:
        rotation, translation = (levels[g] for g in cell.measured_noise(p))
        C: Array = np.diag([rotation**2] * 3 + [translation**2] * 3)
    else:
        C = data.covariance[use] * (cell.pixel_ratios[p.camera] * levels[cell.pixel_group(p.camera)]) ** 2
    at = pose_rows(cell, i, use)
    for robot, M in pose_maps(cell, solution.value, i, use).items():
        C = C + M @ pose_noise(cell, solution, robot)[at[robot]] @ np.swapaxes(M, -1, -2)
    return np.einsum("ni,ni->n", d, np.linalg.solve(C, d[..., None])[..., 0]), np.sum(d * d, axis=1)
