"""Which unknowns to eliminate, and where every block of the normal equations goes.

The unknowns split into *shared* ones, solved densely, and *eliminated* ones. Eliminated instances that share a factor
form a component; components do not touch each other, so with V_c the component's own block, W_c its coupling to the
shared unknowns and S_0 the shared block,

    [V_1         W_1] [d_1]   [-g_1]
    [     V_2    W_2] [d_2] = [-g_2]     S = S_0 - sum_c W_c^T V_c^-1 W_c
    [W_1^T W_2^T S_0] [d_s]   [-g_s]

costs O(sum_c b_c^3 + b_c s^2): linear in the number of components (views, robot poses, target points).

Three tiers: this module runs once a problem (index maps), `linear.assemble` once a linearisation (scatter), and
`linear.solve` once a step.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from calibrant.optimize.factors import Factor
from calibrant.optimize.manifolds import Variable

Indices = NDArray[np.int64]

SHARED = -1


@dataclass(frozen=True, eq=False)
class Placement:
    """Where each instance of a variable sits: batch (SHARED for the dense part), row in the batch, first column."""

    batch: Indices
    row: Indices
    offset: Indices
    dim: int


@dataclass(frozen=True, eq=False)
class Scatter:
    """Adds edge blocks into one flat array: flat[target] += blocks[edges] (transposed when asked)."""

    destination: str
    batch: int
    slots: tuple[int, int]
    transpose: bool
    edges: Indices | None
    target: Indices
    sum_order: Indices | None
    sum_starts: Indices | None


@dataclass(frozen=True, eq=False)
class Structure:
    """Index maps of a problem. batches: (component size, number of components); shared: dense dimension."""

    placements: tuple[Placement | None, ...]
    batches: tuple[tuple[int, int], ...]
    shared: int
    slots: tuple[tuple[int, ...], ...]
    scatters: tuple[tuple[Scatter, ...], ...]
    gradient_scatters: tuple[tuple[Scatter, ...], ...]


def analyse(variables: Sequence[Variable], factors: Sequence[Factor]) -> Structure:
    """Choose what to eliminate and build the index maps. Deterministic: depends on the problem's shape alone."""
    index = {v.name: i for i, v in enumerate(variables)}
    slots = tuple(tuple(index[name] for name in f.variables) for f in factors)
    eliminated = _choose_eliminated(variables, factors, slots)
    placements, batches, shared = _place(variables, factors, slots, eliminated)
    scatters, gradients = [], []
    for factor, slot in zip(factors, slots):
        scatters.append(tuple(_matrix_scatters(factor, slot, placements, batches, shared)))
        gradients.append(tuple(_gradient_scatters(factor, slot, placements, batches)))
    return Structure(placements, batches, shared, slots, tuple(scatters), tuple(gradients))


def _components(
    variables: Sequence[Variable], factors: Sequence[Factor], slots: Sequence[tuple[int, ...]], eliminated: set[int]
) -> tuple[dict[int, Indices], int]:
    """Component of every instance of the eliminated variables, and how many components there are."""
    starts, total = {}, 0
    for v in sorted(eliminated):
        starts[v], total = total, total + variables[v].count
    rows: list[Indices] = []
    columns: list[Indices] = []
    for factor, slot in zip(factors, slots):
        members = [starts[v] + factor.indices[k] for k, v in enumerate(slot) if v in eliminated]
        for other in members[1:]:
            rows.append(members[0])
            columns.append(other)
    if not rows:
        labels, n = np.arange(total), total
    else:
        i, j = np.concatenate(rows), np.concatenate(columns)
        n, labels = connected_components(coo_array((np.ones(len(i)), (i, j)), shape=(total, total)), directed=False)
    return {v: np.asarray(labels[starts[v] : starts[v] + variables[v].count], dtype=np.int64) for v in eliminated}, int(
        n
    )


def _cost(variables: Sequence[Variable], components: dict[int, Indices], n: int) -> float:
    """Multiplications of one step with this elimination; dense Cholesky is d^3 / 3."""
    sizes = np.zeros(n)
    for v, labels in components.items():
        np.add.at(sizes, labels, variables[v].free_dim)
    shared = sum(v.count * v.free_dim for i, v in enumerate(variables) if i not in components)
    return float(np.sum(sizes**3 / 3 + sizes**2 * shared + sizes * shared**2) + shared**3 / 3)


def _choose_eliminated(
    variables: Sequence[Variable], factors: Sequence[Factor], slots: Sequence[tuple[int, ...]]
) -> set[int]:
    """Greedy: take the largest variables first, keep each whose elimination lowers the cost of a step."""
    solved = [i for i, v in enumerate(variables) if v.free_dim]
    chosen: set[int] = set()
    best = _cost(variables, {}, 0)
    for v in sorted(solved, key=lambda i: -variables[i].count * variables[i].free_dim):
        if variables[v].count < 2:
            continue  # a single instance gains nothing from elimination and would make the dense part empty
        trial = chosen | {v}
        components, n = _components(variables, factors, slots, trial)
        cost = _cost(variables, components, n)
        if cost < best:
            chosen, best = trial, cost
    return chosen


