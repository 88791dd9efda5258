"""Which unknowns to eliminate, and where every block of the normal equations goes.

The unknowns split into *shared* ones, solved densely, and *eliminated* ones. Eliminated instances that share a factor
form a component; components do not touch each other, so with V_c the component's own block, W_c its coupling to the
shared unknowns and S_0 the shared block,

    [V_1         W_1] [d_1]   [-g_1]
    [     V_2    W_2] [d_2] = [-g_2]     S = S_0 - sum_c W_c^T V_c^-1 W_c
    [W_1^T W_2^T S_0] [d_s]   [-g_s]

costs O(sum_c b_c^3 + b_c s^2): linear in the number of components (views, robot poses, target points).

Three tiers: this module runs once a problem (index maps), `linear.assemble` once a linearisation (sums), and
`linear.solve` once a step.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Indices
from calibrant.optimize.factors import Factor
from calibrant.optimize.manifolds import Variable

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
class Structure:
    """Index maps of a problem. batches: (component size, number of components); shared: dense dimension.

    picks: for each factor and slot the instance of every edge, None where edge i uses instance i.
    places: for each factor (edges, slots, 5), where the columns of an edge's slot go: the size of their component (0
    for the shared part), where the component starts in the flat arrays of V, W and v, and their first column in it.
    dims: for each factor the free dimension of every slot, 0 for a constant.
    """

    placements: tuple[Placement | None, ...]
    batches: tuple[tuple[int, int], ...]
    shared: int
    slots: tuple[tuple[int, ...], ...]
    picks: tuple[tuple[Indices | None, ...], ...]
    places: tuple[Indices, ...]
    dims: tuple[Indices, ...]


def analyse(variables: Sequence[Variable], factors: Sequence[Factor]) -> Structure:
    """Choose what to eliminate and build the index maps. Deterministic: depends on the problem's shape alone."""
    index = {v.name: i for i, v in enumerate(variables)}
    slots = tuple(tuple(index[name] for name in f.variables) for f in factors)
    eliminated = _choose_eliminated(variables, factors, slots)
    placements, batches, shared = _place_batch(variables, factors, slots, eliminated)
    picks = tuple(
        tuple(None if _in_order(i, variables[v].count) else i for v, i in zip(slot, factor.indices))
        for factor, slot in zip(factors, slots)
    )
    maps = [None if p is None else _batch_columns(p, batches, shared) for p in placements]
    places, dims = [], []
    for factor, slot in zip(factors, slots):
        into = np.zeros((factor.edges, len(slot), 5), dtype=np.int64)
        for k, (v, i) in enumerate(zip(slot, factor.indices)):
            where = maps[v]
            if where is not None:
                into[:, k] = where[i]
        places.append(into)
        dims.append(np.array([0 if maps[v] is None else variables[v].free_dim for v in slot], dtype=np.int64))
    return Structure(placements, batches, shared, slots, picks, tuple(places), tuple(dims))


def _batch_columns(p: Placement, batches: Sequence[tuple[int, int]], shared: int) -> Indices:
    """Entries of `Structure.places` (count, 5) of a variable's instances."""
    out = np.zeros((len(p.offset), 5), dtype=np.int64)
    out[:, 4] = p.offset
    if p.together == SHARED:
        return out
    sizes, counts = np.array(batches, dtype=np.int64).T
    size = sizes[p.batch]
    out[:, 0] = size
    for column, stride in ((1, sizes * sizes), (2, sizes * shared), (3, sizes)):
        starts = np.cumsum(counts * stride) - counts * stride
        out[:, column] = starts[p.batch] + p.row * stride[p.batch]
    return out


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
        sizes += variables[v].free_dim * np.bincount(labels, minlength=n)
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


def _place_batch(
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
        sizes += dim * np.bincount(labels, minlength=n)
    distinct = sorted(set(sizes.tolist()))
    batch_of = np.searchsorted(distinct, sizes)
    row_of = np.zeros(n, dtype=np.int64)
    for b in range(len(distinct)):
        row_of[batch_of == b] = np.arange(np.sum(batch_of == b))
    batches = tuple((size, int(np.sum(batch_of == b))) for b, size in enumerate(distinct))
    placements: list[Placement | None] = []
    starts, shared = _shared_starts(variables, eliminated)
    for i, variable in enumerate(variables):
        if not variable.free_dim:
            placements.append(None)
        elif i in eliminated:
            labels = components[i]
            placements.append(
                _eliminated(batch_of[labels].astype(np.int64), row_of[labels], offsets[i], variable, batches)
            )
        else:
            placements.append(
                Placement(
                    np.full(variable.count, SHARED),
                    np.zeros(variable.count, dtype=np.int64),
                    starts[i] + variable.free_dim * np.arange(variable.count),
                    variable.free_dim,
                    SHARED,
                )
            )
    return tuple(placements), batches, shared


def _shared_starts(variables: Sequence[Variable], eliminated: set[int]) -> tuple[dict[int, int], int]:
    """First column of every variable of the dense part, and its dimension. One that shares components with another
    follows it, and begins in its last columns."""
    dense = [i for i, v in enumerate(variables) if v.free_dim and i not in eliminated]
    followers = {v.shares[0]: i for i, v in enumerate(variables) if v.shares is not None and i in dense}
    starts: dict[int, int] = {}
    end = 0
    for i in dense:
        k: int | None = i
        while k is not None and k not in starts:
            v = variables[k]
            if v.shares is not None and k == i:
                break  # it comes with the one that it follows
            starts[k] = end - (0 if v.shares is None else v.shares[1])
            end = starts[k] + v.count * v.free_dim
            k = followers.get(v.name)
    return starts, end


def _eliminated(
    batch: Indices, row: Indices, offset: Indices, variable: Variable, batches: Sequence[tuple[int, int]]
) -> Placement:
    # Another variable's instances may share the batch: the variable fills it only when it has as many components.
    filled = batches[batch[0]] == (variable.free_dim, len(row)) and bool(np.all(batch == batch[0]))
    whole = filled and _in_order(row, len(row))
    return Placement(batch, row, offset, variable.free_dim, int(batch[0]) if whole else None)
