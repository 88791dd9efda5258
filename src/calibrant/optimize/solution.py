"""A solved problem: values, how the solve ended, and its covariance, block by block, in linear time.

Noise levels are estimated from what each noise group adds to the normal matrix, as traces (`NoiseShares`).
With V, W the blocks of the eliminated components, P_c = -V_c^-1 W_c for each of them and P = I for the shared unknowns,
the inverse of the normal matrix is C = D + P C_s P^T, D = diag(V_c^-1) on the components and 0 on the shared unknowns.
For H_k with the blocks V_k, W_k, S_k,

    tr(H_k C)       = sum_c tr(V_k V^-1) + tr(B_k C_s),                                B_k = P^T H_k P,
    tr(H_k C H_l C) = sum_c tr(V_k V^-1 V_l V^-1) + 2 tr(G_kl C_s) + tr(B_k C_s B_l C_s),
    G_kl            = sum_c Q_k^T V^-1 Q_l,  Q_k = V_k P + W_k:

sums over the components, so that the time is linear in the views.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.errors import InputError, RefusedError
from calibrant.optimize import linear, unobservable
from calibrant.optimize.factors import EXACT
from calibrant.optimize.linear import Elimination, NormalEquations
from calibrant.optimize.structure import SHARED
from calibrant.optimize.unobservable import Unobservable

if TYPE_CHECKING:
    from calibrant.optimize.problem import Problem, Values

LEAST_OVER_ROUNDING = 10.0
"""An eigenvalue less than ten times what rounding may make of it says nothing: its sigma would be off by over 5 %."""
CLEAR_PIVOT = 1e-8
"""Cholesky pivots of the scaled matrix overestimate its smallest eigenvalue, by little in practice."""
CLEAR_OF_ROUNDING = 1e5
"""Pivots this many times above rounding, and above `CLEAR_PIVOT`, leave no doubt: no eigenvalues are computed."""


@dataclass(frozen=True, eq=False)
class Covariance:
    """Blocks of the inverse of H: shared (s, s); own (n, b, b) and cross (n, b, s) for each batch of components."""

    shared: Array
    own: tuple[Array, ...]
    cross: tuple[Array, ...]


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


@dataclass(frozen=True, eq=False)
class Solution:
    """Where a solve ended. cost = 1/2 sum rho; history: the cost after each accepted step.

    around: the same values under other noise levels, each with a weight: covariances are their sum (`level_spread`).
    beside: covariance (s, s) of the shared unknowns, free tangents, by errors that the noise levels do not hold: it is
    added, and moves the eliminated unknowns as far as they follow the shared ones (`beside.py`).
    """

    problem: Problem
    values: Values
    sigmas: Mapping[str, float]
    equations: NormalEquations
    converged: bool
    status: str
    message: str
    history: tuple[float, ...]
    around: tuple[tuple[float, Solution], ...] = ()
    beside: Array | None = None

    @property
    def cost(self) -> float:
        return self.equations.cost

    @property
    def iterations(self) -> int:
        """Accepted steps."""
        return len(self.history) - 1

    def value(self, name: str) -> Array:
        """Values (count, …) of a variable."""
        return self.values[self.problem.variable_index(name)]

    def residuals(self, factor: str) -> Array:
        """Residuals (N, dim) of a factor by name, unweighted: predicted minus observed."""
        if factor not in self._residuals:
            k = self.problem.factor_index(factor)
            self._residuals[factor] = self.problem.factors[k].residuals(*self.problem.gather(k, self.values))
        return self._residuals[factor]

    @cached_property
    def _residuals(self) -> dict[str, Array]:
        return {}

    def weights(self, factor: str) -> Array:
        """Robust weight (N,) that each residual block ended with: 1 is full, 0 is ignored."""
        k = self.problem.factor_index(factor)
        f = self.problem.factors[k]
        norms = f.whitened_norms(self.problem.gather(k, self.values), sigma=self.problem.sigma(f, self.sigmas))
        return f.loss.evaluate(norms**2)[1]

    @cached_property
    def plain(self) -> Solution:
        """The same without `around` and `beside`: what follows from the equations alone is computed there, once."""
        return replace(self, around=(), beside=None) if self.around or self.beside is not None else self

    def with_beside(self, beside: Array | None) -> Solution:
        """The same with other errors beside, and with what is computed already."""
        other = replace(self, beside=beside)
        if other.around or beside is not None:
            other.__dict__["plain"] = self.plain
        return other

    @cached_property
    def _parts(self) -> tuple[Elimination, ...]:
        if self.plain is not self:
            return self.plain._parts
        e = self.equations
        return tuple(linear.eliminate(V, W, v, 0.0) for V, W, v in zip(e.V, e.W, e.v))

    @cached_property
    def unobservable(self) -> tuple[Unobservable, ...]:
        """Directions that the data do not determine: empty for a well-posed problem."""
        if self.plain is not self:
            return self.plain.unobservable
        weak = unobservable.of_components(self.problem, self._parts)
        if weak:
            return weak
        scale, _, null = self._shared_spectrum
        return unobservable.of_shared(self.problem, self.values, null, scale)

    @cached_property
    def _shared_spectrum(self) -> tuple[Array, Array, Array]:
        """Scale, inverse of the scaled shared matrix, and its unit null vectors (s, n_null), scaled."""
        from calibrant.optimize import linear_kernels

        if self.plain is not self:
            return self.plain._shared_spectrum
        S, _ = linear.reduce_shared(self.equations, self._parts)
        diagonal = np.diag(self.equations.S) if len(S) else np.zeros(0)
        scale = 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
        if not len(S):
            return scale, S, S
        scaled = S * scale[:, None] * scale
        inverse = np.empty_like(scaled)
        rounding = self._shared_rounding(scale)
        if linear_kernels.invert_definite(scaled, inverse) > max(CLEAR_PIVOT, CLEAR_OF_ROUNDING * rounding):
            return scale, inverse, np.zeros((len(S), 0))
        values, vectors = np.linalg.eigh(scaled)
        null = values < LEAST_OVER_ROUNDING * rounding
        inverse = (vectors[:, ~null] / values[~null]) @ vectors[:, ~null].T
        return scale, inverse, vectors[:, null]

    def _shared_rounding(self, scale: Array) -> float:
        """How far rounding moves the eigenvalues of the scaled shared matrix: those below it are no information.

        S = S_0 - sum_i Y_i^T Y_i has the diagonal of S_0 scaled to 1, so that its own sums and its eigenvalues are off
        by up to s eps for s unknowns. Y_i^T Y_i = W_i^T V_i^-1 W_i is off by kappa(V_i) eps of itself, the condition of
        a component (Higham 2002, "Accuracy and stability of numerical algorithms", section 10.1), for which the
        smallest pivot of V_i, scaled to a unit diagonal, stands.
        """
        carried = np.zeros(len(scale))
        for part, V in zip(self._parts, self.equations.V):
            pivots = np.einsum("nii->ni", part.L) ** 2 / np.einsum("nii->ni", V)
            carried += np.einsum("n,nbs->s", 1 / pivots.min(axis=1), part.Y**2)
        return float(np.finfo(np.float64).eps * (len(scale) + (carried * scale**2).max()))

    @cached_property
    def shared_covariance(self) -> Array:
        """Covariance (s, s) of the shared unknowns at these noise levels.

        Raises: RefusedError naming what the data do not determine.
        """
        if self.plain is not self:
            return self.plain.shared_covariance
        if self.unobservable:
            raise RefusedError(
                "the problem has no covariance: "
                + "; ".join(u.message for u in self.unobservable[:5])
                + ". Hold these parameters, or add data that move them"
            )
        scale, inverse, _ = self._shared_spectrum
        return np.ascontiguousarray(inverse * scale[:, None] * scale)

    @cached_property
    def blocks(self) -> Covariance:
        """All blocks of the inverse at these noise levels, computed once. Raises: as `shared_covariance`."""
        from calibrant.optimize import linear_kernels

        if self.plain is not self:
            return self.plain.blocks
        shared = self.shared_covariance
        own, cross = [], []
        for part in self._parts:
            n, b, s = part.Y.shape
            o, c = np.empty((n, b, b)), np.empty((n, b, s))
            linear_kernels.component_covariances(part.L, part.Y, shared, o, c)
            own.append(o)
            cross.append(c)
        return Covariance(shared, tuple(own), tuple(cross))

    @cached_property
    def component_inverses(self) -> tuple[Array, ...]:
        """V^-1 (n, b, b) of every batch of components."""
        from calibrant.optimize import linear_kernels

        out = []
        for part in self._parts:
            n, b, _ = part.Y.shape
            inverse = np.empty((n, b, b))
            linear_kernels.component_covariances(
                part.L, np.empty((n, b, 0)), np.empty((0, 0)), inverse, np.empty((n, b, 0))
            )
            out.append(inverse)
        return tuple(out)

    @cached_property
    def noise_shares(self) -> NoiseShares:
        """Shares of the noise groups in the normal matrix, computed once. Raises: RefusedError as `blocks`."""
        return _noise_shares(self)

    def covariance(self, name: str, index: int = 0) -> Array:
        """Covariance (k, k) of one instance in its natural tangent; held components have variance 0."""
        return self.joint_covariance([(name, index)])

    def joint_covariance(self, instances: Sequence[tuple[str, int]]) -> Array:
        """Joint covariance, natural tangents stacked in the order asked, of any instances of any variables."""
        if self.around:
            by_noise = np.asarray(sum(w * s.joint_covariance(instances) for w, s in self.around))
        else:
            rows = [self._rows(name, index) for name, index in instances]
            by_noise = np.block([[self._cross_block(a, b) for b in rows] for a in rows])
        if self.beside is None:
            return by_noise
        F = np.concatenate([self._follows(name, index) for name, index in instances])
        return np.asarray(by_noise + F @ self.beside @ F.T)

    def covariances(self, name: str) -> Array:
        """Covariance (count, k, k) of every instance of a variable in its natural tangent."""
        if self.beside is not None:
            count = self.problem.variables[self.problem.variable_index(name)].count
            F = np.stack([self._follows(name, k) for k in range(count)])
            return np.asarray(replace(self, beside=None).covariances(name) + F @ self.beside @ np.swapaxes(F, -1, -2))
        if self.around:
            return np.asarray(sum(w * s.covariances(name) for w, s in self.around))
        i = self.problem.variable_index(name)
        variable, p = self.problem.variables[i], self.problem.structure.placements[i]
        k = len(variable.manifold.natural_names)
        if p is None:
            return np.zeros((variable.count, k, k))
        columns = p.offset[:, None] + np.arange(p.dim)
        out = np.empty((variable.count, p.dim, p.dim))
        for batch in np.unique(p.batch).tolist():
            mine = p.batch == batch
            c = columns[mine]
            if batch == SHARED:
                out[mine] = self.shared_covariance[c[:, :, None], c[:, None, :]]
            else:
                out[mine] = self.blocks.own[batch][p.row[mine][:, None, None], c[:, :, None], c[:, None, :]]
        basis = variable.manifold.basis(self.values[i])
        return out if basis is None else basis @ out @ np.swapaxes(basis, -1, -2)

    def _rows(self, name: str, index: int) -> _Rows:
        i = self.problem.variable_index(name)
        variable, p = self.problem.variables[i], self.problem.structure.placements[i]
        if not 0 <= index < variable.count:
            raise InputError(f"variable {name!r} has {variable.count} instances, asked for number {index}")
        k = len(variable.manifold.natural_names)
        if p is None:
            return _Rows(SHARED, 0, np.zeros(0, dtype=np.int64), np.zeros((k, 0)))
        basis = variable.manifold.basis(self.values[i])
        B = np.eye(k) if basis is None else basis[min(index, len(basis) - 1)]
        return _Rows(int(p.batch[index]), int(p.row[index]), p.offset[index] + np.arange(p.dim), B)

    def _follows(self, name: str, index: int) -> Array:
        """d natural tangent of an unknown / d shared unknowns, (k, s): itself, or what -V^-1 W makes an eliminated one
        do."""
        rows = self._rows(name, index)
        if rows.batch == SHARED:
            return rows.basis @ np.eye(len(self.equations.S))[rows.columns]
        part = self._parts[rows.batch]
        moved = -np.linalg.solve(part.L[rows.row].T, part.Y[rows.row])
        return np.asarray(rows.basis @ moved[rows.columns])

    def _cross_block(self, a: _Rows, b: _Rows) -> Array:
        """Covariance between two sets of unknowns, natural tangents."""
        if a.batch == SHARED and b.batch == SHARED:
            free = self.shared_covariance[np.ix_(a.columns, b.columns)]
            return a.basis @ free @ b.basis.T
        blocks = self.blocks
        if b.batch == SHARED:
            free = blocks.cross[a.batch][a.row][np.ix_(a.columns, b.columns)]
        elif a.batch == SHARED:
            free = blocks.cross[b.batch][b.row][np.ix_(b.columns, a.columns)].T
        elif (a.batch, a.row) == (b.batch, b.row):
            free = blocks.own[a.batch][a.row][np.ix_(a.columns, b.columns)]
        else:
            # Different components meet only through the shared unknowns: U_a C_s U_b^T = -cross_a U_b^T.
            part = self._parts[b.batch]
            U = np.linalg.solve(part.L[b.row].T, part.Y[b.row])
            free = -(blocks.cross[a.batch][a.row][a.columns] @ U.T[:, b.columns])
        return a.basis @ free @ b.basis.T


@dataclass(frozen=True, eq=False)
class _Rows:
    batch: int
    row: int
    columns: NDArray[np.int64]
    basis: Array


def _noise_shares(solution: Solution) -> NoiseShares:
    """Shares of all noise groups at a solution. Raises: RefusedError when the problem is not determined."""
    problem = solution.problem
    groups = problem.noise_groups
    shares = [_equations_of(solution, g) for g in groups]
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
        half = 0.5 * _as_columns(P).T @ (Q + W).reshape(K, -1, len(C_s))
        B += half + np.swapaxes(half, 1, 2)
    seen = B @ C_s
    traces += np.einsum("kii->k", seen)
    products = own + 2 * across + seen.reshape(K, -1) @ np.swapaxes(seen, 1, 2).reshape(K, -1).T
    counts = np.array(
        [sum(f.residual_count for f in problem.factors if f.noise == g) for g in groups], dtype=np.float64
    )
    return NoiseShares(groups, counts, traces, products)


def _as_columns(blocks: Array) -> Array:
    """(n, b, s) as (n b, s)."""
    return blocks.reshape(-1, blocks.shape[-1])


def _equations_of(solution: Solution, group: str) -> NormalEquations:
    """The group's share of the normal equations."""
    problem = solution.problem
    mine = [k for k, f in enumerate(problem.factors) if f.noise == group and f.noise != EXACT]
    return linear.assemble(
        problem.structure,
        [solution.equations.factors[k] for k in mine],
        bases=[problem.bases(k, solution.values) for k in mine],
        chosen=mine,
    )
