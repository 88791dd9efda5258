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

from calibrant.optimize.factors import Factor
from calibrant.optimize.manifolds import Variable

Indices = NDArray[np.int64]

SHARED = -1


@dataclass(frozen=True, eq=False)
class Placement:
    """Where each instance of a variable sits: batch (SHARED for the dense part), row in the batch, first column.

    together: the batch (or SHARED) that its instances fill in order, nothing between them; None when they are spread.
    """

    batch: Indices
    row: Indices
    offset: Indices
    dim: int
    together: int | None


@dataclass(frozen=True, eq=False)
class Scatter:
    """Adds edge blocks into one flat array: flat[target] += blocks[edges] (transposed when asked).

    target: positions, or a slice where they follow each other.
    """

    destination: str
    batch: int
    slots: tuple[int, int]
    transpose: bool
    edges: Indices | None
    target: Indices | slice
    sum_order: Indices | None
    sum_starts: Indices | None


@dataclass(frozen=True, eq=False)
class Structure:
    """Index maps of a problem. batches: (component size, number of components); shared: dense dimension.

    picks: for each factor and slot the instance of every edge, None where edge i uses instance i.
    """

    placements: tuple[Placement | None, ...]
    batches: tuple[tuple[int, int], ...]
    shared: int
    slots: tuple[tuple[int, ...], ...]
    picks: tuple[tuple[Indices | None, ...], ...]
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
    picks = tuple(
        tuple(None if _in_order(i, variables[v].count) else i for v, i in zip(slot, factor.indices))
        for factor, slot in zip(factors, slots)
    )
    return Structure(placements, batches, shared, slots, picks, tuple(scatters), tuple(gradients))


def _in_order(index: Indices, count: int) -> bool:
    return len(index) == count and bool(np.array_equal(index, np.arange(count)))


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
    labels: NDArray[np.integer]
    if not rows:
        labels, n = np.arange(total), total
    else:
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

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
    batches = tuple((size, int(np.sum(batch_of == b))) for b, size in enumerate(distinct))
    placements: list[Placement | None] = []
    shared = 0
    for i, variable in enumerate(variables):
        if not variable.free_dim:
            placements.append(None)
        elif i in eliminated:
            labels = components[i]
            placements.append(
                _eliminated(batch_of[labels].astype(np.int64), row_of[labels], offsets[i], variable, batches)
            )
        else:
            columns = shared + variable.free_dim * np.arange(variable.count)
            shared += variable.free_dim * variable.count
            placements.append(
                Placement(
                    np.full(variable.count, SHARED),
                    np.zeros(variable.count, dtype=np.int64),
                    columns,
                    variable.free_dim,
                    SHARED,
                )
            )
    return tuple(placements), batches, shared


def _eliminated(
    batch: Indices, row: Indices, offset: Indices, variable: Variable, batches: Sequence[tuple[int, int]]
) -> Placement:
    # Another variable's instances may share the batch: the variable fills it only when it has as many components.
    filled = batches[batch[0]] == (variable.free_dim, len(row)) and bool(np.all(batch == batch[0]))
    whole = filled and _in_order(row, len(row))
    return Placement(batch, row, offset, variable.free_dim, int(batch[0]) if whole else None)


@dataclass(frozen=True, eq=False)
class _Target:
    """An array (rows, height, width), flat, that edge blocks are added to."""

    destination: str
    batch: int
    height: int
    width: int


def _matrix_scatter(
    into: _Target, slots: tuple[int, int], transpose: bool, edges: Indices | None, p: Placement, q: Placement,
    i: Indices, j: Indices,
) -> Scatter:  # fmt: skip
    """Map of the blocks (e, p.dim, q.dim) of instances i and j."""
    row = p.row[i] if p.batch[i[0]] != SHARED else q.row[j]
    corner = row * (into.height * into.width) + p.offset[i] * into.width + q.offset[j]
    return _scatter(into, slots, transpose, edges, corner, np.arange(p.dim)[:, None] * into.width + np.arange(q.dim))


def _scatter(
    into: _Target, slots: tuple[int, int], transpose: bool, edges: Indices | None, corner: Indices, block: Indices
) -> Scatter:
    """Edge e adds to the positions corner[e] + block; edges that share a corner are summed first."""
    if bool(np.all(corner[1:] > corner[:-1])):
        target = _contiguous((corner[:, None] + block.ravel()).ravel())
        return Scatter(into.destination, into.batch, slots, transpose, edges, target, None, None)
    order = np.argsort(corner, kind="stable")
    ranked = corner[order]
    starts = np.flatnonzero(np.concatenate([[True], ranked[1:] != ranked[:-1]]))
    distinct = len(starts) == len(corner)
    corners = corner if distinct else ranked[starts]
    target = _contiguous((corners[:, None] + block.ravel()).ravel())
    if distinct:
        return Scatter(into.destination, into.batch, slots, transpose, edges, target, None, None)
    sum_order = None if _in_order(order, len(order)) else order
    return Scatter(into.destination, into.batch, slots, transpose, edges, target, sum_order, starts)


def _contiguous(positions: Indices) -> Indices | slice:
    """A slice in place of positions that follow each other: adding to it needs no index."""
    first, n = int(positions[0]), len(positions)
    if int(positions[-1]) - first == n - 1 and bool(np.all(positions[1:] > positions[:-1])):
        return slice(first, first + n)
    return positions


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
            batch_a, batch_b = p.batch[i], q.batch[j]
            for pa, pb in _distinct_pairs(batch_a, batch_b):
                chosen = np.flatnonzero((batch_a == pa) & (batch_b == pb))
                edges = None if len(chosen) == len(i) else chosen
                ie, je = i[chosen], j[chosen]
                into = _target(pa, pb, batches, shared)
                coupling = into.destination == "W"
                if not coupling or pa != SHARED:
                    out.append(_matrix_scatter(into, (a, b), False, edges, p, q, ie, je))
                if (coupling and pa == SHARED) or (not coupling and a != b):
                    out.append(_matrix_scatter(into, (a, b), True, edges, q, p, je, ie))
    return out


def _target(a: int, b: int, batches: Sequence[tuple[int, int]], shared: int) -> _Target:
    """Where the blocks between unknowns of batches a and b go."""
    if a == SHARED and b == SHARED:
        return _Target("S", 0, shared, shared)
    if a != SHARED and b != SHARED:
        return _Target("V", a, batches[a][0], batches[a][0])
    batch = max(a, b)
    return _Target("W", batch, batches[batch][0], shared)


def _distinct_pairs(a: Indices, b: Indices) -> list[tuple[int, int]]:
    """The pairs (a_i, b_i) that occur, sorted."""
    if bool(np.all(a == a[0])) and bool(np.all(b == b[0])):
        return [(int(a[0]), int(b[0]))]
    return sorted(set(zip(a.tolist(), b.tolist())))


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
            into = _Target("s" if batch == SHARED else "v", max(batch, 0), height, 1)
            corner = p.row[ie] * height + p.offset[ie]
            out.append(_scatter(into, (a, a), False, edges, corner, np.arange(p.dim)))
    return out
