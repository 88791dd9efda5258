"""The normal equations: assembly from edge blocks, the Schur complement, the step, and the blocks of the inverse.

Compiled kernels do the many small factorisations (`linear_kernels`); `eliminate_numpy` is their readable form and test.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrant.optimize.factors import FactorBlocks
from calibrant.optimize.structure import Scatter, Structure

Array = NDArray[np.float64]

PIVOT_TOLERANCE = 1e-14
"""A Cholesky pivot below this share of its diagonal is rounding (b^2 eps for b ~ 10), not information."""


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """H d = -g in the blocks of `structure`: V, v a batch of components each; W their coupling; S, s the dense part.

    factors: the edge blocks that were summed, one entry a factor.
    """

    cost: float
    V: tuple[Array, ...]
    v: tuple[Array, ...]
    W: tuple[Array, ...]
    S: Array
    s: Array
    factors: tuple[FactorBlocks, ...] = ()


@dataclass(frozen=True, eq=False)
class Step:
    """A solution of the damped equations. predicted: decrease of the cost by the quadratic model."""

    components: tuple[Array, ...]
    shared: Array
    predicted: float


@dataclass(frozen=True, eq=False)
class Elimination:
    """V = L L^T, Y = L^-1 W, z = L^-1 v per component; weak (n,) is the first weak pivot's column, -1 when none."""

    L: Array
    Y: Array
    z: Array
    weak: NDArray[np.int64]


def assemble(
    structure: Structure, factors: Sequence[FactorBlocks], *, bases: Sequence[Sequence[Array | None]]
) -> NormalEquations:
    """Sum the edge blocks of all factors. bases: for each factor, each slot's natural-from-free basis, or None."""
    shared = structure.shared
    V = [np.zeros((n, b, b)) for b, n in structure.batches]
    v = [np.zeros((n, b)) for b, n in structure.batches]
    W = [np.zeros((n, b, shared)) for b, n in structure.batches]
    S, s = np.zeros((shared, shared)), np.zeros(shared)
    matrices: dict[str, Sequence[Array]] = {"V": V, "W": W, "S": [S]}
    vectors: dict[str, Sequence[Array]] = {"v": v, "s": [s]}
    cost = 0.0
    for blocks, basis, scatters, gradients in zip(factors, bases, structure.scatters, structure.gradient_scatters):
        cost += blocks.cost
        for scatter in scatters:
            a, b = scatter.slots
            block = in_free(blocks.hessian[a, b], basis[a], basis[b])
            _add(matrices[scatter.destination][scatter.batch], scatter, _turned(block, scatter.transpose))
        for scatter in gradients:
            a = scatter.slots[0]
            _add(vectors[scatter.destination][scatter.batch], scatter, _gradient_in_free(blocks.gradient[a], basis[a]))
    return NormalEquations(cost, tuple(V), tuple(v), tuple(W), S, s, tuple(factors))


LARGE_BASIS = 32
"""Components from which picking rows beats multiplying: below, a product takes a few microseconds."""


def in_free(block: Array, left: Array | None, right: Array | None) -> Array:
    """A block (m, p, q) of natural tangents in the free ones: left^T block right, None standing for the identity."""
    if left is not None:
        rows = _selected(left)
        block = np.swapaxes(left, -1, -2) @ block if rows is None else block[:, rows]
    if right is None:
        return block
    columns = _selected(right)
    return block @ right if columns is None else block[:, :, columns]


def _selected(basis: Array) -> NDArray[np.int64] | None:
    """The rows that a large basis (1, p, f) picks, when it does only that: held components of a vector of hundreds.

    Products with such a matrix take longer than all the rest; small ones are faster than the look.
    """
    if basis.shape[0] != 1 or basis.shape[1] <= LARGE_BASIS or np.count_nonzero(basis) != basis.shape[2]:
        return None
    rows = np.argmax(basis[0], axis=0)
    return rows if np.all(basis[0, rows, np.arange(len(rows))] == 1.0) else None


