"""The normal equations: assembly from edge blocks, the Schur complement, the step, and the blocks of the inverse.

Compiled kernels do the many small factorisations (`linear_kernels`); `eliminate_numpy` is their readable form and test.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate
from math import isnan, prod

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array, Indices
from calibrant.optimize.factors import FactorBlocks
from calibrant.optimize.structure import Structure

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
    """V = L L^T, Y = L^-1 W, z = L^-1 v per component; weak (n,) is the first weak pivot's column, -1 when none.

    singular: there is a weak one.
    """

    L: Array
    Y: Array
    z: Array
    weak: NDArray[np.int64]
    singular: bool = False


def assemble(
    structure: Structure,
    factors: Sequence[FactorBlocks],
    *,
    bases: Sequence[Sequence[Array | None]],
    chosen: Sequence[int] | None = None,
) -> NormalEquations:
    """Sum the edge blocks of the factors, of all by default, `chosen` by their numbers.

    bases: for each of them, each slot's natural-from-free basis, None for the identity.
    """
    from calibrant.optimize import linear_kernels

    shared = structure.shared
    V = _Flat.of([(n, b, b) for b, n in structure.batches])
    W = _Flat.of([(n, b, shared) for b, n in structure.batches])
    v = _Flat.of([(n, b) for b, n in structure.batches])
    S, s = np.zeros((shared, shared)), np.zeros(shared)
    cost = 0.0
    for k, blocks, basis in zip(range(len(factors)) if chosen is None else chosen, factors, bases):
        cost += blocks.cost
        H, g, starts = in_free(blocks, basis)
        linear_kernels.add_edges(H, g, starts, structure.dims[k], structure.places[k], V.all, W.all, v.all, S, s)
    return NormalEquations(cost, V.parts, v.parts, W.parts, S, s, tuple(factors))


@dataclass(frozen=True, eq=False)
class _Flat:
    """Zeros of several shapes laid end to end, and each of them as a view."""

    all: Array
    parts: tuple[Array, ...]

    @classmethod
    def of(cls, shapes: Sequence[tuple[int, ...]]) -> _Flat:
        if len(shapes) == 1:
            only = np.zeros(shapes[0])
            return cls(only.reshape(-1), (only,))
        sizes = [prod(shape) for shape in shapes]
        flat = np.zeros(sum(sizes))
        ends = accumulate(sizes)
        parts = [flat[end - n : end].reshape(shape) for end, n, shape in zip(ends, sizes, shapes)]
        return cls(flat, tuple(parts))


LARGE_BASIS = 32
"""Components from which picking columns beats multiplying: below, a product takes a few microseconds."""


def in_free(blocks: FactorBlocks, bases: Sequence[Array | None]) -> tuple[Array, Array, Indices]:
    """H (m, f, f) and g (m, f) in the free tangents, and where each slot's columns start.

    bases: natural-from-free of each slot, None for the identity: H <- B^T H B, g <- B^T g.
    """
    if all(basis is None for basis in bases):
        return blocks.H, blocks.g, np.array((0, *blocks.ends[:-1]), dtype=np.int64)
    turned = _columns_in_free(blocks.H, blocks.pieces, bases)
    H = np.ascontiguousarray(_columns_in_free(np.swapaxes(turned, -1, -2), blocks.pieces, bases))
    g = np.ascontiguousarray(_columns_in_free(blocks.g[:, None, :], blocks.pieces, bases)[:, 0])
    widths = [piece.stop - piece.start if b is None else b.shape[2] for piece, b in zip(blocks.pieces, bases)]
    return H, g, np.cumsum([0, *widths[:-1]], dtype=np.int64)


def _columns_in_free(M: Array, pieces: Sequence[slice], bases: Sequence[Array | None]) -> Array:
    """M (m, rows, natural) times the bases."""
    out = []
    for columns, basis in zip(pieces, bases):
        part = M[:, :, columns]
        if basis is not None:
            picked = _selected(basis)
            part = part @ basis if picked is None else part[:, :, picked]
        out.append(part)
    return np.concatenate(out, axis=2)


def _selected(basis: Array) -> Indices | None:
    """The components that a large basis (1, p, f) picks, when it does only that: held ones of a vector of hundreds.

    Products with such a matrix take longer than all the rest; small ones are faster than the look.
    """
    if basis.shape[0] != 1 or basis.shape[1] <= LARGE_BASIS or np.count_nonzero(basis) != basis.shape[2]:
        return None
    rows = np.argmax(basis[0], axis=0)
    return rows if np.all(basis[0, rows, np.arange(len(rows))] == 1.0) else None


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
    singular = linear_kernels.eliminate(V, W, v, damping, PIVOT_TOLERANCE, L, Y, z, weak)
    return Elimination(L, Y, z, weak, singular)


def reduce_shared(equations: NormalEquations, parts: Sequence[Elimination]) -> tuple[Array, Array]:
    """S_0 - sum Y^T Y and s - sum Y^T z."""
    S, s = equations.S.copy(), equations.s.copy()
    if len(s):
        for part in parts:
            Y = part.Y.reshape(-1, len(s))
            S -= Y.T @ Y
            s -= Y.T @ part.z.reshape(-1)
    return S, s


def solve(equations: NormalEquations, damping: float) -> Step | None:
    """One damped step, (H + damping diag H) d = -g. None when the matrix is not positive definite: damp more."""
    from calibrant.optimize import linear_kernels

    parts = [eliminate(V, W, v, damping) for V, W, v in zip(equations.V, equations.W, equations.v)]
    if any(part.singular for part in parts):
        return None
    S, s = reduce_shared(equations, parts)
    shared = np.zeros(len(s))
    predicted = linear_kernels.solve_shared(S, s, equations.S, equations.s, damping, PIVOT_TOLERANCE, shared)
    if isnan(predicted):
        return None
    components = []
    for part, V, v in zip(parts, equations.V, equations.v):
        d = np.empty_like(v)
        predicted += linear_kernels.substitute(part.L, part.Y, part.z, shared, V, v, damping, d)
        components.append(d)
    return Step(tuple(components), shared, predicted)
