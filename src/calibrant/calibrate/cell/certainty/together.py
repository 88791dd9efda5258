"""What all that a rig saw at one moment errs alike by: clocks that jitter, a target that moved, a bent board.

A moment is one cluster: its pictures share the target's pose, and whatever disturbs one of them moves all points that
it shows. By the influence of every residual on each place (`optimize.clusters`: scores z_g of n moments,
E sum |z_g|^2 = p where residuals are independent)

    k_c = sum_g |z_g|^2 / p,      k = 1 + max(mean_c k_c - 1, 0) (t / 1.96)^2,

and every covariance of the rig is multiplied by what k is above that which the lenses' own shares (`certainty.views`)
have brought already. One factor for all: as many directions as a rig has unknowns are not told apart by its moments.

Beside robots the moments are a part of what tells the places. With J, w of their residuals alone, M = C J^T W J C is
what their noise leaves in all unknowns; independent, sum_g E |z_g|^2 = tr A_c with A = C^-1/2 M C^-1/2 of a place, and
(k - 1) M is added, k the sum of |z_g|^2 over that of tr A_c, whatever the lenses' shares have brought.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.cell.problem.groups import pictures_factor
from calibrant.calibrate.cell.problem.layout import Frame, variable
from calibrant.calibrate.cell.problem.problem import Cell
from calibrant.calibrate.intrinsics.shared_errors import ROUNDING_PX
from calibrant.optimize.chances import NORMAL_95, t_interval
from calibrant.optimize.clusters import LEAST_CLUSTERS, corrected, edge_sums, influence_on_all, square_root
from calibrant.optimize.solution import Solution

_Sums = tuple[Array, Array, Array]
"""z (n, p) and G (n, p, p) of n moments on a place, and the root (6, p) of its covariance."""


@dataclass(frozen=True, eq=False)
class MomentErrors:
    """covariance (s, s): what is added to that of the shared unknowns; times: sigma over that of independent points."""

    covariance: Array
    times: float


def moment_errors(
    cell: Cell, solution: Solution, *, sigma_px: float, doubts: Array | float = 0.0
) -> MomentErrors | None:
    """What moments share, in the covariance of a rig's unknowns; None for exact data, and too few moments.

    solution: with what was added before; doubts (s, s): what of that no moment shares. sigma_px: the noise of the
    points.
    """
    plain = solution.plain
    frames = _tied(cell)
    moments = {m: k for k, m in enumerate(dict.fromkeys(m for i in _by_hand(cell) for m in cell.used_ids(i)))}
    if sigma_px < ROUNDING_PX or len(moments) < LEAST_CLUSTERS or not frames:
        return None
    if not cell.layout.rig:
        return _beside_robots(cell, plain, frames, moments)
    found = [corrected(sums, G, root=root) for sums, G, root in _sums(cell, plain, frames, moments)]
    sizes = [float(np.sum(c.scores**2)) / c.scores.shape[1] for c in found]
    free = max(min(float(np.mean([c.freedom for c in found])), len(moments) - 1), LEAST_CLUSTERS - 1)
    needed = 1 + max(float(np.mean(sizes)) - 1, 0.0) * (t_interval(free) / NORMAL_95) ** 2
    there = float(np.mean([_grown(plain, solution, f) for f in frames]))
    more = max(needed / there - 1, 0.0)
    whole = plain.shared_covariance if solution.beside is None else plain.shared_covariance + solution.beside
    shared = solution if solution.beside is None else plain.with_beside(solution.beside - doubts)
    said = max(needed, float(np.mean([_grown(plain, shared, f) for f in frames])))
    return MomentErrors(more * whole, float(np.sqrt(said)))


def _by_hand(cell: Cell) -> list[int]:
    """The lists of handheld targets."""
    return [i for i, p, _ in cell.lists if p.handheld and cell.used_views(i)]


def _tied(cell: Cell) -> list[Frame]:
    """The places that handheld targets tell: all of a rig, beside robots those of cameras that see them with others."""
    tied = [c for group in cell.layout.by_hand if len(group) > 1 for c in group]
    return [f for f in cell.layout.unknown if cell.layout.rig or f[1] in tied]


def _beside_robots(cell: Cell, plain: Solution, frames: Sequence[Frame], moments: dict[str, int]) -> MomentErrors:
    """What moments share where robots tell of the places too."""
    squares, shares, freedoms = 0.0, 0.0, []
    for sums, G, root in _sums(cell, plain, frames, moments):
        share = G.sum(axis=0)
        scatter = float(np.sum(G * G) + np.sum(np.einsum("gii->g", G) ** 2))
        freedoms.append(float(np.sum(share * share) + np.trace(share) ** 2) / scatter if scatter > 0 else np.inf)
        squares += float(np.sum(corrected(sums, G, root=root).scores ** 2))
        shares += float(np.trace(share))
    free = max(min(float(np.mean(freedoms)), len(moments) - 1), LEAST_CLUSTERS - 1)
    needed = 1 + max(squares / shares - 1, 0.0) * (t_interval(free) / NORMAL_95) ** 2
    s = len(plain.shared_covariance)
    M: Array = np.zeros((s, s))
    for i in _by_hand(cell):
        rows = influence_on_all(plain, pictures_factor(i)).reshape(-1, s)
        M = M + rows.T @ rows
    return MomentErrors((needed - 1) * M, float(np.sqrt(needed)))


def _grown(plain: Solution, solution: Solution, frame: Frame) -> float:
    """Variance of a place, over that of independent points, averaged over its directions."""
    _, inverse = square_root(plain.covariance(variable(frame)))
    beside = plain.with_beside(solution.beside).covariance(variable(frame))
    return float(np.trace(inverse @ beside @ inverse.T)) / len(inverse)


def _sums(cell: Cell, plain: Solution, frames: Sequence[Frame], moments: dict[str, int]) -> list[_Sums]:
    """z_g and G_g of all moments on each place, and the root of its covariance."""
    roots = [square_root(plain.covariance(variable(frame))) for frame in frames]
    sizes = [root.shape[1] for root, _ in roots]
    found = [(np.zeros((len(moments), p)), np.zeros((len(moments), p, p))) for p in sizes]
    asked = [(variable(frame), inverse) for frame, (_, inverse) in zip(frames, roots, strict=True)]
    for i in _by_hand(cell):
        at = [moments[m] for m in cell.used_ids(i)]
        for (sums, G), (z, square) in zip(found, edge_sums(plain, pictures_factor(i), asked), strict=True):
            np.add.at(sums, at, z)
            np.add.at(G, at, square)
    return [(sums, G, root) for (sums, G), (root, _) in zip(found, roots, strict=True)]