def _gradient_in_free(gradient: Array, basis: Array | None) -> Array:
    return gradient if basis is None else (gradient[:, None, :] @ basis)[:, 0]


def _turned(block: Array, transpose: bool) -> Array:
    return np.swapaxes(block, -1, -2) if transpose else block


def _add(destination: Array, scatter: Scatter, blocks: Array) -> None:
    if scatter.edges is not None:
        blocks = blocks[scatter.edges]
    if scatter.sum_order is not None:
        blocks = blocks[scatter.sum_order]
    if scatter.sum_starts is not None:
        if len(scatter.sum_starts) == 1:
            blocks = blocks.sum(axis=0)
        else:
            blocks = np.add.reduceat(blocks, scatter.sum_starts, axis=0)
    destination.reshape(-1)[scatter.target] += blocks.reshape(-1)


def _diagonal(M: Array) -> Array:
    """Diagonal, with 1 in place of 0: an unknown that nothing depends on keeps a zero step."""
    d = np.diagonal(M, axis1=-2, axis2=-1)
    return np.where(d > 0, d, 1.0)


def eliminate_numpy(V: Array, W: Array, v: Array, damping: float) -> Elimination:
    """Readable form of the compiled `eliminate`: Cholesky of V + damping diag V, forward substitution of W and v."""
    damped = V + damping * _diagonal(V)[..., None] * np.eye(V.shape[-1])
    L = np.linalg.cholesky(damped).astype(np.float64)
    rhs = np.concatenate([W, v[..., None]], axis=-1)
    solved = np.linalg.solve(L, rhs)
    return Elimination(L, solved[..., :-1], solved[..., -1], np.full(len(V), -1))


def eliminate(V: Array, W: Array, v: Array, damping: float) -> Elimination:
    """Factorise a batch of components; see `Elimination`."""
    from calibrant.optimize import linear_kernels

    n, b, s = W.shape
    L, Y, z, weak = np.empty((n, b, b)), np.empty((n, b, s)), np.empty((n, b)), np.empty(n, dtype=np.int64)
    linear_kernels.eliminate(V, W, v, damping, PIVOT_TOLERANCE, L, Y, z, weak)
    return Elimination(L, Y, z, weak)


def reduce_shared(equations: NormalEquations, parts: Sequence[Elimination], damping: float) -> tuple[Array, Array]:
    """S_0 + damping diag S_0 - sum Y^T Y and s - sum Y^T z."""
    S, s = equations.S.copy(), equations.s.copy()
    if not len(s):
        return S, s
    if damping:
        S.reshape(-1)[:: len(s) + 1] += damping * _diagonal(equations.S)
    for part in parts:
        Y = part.Y.reshape(-1, S.shape[0])
        S -= Y.T @ Y
        s -= Y.T @ part.z.reshape(-1)
    return S, s


def solve(equations: NormalEquations, damping: float) -> Step | None:
    """One damped step, (H + damping diag H) d = -g. None when the matrix is not positive definite: damp more."""
    from calibrant.optimize import linear_kernels

    parts = [eliminate(V, W, v, damping) for V, W, v in zip(equations.V, equations.W, equations.v)]
    if any(part.weak.max() >= 0 for part in parts):
        return None
    S, s = reduce_shared(equations, parts, damping)
    shared = np.zeros(len(s))
    diagonal = _diagonal(equations.S)
    if len(s) and not linear_kernels.solve_definite(S, s, diagonal, PIVOT_TOLERANCE, shared):
        return None
    components = []
    predicted = -0.5 * float(equations.s @ shared) + 0.5 * damping * float(diagonal @ (shared * shared))
    for part, V, v in zip(parts, equations.V, equations.v):
        d = np.empty_like(v)
        predicted += linear_kernels.substitute(part.L, part.Y, part.z, shared, V, v, damping, d)
        components.append(d)
    return Step(tuple(components), shared, predicted)
