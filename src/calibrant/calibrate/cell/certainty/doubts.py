"""What was given is right, or off by as much as the data can tell: what it is off by, in mean square.

The data put k numbers that were given d from where they were given, with the covariance C = P^-1. Before the data they
are right, or one of several groups g of them is off, with given odds, by what is normal with w^2 times what the data
tell the group to, C_g = P_gg^-1, all else as given, each of several w alike. The group is then seen to be off by
d_g = C_g P_g d, and the likelihood against that of right numbers is, in k parameters,

    (1 + w^2)^(-k/2) exp(b d_g^T P_gg d_g / 2),     b = w^2 / (1 + w^2).

The group is off by b C_g + b^2 d_g d_g^T in mean square, averaged over what the data leave possible.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array, Indices
from calibrant.optimize.solution import Solution
from calibrant.optimize.structure import SHARED


@dataclass(frozen=True, eq=False)
class Group:
    """at: which of the numbers are off at once; odds: of that against none, before the data."""

    at: tuple[int, ...]
    odds: float


@dataclass(frozen=True, eq=False)
class Doubt:
    """off (k, k): mean square of what the numbers are off by; chance: that any is off."""

    off: Array
    chance: float


def doubted(C: Array, d: Array, groups: Sequence[Group], spreads: Sequence[float]) -> Doubt:
    """What numbers that the data put d (k,) away, with covariance C (k, k), are off by. spreads: every w."""
    scale = np.sqrt(np.diag(C))
    P = np.linalg.inv(C / scale[:, None] / scale)
    logs, squares = [0.0], [np.zeros_like(C)]
    for group in groups:
        g = list(group.at)
        C_g = np.linalg.inv(P[np.ix_(g, g)])
        off = C_g @ P[g] @ (d / scale)
        for w in spreads:
            share = w**2 / (1 + w**2)
            odds = np.log(group.odds / len(spreads)) - 0.5 * len(g) * np.log1p(w**2)
            logs.append(float(odds + 0.5 * share * off @ P[np.ix_(g, g)] @ off))
            whole = np.zeros_like(C)
            whole[np.ix_(g, g)] = share * C_g + share**2 * np.outer(off, off)
            squares.append(whole)
    weight = np.exp(np.array(logs) - max(logs))
    weight /= weight.sum()
    return Doubt(np.asarray(scale[:, None] * np.tensordot(weight, squares, 1) * scale), float(1 - weight[0]))


def columns(solution: Solution, name: str) -> Indices:
    """Columns of a variable in the shared part; none for one that is held or eliminated."""
    p = solution.problem.structure.placements[solution.problem.variable_index(name)]
    if p is None or p.together != SHARED:
        return np.zeros(0, dtype=np.int64)
    return (p.offset[:, None] + np.arange(p.dim)).ravel()


def carried(solution: Solution, freed: Solution, at: Indices, but: Sequence[str] = ()) -> Array:
    """How all shared unknowns follow numbers that were given, (s, k): C_xs C_ss^-1.

    freed: the same problem with the numbers free, in columns `at` (k,) of its shared part; but: unknowns of the
    solution that hold them.
    """
    C = freed.shared_covariance[np.ix_(at, at)]
    scale = np.sqrt(np.diag(C))
    K = np.linalg.solve(C / scale[:, None] / scale, freed.shared_covariance[at] / scale[:, None]).T / scale
    moved = np.zeros((len(solution.shared_covariance), len(at)))
    for v in solution.problem.variables:
        if v.name not in but:
            moved[columns(solution, v.name)] = K[columns(freed, v.name)]
    return moved