def _place(
    variables: Sequence[Variable], factors: Sequence[Factor], slots: Sequence[tuple[int, ...]], eliminated: set[int]
) -> tuple[tuple[Placement | None, ...], tuple[tuple[int, int], ...], int]:
    components, n = _components(variables, factors, slots, eliminated)
    sizes = np.zeros(n, dtype=np.int64)
    offsets: dict[int, Indices] = {}
    for v in sorted(eliminated):
        labels, dim = components[v], variables[v].free_dim
        # Instances of one variable in one component follow each other in the order of their indices.
        order = np.argsort(labels, kind="stable")
        first = np.searchsorted(labels[order], labels[order], side="left")
        rank = np.empty(len(labels), dtype=np.int64)
        rank[order] = np.arange(len(labels)) - first
        offsets[v] = sizes[labels] + rank * dim
        np.add.at(sizes, labels, dim)
    distinct = sorted(set(sizes.tolist()))
    batch_of = np.searchsorted(distinct, sizes)
    row_of = np.zeros(n, dtype=np.int64)
    for b in range(len(distinct)):
        row_of[batch_of == b] = np.arange(np.sum(batch_of == b))
    placements: list[Placement | None] = []
    shared = 0
    for i, v in enumerate(variables):
        if not v.free_dim:
            placements.append(None)
        elif i in eliminated:
            labels = components[i]
            placements.append(Placement(batch_of[labels].astype(np.int64), row_of[labels], offsets[i], v.free_dim))
        else:
            columns = shared + v.free_dim * np.arange(v.count)
            shared += v.free_dim * v.count
            placements.append(
                Placement(np.full(v.count, SHARED), np.zeros(v.count, dtype=np.int64), columns, v.free_dim)
            )
    batches = tuple((size, int(np.sum(batch_of == b))) for b, size in enumerate(distinct))
    return tuple(placements), batches, shared


def _scatter(
    destination: str, batch: int, slots: tuple[int, int], transpose: bool, edges: Indices | None, target: Indices
) -> Scatter:
    """Index map of blocks (e, p, q) to flat positions (e, p * q), summing edges that share a position first."""
    flat = target.reshape(len(target), -1)
    keys = flat[:, 0]
    order = np.argsort(keys, kind="stable")
    starts = np.flatnonzero(np.r_[True, np.diff(keys[order]) != 0])
    if len(starts) == len(keys):
        return Scatter(destination, batch, slots, transpose, edges, flat.ravel(), None, None)
    unique = flat[order[starts]].ravel()
    already_sorted = np.array_equal(order, np.arange(len(order)))
    return Scatter(destination, batch, slots, transpose, edges, unique, None if already_sorted else order, starts)


def _positions(p: Placement, q: Placement, i: Indices, j: Indices, *, width: int, height: int) -> Indices:
    """Flat positions (e, dim_p, dim_q) in an array (rows, height, width) of the blocks of instances i and j."""
    row = p.row[i] if p.batch[i[0]] != SHARED else q.row[j]
    down = p.offset[i][:, None, None] + np.arange(p.dim)[:, None]
    across = q.offset[j][:, None, None] + np.arange(q.dim)
    return row[:, None, None] * (height * width) + down * width + across


def _matrix_scatters(
    factor: Factor,
    slot: tuple[int, ...],
    placements: Sequence[Placement | None],
    batches: Sequence[tuple[int, int]],
    shared: int,
) -> list[Scatter]:
    """Maps of every block pair. Only V, S and W (component by shared) are kept; V and S get both triangles."""
    out: list[Scatter] = []
    for a in range(len(slot)):
        for b in range(a, len(slot)):
            p, q = placements[slot[a]], placements[slot[b]]
            if p is None or q is None:
                continue
            i, j = factor.indices[a], factor.indices[b]
            pairs = np.stack([p.batch[i], q.batch[j]], axis=1)
            for pa, pb in np.unique(pairs, axis=0).tolist():
                chosen = np.flatnonzero((pairs[:, 0] == pa) & (pairs[:, 1] == pb))
                edges = None if len(chosen) == len(i) else chosen
                ie, je = i[chosen], j[chosen]
                if pa == SHARED and pb == SHARED:
                    kind, batch, height, width = "S", 0, shared, shared
                elif pa != SHARED and pb != SHARED:
                    kind, batch, height, width = "V", pa, batches[pa][0], batches[pa][0]
                else:
                    kind, batch, width = "W", max(pa, pb), shared
                    height = batches[batch][0]
                if kind != "W" or pa != SHARED:
                    target = _positions(p, q, ie, je, width=width, height=height)
                    out.append(_scatter(kind, batch, (a, b), False, edges, target))
                if (kind == "W" and pa == SHARED) or (kind != "W" and a != b):
                    target = _positions(q, p, je, ie, width=width, height=height)
                    out.append(_scatter(kind, batch, (a, b), True, edges, target))
    return out


def _gradient_scatters(
    factor: Factor, slot: tuple[int, ...], placements: Sequence[Placement | None], batches: Sequence[tuple[int, int]]
) -> list[Scatter]:
    out: list[Scatter] = []
    for a, v in enumerate(slot):
        p = placements[v]
        if p is None:
            continue
        i = factor.indices[a]
        for batch in np.unique(p.batch[i]).tolist():
            chosen = np.flatnonzero(p.batch[i] == batch)
            edges = None if len(chosen) == len(i) else chosen
            ie = i[chosen]
            height = 0 if batch == SHARED else batches[batch][0]
            target = p.row[ie][:, None] * height + p.offset[ie][:, None] + np.arange(p.dim)
            out.append(_scatter("s" if batch == SHARED else "v", max(batch, 0), (a, a), False, edges, target))
    return out
