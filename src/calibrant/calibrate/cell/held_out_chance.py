"""How much larger than in the fit errors are where a pose was left out of it, by chance alone.

Pose i has K_i in the shared unknowns' equations S = R + sum_i K_i (`fit_without`). Its errors e_i, of robot and image,
of covariance T_i, are in them as -G_i e_i (`pose_errors`); what else its points say of the lens as u_i, of covariance
K_i - G_i T_i G_i^T; what no pose has a part in as u_0, of covariance R. All are independent, and linear in them are

    x = S^-1 (u_0 + sum_i k_i),   k_i = u_i - G_i e_i,   x_F = (S - K_F)^-1 (u_0 + sum_(i not in F) k_i),

the shared unknowns by all poses and without those of F, and by how much the target misses where a view saw it,

    d_i(x) = J_i (e_i + T_i G_i^T x),

J_i the loop's map, x with its own lens, which sees the target too. Held-out errors are r times those of the loop, rms,
or more, where q = sum_i |d_i(x_F)|^2 - r^2 |d_i(x)|^2 > 0. q is a sum of l_k times squares of normal variables, l_k the
eigenvalues of their covariance with the signs of q, and for every s > 0 that keeps all factors positive

    P(q > 0) <= E exp(s q) = prod_k (1 - 2 s l_k)^-1/2

(Chernoff, "A measure of asymptotic efficiency for tests of a hypothesis", 1952). The least of these bounds is taken.
"""

from __future__ import annotations

import numpy as np

from calibrant.arrays import Array, Indices
from calibrant.calibrate.cell.certainty.pose_errors import PoseErrors, pose_errors
from calibrant.calibrate.cell.fitted import pose_maps
from calibrant.calibrate.cell.held_out import folds
from calibrant.calibrate.cell.problem.fit_without import PoseShares, pose_shares
from calibrant.calibrate.cell.problem.groups import robot_groups
from calibrant.calibrate.cell.problem.layout import poses_variable
from calibrant.calibrate.cell.problem.problem import Cell
from calibrant.optimize.solution import Solution

_KNOWN = 1e-9
"""Share of a direction's information that the other poses must have: below, they do not hold it."""
_HALVINGS = 60


def held_out_chance(cell: Cell, solution: Solution, ratio: float) -> float | None:
    """At most so often do independent errors make held-out errors `ratio` times the loop's, rms, mm, or more.

    None for cells of several lists, for free joints, and where a pose left out is not held by the others.
    """
    if len(cell.data) != 1 or len(cell.layout.robots) != 1 or cell.free:
        return None
    robot, data = next(iter(cell.layout.robots)), cell.data[0]
    errors = pose_errors(solution, poses_variable(robot), robot_groups(robot))
    maps = pose_maps(cell, solution.value, 0, data.use).get(robot)
    if errors is None or maps is None:
        return None
    shares = pose_shares(solution, poses_variable(robot))
    if shares is None:
        return None
    moments = cell.moments(robot)
    at = np.array([moments.index(name) for name, use in zip(data.ids, data.use) if use], dtype=np.int64)
    moved = 1e3 * np.broadcast_to(maps, (len(at), 6, 6))[:, 3:]
    misses = _misses(errors, shares, at, folds(cell)[0][data.use], moved)
    if misses is None:
        return None
    held, loop = misses
    both = np.concatenate([held, ratio * loop])
    values, axes = np.linalg.eigh(both @ both.T)
    root = axes * np.sqrt(np.maximum(values, 0.0))
    signs = np.repeat([1.0, -1.0], len(held))
    return above_zero(np.linalg.eigvalsh(root.T @ (signs[:, None] * root)))


def _misses(
    errors: PoseErrors, shares: PoseShares, at: Indices, fold: Indices, maps: Array
) -> tuple[Array, Array] | None:
    """d_i(x_F) and d_i(x), (3 n, N) each, of N independent errors, in units of their sigma; see the module.

    at (n,): the rows of the poses; fold (n,): what each is left out with; maps (n, 3, 6): J.
    """
    n, s = len(at), len(shares.S)
    own = 6 + s
    L, G = errors.units(of_flange=False)[at], errors.pull[at]
    GL, K = G @ L, shares.of_S[at]
    unit = np.sqrt(np.diag(shares.S))
    lone = _roots(K - GL @ np.swapaxes(GL, 1, 2), unit)
    k = np.zeros((n, s, n * own + s))
    for i in range(n):
        k[i, :, i * own : (i + 1) * own] = np.concatenate([-GL[i], lone[i]], axis=1)
    k0 = np.zeros((s, n * own + s))
    k0[:, n * own :] = _roots((shares.S - K.sum(axis=0))[None], unit)[0]
    total = k0 + k.sum(axis=0)
    whole = np.linalg.solve(shares.S, total)
    answers = maps @ L @ np.swapaxes(GL, 1, 2)
    loop = answers @ whole
    held = loop.copy()
    for f in np.unique(fold).tolist():
        out = fold == f
        rest = shares.S - K[out].sum(axis=0)
        if np.linalg.eigvalsh(rest / unit[:, None] / unit)[0] < _KNOWN:
            return None
        without = np.linalg.solve(rest, total - k[out].sum(axis=0))
        held[out] = answers[out] @ without
    for i in range(n):
        own_errors = maps[i] @ L[i]
        held[i, :, i * own : i * own + 6] += own_errors
        loop[i, :, i * own : i * own + 6] += own_errors
    return held.reshape(3 * n, -1), loop.reshape(3 * n, -1)


def _roots(C: Array, unit: Array) -> Array:
    """R (n, s, s), R R^T = C, of matrices that rounding may leave below zero; unit (s,): of their rows."""
    values, axes = np.linalg.eigh(C / unit[:, None] / unit)
    return np.asarray(unit[:, None] * axes * np.sqrt(np.maximum(values, 0.0))[:, None, :])


def above_zero(weights: Array) -> float:
    """A bound on P(sum_k w_k x_k^2 > 0), x_k independent standard normal variables; 1 where the mean is not below 0."""
    top = float(weights.max())
    if top <= 0:
        return 0.0
    if float(weights.sum()) >= 0:
        return 1.0
    low, high = 0.0, 0.5 / top
    for _ in range(_HALVINGS):  # the logarithm of the bound is convex in s: its slope changes sign once
        s = 0.5 * (low + high)
        below = float(np.sum(weights / (1 - 2 * s * weights))) < 0
        low, high = (s, high) if below else (low, s)
    return float(np.exp(-0.5 * np.sum(np.log1p(-2 * low * weights))))
