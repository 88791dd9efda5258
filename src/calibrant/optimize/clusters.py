"""Covariance of an estimate whose residuals err alike in clusters: the points of a view, a board point in all views.

Least squares takes residuals as independent; then the covariance C of the unknowns asked for is what `Solution` states.
With phi_i = C_x,all J_i^T w_i, the influence of residual i on them, their error is -sum_i phi_i w_i r_i, and the
residuals of one cluster g add up to one draw

    z_g = C^-1/2 sum_(i in g) phi_i w_i r_i,     G_g = C^-1/2 sum phi_i phi_i^T C^-1/2,     sum_g G_g = I,

in the metric where C is the unit matrix. Independent residuals give z_g the covariance G_g - G_g^2 (the fit has taken
what it could), so that (I - G_g)^-1/2 z_g has G_g (Bell and McCaffrey 2002, "Bias reduction in standard errors for
linear regression with multi-stage samples", CR2) and their sum of squares S = sum z z^T is I on average.

S of n clusters in p dimensions is a poor estimate by itself: as many clusters as a calibration has views make its
small eigenvalues far too small. It is drawn towards what it would be if the clusters shared the simplest of errors.
Errors that points share are smooth across them, and smooth errors are a shift and a linear map to first order. With
the patterns P_i (d, 3 d) of both at residual i, of the places x_i from their mean in units of their spread,

    B_g = C^-1/2 sum_(i in g) phi_i [I, x_i I, y_i I],   T = I + t B,   B = sum_g B_g B_g^T,   t = (tr S - p) / tr B

(t = 0 where tr S is below p). Such errors fall where the data are otherwise best, as the ratio of focal lengths: a
multiple of I, towards which S was drawn, would spread them over all directions. In the metric of T, that is with
T^-1/2 z_g for z_g, S is drawn to a multiple of I as far as its own scatter asks for (Ledoit and Wolf 2004, "A
well-conditioned estimator for large-dimensional covariance matrices", Lemma 3.1 to 3.4):

    S* = (1 - l) S + l k I,    k = tr S / p,    l = min(1, sum_g |z_g z_g^T - S / n|^2 n / (n - 1) / |S - k I|^2).

What S* has above I is what the clusters share. It is added for each way of clustering; nothing is taken away, since
residuals that seem to cancel within a cluster do so by chance. S* is itself uncertain: what it adds is multiplied by
(t / 1.96)^2, t the 97.5 % point of Student's distribution, so that 1.96 sigma hold 95 % with few clusters too. Clusters
are as few as those that make up S: independent z_g give it the mean square scatter sum_g tr G_g^2 + (tr G_g)^2, that
of p (p + 1) / (this sum) equal ones (Bell and McCaffrey's degrees of freedom, for all directions at once), n - 1 at
most.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calibrant.arrays import Array, Indices
from calibrant.errors import InputError
from calibrant.optimize.chances import NORMAL_95, t_interval
from calibrant.optimize.factors import Factor
from calibrant.optimize.solution import Solution
from calibrant.optimize.structure import SHARED

LEAST_CLUSTERS = 3
"""Two clusters are one difference: it says nothing of directions."""
_NO_INFORMATION = 1e-9
"""Relative eigenvalue of a covariance below which a direction is held: rounding, not knowledge."""
_OWN = 1e-6
"""A direction that a cluster determines to all but this share by itself leaves no residual there to learn from."""
_MANY = 10
"""Labels this many times above their number are rather sorted than listed."""


@dataclass(frozen=True, eq=False)
class Clusters:
    """Scores (n, p) of n clusters, corrected for what the fit took, where C = R R^T is I; root (k, p): R.

    freedom: of as many equal clusters the scores scatter as much; alike (p, p): sum B_g B_g^T of a shift and a linear
    map of each cluster, None where nothing is known of what is shared.
    """

    scores: Array
    root: Array
    freedom: float = np.inf
    alike: Array | None = None

    @cached_property
    def shared(self) -> Array:
        """What the clusters share, (p, p), in the metric where C is I; zero where they show nothing beyond chance."""
        n, p = self.scores.shape
        if n < LEAST_CLUSTERS or p == 0:
            return np.zeros((p, p))
        root, inverse = self._towards()
        scores = self.scores @ inverse
        S = scores.T @ scores
        k = float(np.trace(S)) / p
        away = float(np.sum((S - k * np.eye(p)) ** 2))
        lengths = np.sum(scores**2, axis=1)
        # sum |z z^T - S / n|^2 = sum |z|^4 - |S|^2 / n.
        scatter = (float(np.sum(lengths**2)) - float(np.sum(S * S)) / n) * n / (n - 1)
        drawn = min(1.0, scatter / away) if away > 0 else 1.0
        values, axes = np.linalg.eigh(root @ ((1 - drawn) * S + drawn * k * np.eye(p)) @ root)
        few = (t_interval(max(min(self.freedom, n - 1), LEAST_CLUSTERS - 1)) / NORMAL_95) ** 2
        return np.asarray(few * (axes * np.maximum(values - 1, 0)) @ axes.T)

    def _towards(self) -> tuple[Array, Array]:
        """T^1/2 and T^-1/2 (p, p), symmetric."""
        p = self.scores.shape[1]
        more, size = float(np.sum(self.scores**2)) - p, 0.0 if self.alike is None else float(np.trace(self.alike))
        if self.alike is None or more <= 0 or size <= 0:
            return np.eye(p), np.eye(p)
        values, axes = np.linalg.eigh(np.eye(p) + more / size * self.alike)
        return (axes * np.sqrt(values)) @ axes.T, (axes / np.sqrt(values)) @ axes.T


def clustered_covariance(covariance: Array, clusterings: Sequence[Clusters]) -> Array:
    """C (k, k) with what the residuals of each clustering share. Args: covariance, C as all of them were made with."""
    out = np.array(covariance)
    for clusters in clusterings:
        out += clusters.root @ clusters.shared @ clusters.root.T
    return out


def square_root(covariance: Array) -> tuple[Array, Array]:
    """R (k, p) with C = R R^T, and its left inverse (p, k): p directions that are free, whatever their units."""
    scale = np.sqrt(np.diag(covariance))
    unit = np.where(scale > 0, scale, 1.0)
    values, axes = np.linalg.eigh(covariance / unit[:, None] / unit)
    free = values > _NO_INFORMATION * max(float(values.max(initial=0.0)), np.finfo(float).tiny)
    root = np.sqrt(values[free])
    return scale[:, None] * axes[:, free] * root, (axes[:, free] / root).T / unit


def numbered(labels: Indices) -> Indices:
    """Labels (N,) counted from 0 without gaps."""
    if labels.min() < 0 or labels.max() > _MANY * len(labels):
        return np.asarray(np.unique(labels, return_inverse=True)[1])
    present = np.zeros(labels.max() + 1, dtype=np.int64)  # without the sorting that takes most of the time
    present[labels] = 1
    return (np.cumsum(present) - 1)[labels]


def cluster_scores(rows: Array, residuals: Array, labels: Indices, *, root: Array, at: Array | None = None) -> Clusters:
    """Scores of the clusters that labels name.

    Args: rows (N, d, p), C^-1/2 phi of every residual block; residuals (N, d), in units of their sigma; labels (N,),
    the cluster of each block, counted from 0; root: as `square_root` gives it; at (N, 2): where the blocks are, over
    which what clusters share is smooth, None where they are nowhere.
    """
    from calibrant.optimize import cluster_kernels

    n, p = int(labels.max()) + 1, rows.shape[2]
    sums, G = np.zeros((n, p)), np.zeros((n, p, p))
    cluster_kernels.add_rows(rows, residuals, labels, sums, G)
    return corrected(sums, G, root=root, alike=None if at is None else alike_by_place(rows, labels, at, n))


def alike_by_place(rows: Array, labels: Indices, at: Array, n: int) -> Array:
    """sum B_g B_g^T (p, p) of rows (N, d, p) at these places (N, 2): see the top of the module."""
    from calibrant.optimize import cluster_kernels

    B = np.zeros((n, 3 * rows.shape[1], rows.shape[2]))
    cluster_kernels.add_patterns(rows, np.ascontiguousarray(at), labels, B)
    flat = B.reshape(-1, rows.shape[2])
    return np.asarray(flat.T @ flat)


def corrected(sums: Array, G: Array, *, root: Array, alike: Array | None = None) -> Clusters:
    """Clusters of the scores z_g (n, p) and G_g (n, p, p): see the top of the module."""
    from calibrant.optimize import cluster_kernels

    n, p = sums.shape
    scores, large = np.empty((n, p)), np.zeros(n, dtype=np.bool_)
    cluster_kernels.corrected(sums, G, np.empty((2, p)), scores, large)
    if large.any():
        values, axes = np.linalg.eigh(np.eye(p) - G[large])
        known = values > _OWN
        spread = np.where(known, 1 / np.sqrt(np.where(known, values, 1.0)), 0.0)
        turned = (sums[large][:, None, :] @ axes)[:, 0] * spread
        scores[large] = (axes @ turned[:, :, None])[:, :, 0]
    scatter = float(np.sum(G * G) + np.sum(np.einsum("gii->g", G) ** 2))
    freedom = p * (p + 1) / scatter if scatter > 0 else np.inf
    return Clusters(scores, root, freedom, alike)


def influence(
    solution: Solution, factor: str, name: str, index: int = 0, *, onto: Array | None = None
) -> tuple[Array, Array]:
    """phi (N, d, k) of every residual block of a factor on one shared unknown, and its residuals (N, d), both whitened.

    A change e of the whitened residuals moves the unknown by -phi^T e: by the blocks of C that tie it to the factor's
    slots. Args: onto (p, k), by which phi^T is multiplied from the left.
    Raises: InputError for an unknown that is held or was eliminated, or that the factor's slots have no tie to.
    """
    return _influence(solution, factor, *_columns(solution, name, index), onto)


def influence_on_all(solution: Solution, factor: str) -> Array:
    """phi (N, d, s) of every residual block of a factor on all shared unknowns, free tangents, whitened."""
    s = len(solution.shared_covariance)
    return _influence(solution, factor, np.arange(s), np.eye(s), None)[0]


def edge_sums(solution: Solution, factor: str, asked: Sequence[tuple[str, Array]]) -> list[tuple[Array, Array]]:
    """sum phi w r (m, p) and sum phi phi^T (m, p, p) over the residuals of every edge of a factor, by unknown.

    What `influence` says of every residual, summed: an edge's J^T r and J^T J hold it, which one pass gives to all
    unknowns. Args: asked, each shared unknown with what its phi^T is multiplied by from the left, (p, k).
    Raises: InputError as `influence` does.
    """
    problem = solution.problem
    k = problem.factor_index(factor)
    f = problem.factors[k]
    blocks = f.blocks(problem.gather(k, solution.values), sigma=problem.sigma(f, solution.sigmas))
    sums = []
    for name, onto in asked:
        across = _across_slots(solution, f, *_columns(solution, name, 0), onto)
        p = next(len(C[0]) for C in across if C is not None)
        M = np.zeros((f.edges, p, blocks.g.shape[1]))
        for columns, C in zip(blocks.pieces, across, strict=True):
            if C is not None:
                M[:, :, columns] = C
        sums.append(((M @ blocks.g[:, :, None])[:, :, 0], M @ blocks.H @ np.swapaxes(M, 1, 2)))
    return sums


def _influence(solution: Solution, factor: str, mine: Indices, B: Array, onto: Array | None) -> tuple[Array, Array]:
    problem = solution.problem
    k = problem.factor_index(factor)
    f, values = problem.factors[k], problem.gather(k, solution.values)
    weight = f.weight / problem.sigma(f, solution.sigmas)
    if not f.loss.is_plain:
        weight = weight * np.sqrt(solution.weights(factor))
    return f.influence(_across_slots(solution, f, mine, B, onto), values, weight=weight)


def _across_slots(solution: Solution, f: Factor, mine: Indices, B: Array, onto: Array | None) -> list[Array | None]:
    """Covariance (m or 1, p, k) of an unknown with every slot of a factor, edge by edge, times `onto`; None for held
    slots."""
    across: list[Array | None] = []
    for slot, instances in zip(f.variables, f.indices):
        C = _across(solution, mine, B, slot)
        if C is not None:
            C = C[instances] if len(C) > 1 else C
            C = C if onto is None else onto @ C
        across.append(C)
    if all(C is None for C in across):
        raise InputError(f"all that factor {f.name!r} depends on is held: its residuals move nothing")
    return across


def _columns(solution: Solution, name: str, index: int) -> tuple[Indices, Array]:
    """Columns of one shared unknown in the dense part, and its basis (k, dim)."""
    i = solution.problem.variable_index(name)
    p = solution.problem.structure.placements[i]
    if p is None or p.batch[index] != SHARED:
        raise InputError(f"{name!r} is no shared unknown of this problem: residuals have no influence that can be told")
    basis = solution.problem.variables[i].manifold.basis(solution.values[i])
    columns = p.offset[index] + np.arange(p.dim)
    return columns, np.eye(p.dim) if basis is None else basis[min(index, len(basis) - 1)]


def _across(solution: Solution, mine: Indices, B: Array, slot: str) -> Array | None:
    """Covariance (count, k, k_slot) of an unknown, by its columns and its basis B, with every instance of a slot's
    variable; None for held ones."""
    i = solution.problem.variable_index(slot)
    variable, p = solution.problem.variables[i], solution.problem.structure.placements[i]
    if p is None:
        return None
    columns = p.offset[:, None] + np.arange(p.dim)
    out = np.empty((variable.count, len(mine), p.dim))
    for batch in np.unique(p.batch).tolist():
        here = p.batch == batch
        if batch == SHARED:
            out[here] = np.moveaxis(solution.shared_covariance[mine[:, None, None], columns[here]], 0, 1)
        else:
            cross = solution.blocks.cross[batch][:, :, mine]
            out[here] = np.swapaxes(cross[p.row[here][:, None], columns[here]], 1, 2)
    basis = variable.manifold.basis(solution.values[i])
    return B @ (out if basis is None else out @ np.swapaxes(basis, -1, -2))
