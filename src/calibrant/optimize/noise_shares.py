"""What each noise group adds to the normal matrix, as the traces that noise levels are estimated from.

With V, W the blocks of the eliminated components, P_c = -V_c^-1 W_c for each of them and P = I for the shared unknowns,
the inverse of the normal matrix is C = D + P C_s P^T, D = diag(V_c^-1) on the components and 0 on the shared unknowns.
For H_k with the blocks V_k, W_k, S_k,

    tr(H_k C)       = sum_c tr(V_k V^-1) + tr(B_k C_s),                                B_k = P^T H_k P,
    tr(H_k C H_l C) = sum_c tr(V_k V^-1 V_l V^-1) + 2 tr(G_kl C_s) + tr(B_k C_s B_l C_s),
    G_kl            = sum_c Q_k^T V^-1 Q_l,  Q_k = V_k P + W_k:

sums over the components, so that the time is linear in the views.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrant.optimize import linear
from calibrant.optimize.factors import EXACT
from calibrant.optimize.linear import NormalEquations
from calibrant.optimize.solution import Solution

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class NoiseShares:
    """counts (K,) residuals of each group; traces (K,) of H_k C; products (K, K), tr(H_k C H_l C)."""

    groups: tuple[str, ...]
    counts: Array
    traces: Array
    products: Array

    def information(self, groups: tuple[str, ...]) -> Array:
        """M_kl = tr(E_k R E_l R) of the groups asked for; see `level_spread`."""
        chosen = [self.groups.index(g) for g in groups]
        M = self.products + np.diag(self.counts - 2 * self.traces)
        return np.asarray(M[np.ix_(chosen, chosen)])


def noise_shares(solution: Solution) -> NoiseShares:
    """Shares of all noise groups at a solution. Raises: RefusedError when the problem is not determined."""
    problem = solution.problem
    groups = problem.noise_groups
    shares = [_of_group(solution, g) for g in groups]
    C_s = solution.shared_covariance
    inverses = solution.component_inverses
    K = len(groups)
    traces, own, B = np.zeros(K), np.zeros((K, K)), np.stack([share.S for share in shares])
    across = np.zeros((K, K))
    for batch, inverse in enumerate(inverses):
        P = -inverse @ solution.equations.W[batch]
        V, W = np.stack([share.V[batch] for share in shares]), np.stack([share.W[batch] for share in shares])
        turned, through_P = V @ inverse, V @ P
        Q = through_P + W
        traces += np.einsum("knii->k", turned)
        own += turned.reshape(K, -1) @ np.swapaxes(turned, 2, 3).reshape(K, -1).T
        # tr(G_kl C_s) = sum of (Q_k C_s) times (V^-1 Q_l), number by number.
        across += (Q.reshape(-1, len(C_s)) @ C_s).reshape(K, -1) @ (inverse @ Q).reshape(K, -1).T
        # P^T V_k P + P^T W_k + W_k^T P is the symmetric part of P^T (V_k P + 2 W_k).
        half = 0.5 * _flat(P).T @ (Q + W).reshape(K, -1, len(C_s))
        B += half + np.swapaxes(half, 1, 2)
    seen = B @ C_s
    traces += np.einsum("kii->k", seen)
    products = own + 2 * across + seen.reshape(K, -1) @ np.swapaxes(seen, 1, 2).reshape(K, -1).T
    counts = np.array(
        [sum(f.residual_count for f in problem.factors if f.noise == g) for g in groups], dtype=np.float64
    )
    return NoiseShares(groups, counts, traces, products)


def _flat(blocks: Array) -> Array:
    """(n, b, s) as (n b, s)."""
    return blocks.reshape(-1, blocks.shape[-1])


def _of_group(solution: Solution, group: str) -> NormalEquations:
    """The group's share of the normal equations."""
    problem = solution.problem
    mine = [k for k, f in enumerate(problem.factors) if f.noise == group and f.noise != EXACT]
    return linear.assemble(
        problem.structure,
        [solution.equations.factors[k] for k in mine],
        bases=[problem.bases(k, solution.values) for k in mine],
        chosen=mine,
    )
