"""Factors: batches of residuals between variables.

A factor has *edges*. Each edge ties one instance of each of the factor's variables (its slots) and owns one or more
residual blocks of dimension `dim`: a camera view is an edge, its points are the blocks. A new factor is one class with
one method, `linearize`. The solver asks for `blocks`: each edge's J^T W J and J^T W r. The default computes them from
`linearize` with NumPy; a factor may override it with a compiled kernel, whose test the NumPy form stays.
"""

from __future__ import annotations

import copy
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Self

import numpy as np

from calibrant.arrays import Array, Indices
from calibrant.errors import InputError
from calibrant.geometry import so3
from calibrant.optimize.losses import Loss

EXACT = "prior"
"""Noise group of factors whose sigma is given and never estimated."""


@dataclass(frozen=True, eq=False)
class FactorBlocks:
    """Normal equations of a factor, edge by edge, with respect to the natural tangents.

    H (m, K, K), g (m, K): J^T W J and J^T W r of every edge, its slots laid end to end; ends: where each slot's columns
    end.
    """

    cost: float
    H: Array
    g: Array
    ends: tuple[int, ...]

    @property
    def pieces(self) -> tuple[slice, ...]:
        """The columns of each slot."""
        return tuple(slice(first, last) for first, last in pairwise((0, *self.ends)))

    @property
    def gradient(self) -> tuple[Array, ...]:
        """g of each slot a, (m, k_a)."""
        return tuple(self.g[:, rows] for rows in self.pieces)

    @property
    def hessian(self) -> dict[tuple[int, int], Array]:
        """H of each pair of slots a <= b, (m, k_a, k_b)."""
        pieces = self.pieces
        return {
            (a, b): self.H[:, rows, columns]
            for a, rows in enumerate(pieces)
            for b, columns in enumerate(pieces)
            if b >= a
        }

    def scaled(self, factor: float) -> FactorBlocks:
        """The same with every weight multiplied."""
        return FactorBlocks(self.cost * factor, factor * self.H, factor * self.g, self.ends)


class Factor(ABC):
    """A batch of residuals of one kind.

    name: for messages. variables: names of the slots. indices: for each slot, the instance (m,) that each edge uses.
    noise: the noise group that the residuals are in units of; loss: applied to each block's whitened norm. whitening
    (N, dim, dim): by what each block is multiplied beside 1 / relative_sigma, None for blocks alike to all sides.
    """

    def __init__(
        self,
        name: str,
        *,
        variables: Sequence[str],
        indices: Sequence[Indices],
        dim: int,
        noise: str,
        relative_sigma: Array | float = 1.0,
        whitening: Array | None = None,
        row_offsets: Indices | None = None,
        loss: Loss | None = None,
    ) -> None:
        self.name = name
        self.variables = tuple(variables)
        self.indices = tuple(np.asarray(i, dtype=np.int64) for i in indices)
        self.dim = dim
        self.noise = noise
        self.loss = loss if loss is not None else Loss()
        self.edges = len(self.indices[0])
        self.row_offsets = None if row_offsets is None else np.asarray(row_offsets, dtype=np.int64)
        self.blocks_count = self.edges if self.row_offsets is None else int(self.row_offsets[-1])
        sigma = np.broadcast_to(np.asarray(relative_sigma, dtype=np.float64), (self.blocks_count,))
        self._check(sigma)
        self.weight = 1.0 / sigma
        self.whitening = whitening

    def _check(self, sigma: Array) -> None:
        if self.edges == 0 or self.blocks_count == 0:
            raise InputError(f"factor {self.name!r} is empty: it needs at least one edge with one residual")
        if any(len(i) != self.edges for i in self.indices) or len(self.indices) != len(self.variables):
            raise InputError(f"factor {self.name!r}: every slot needs one index an edge ({self.edges} edges)")
        if not np.all(np.isfinite(sigma) & (sigma > 0)):
            raise InputError(f"factor {self.name!r}: every relative sigma must be finite and above 0")
        if self.row_offsets is not None and np.any(np.diff(self.row_offsets) < 1):
            raise InputError(f"factor {self.name!r}: an edge has no residuals; leave it out")

    def with_loss(self, loss: Loss) -> Self:
        """The same factor with another loss."""
        other = copy.copy(self)
        other.loss = loss
        return other

    @property
    def residual_count(self) -> int:
        """Number of scalar residuals."""
        return self.blocks_count * self.dim

    @abstractmethod
    def linearize(self, *values: Array) -> tuple[Array, tuple[Array, ...]]:
        """Residuals r (N, dim), unweighted, and d r / d natural tangent of each slot, (N, dim, k).

        values: for each slot the values (m, …) of its edges' instances. Rows are ordered by edge.
        """

    def residuals(self, *values: Array) -> Array:
        """Residuals (N, dim), unweighted: predicted minus observed."""
        return self.linearize(*values)[0]

    def blocks(self, values: Sequence[Array], *, sigma: float) -> FactorBlocks:
        """Normal equations with weights 1 / (sigma * relative_sigma) and the loss. values: one array a slot, (m, …)."""
        r, jacobians = self._whitened(*self.linearize(*values))
        w, cost = self._weights(r, sigma)
        root = np.sqrt(w)[:, None]
        J = np.concatenate(jacobians, axis=2) * root[:, :, None]
        J_t = np.swapaxes(J, 1, 2)
        # One product for all slots.
        H, g = self._sum(J_t @ J), self._sum((J_t @ (root * r)[:, :, None])[:, :, 0])
        return FactorBlocks(cost, H, g, tuple(np.cumsum([j.shape[2] for j in jacobians]).tolist()))

    def influence(
        self, across: Sequence[Array | None], values: Sequence[Array], *, weight: Array
    ) -> tuple[Array, Array]:
        """weight J across^T summed over the slots, (N, dim, p), and the weighted residuals, (N, dim), of every block.

        Args: across, (m or 1, p, k) for each slot and its edges, None where the slot is held; weight (N,).
        """
        r, jacobians = self._whitened(*self.linearize(*values))
        counts = 1 if self.row_offsets is None else np.diff(self.row_offsets)
        edge = np.repeat(np.arange(self.edges), counts)
        out = np.zeros((*r.shape, next(a.shape[1] for a in across if a is not None)))
        for J, a in zip(jacobians, across):
            if a is not None:
                out += np.einsum("nij,nkj->nik", J, a[edge] if len(a) > 1 else a)
        return weight[:, None, None] * out, weight[:, None] * r

    def whitened_norms(self, values: Sequence[Array], *, sigma: float) -> Array:
        """Norm (N,) of every residual block in units of its sigma."""
        r, _ = self._whitened(self.residuals(*values), ())
        return np.linalg.norm(r, axis=-1) * self.weight / sigma

    def _whitened(self, r: Array, jacobians: tuple[Array, ...]) -> tuple[Array, tuple[Array, ...]]:
        """Residuals (N, dim) and their slopes, turned by the blocks' whitening where they have one."""
        if self.whitening is None:
            return r, jacobians
        return (self.whitening @ r[:, :, None])[:, :, 0], tuple(self.whitening @ J for J in jacobians)

    def _weights(self, r: Array, sigma: float) -> tuple[Array, float]:
        scale = (self.weight / sigma) ** 2
        with np.errstate(invalid="ignore"):
            rho, slope = self.loss.evaluate(np.sum(r * r, axis=-1) * scale)
        return slope * scale, 0.5 * float(rho.sum())

    def _sum(self, rows: Array) -> Array:
        return rows if self.row_offsets is None else np.add.reduceat(rows, self.row_offsets[:-1], axis=0)


class VectorPrior(Factor):
    """A vector is `mean` within `sigma`, component by component: r = (x - mean) / sigma (noise group "prior")."""

    def __init__(self, name: str, variable: str, index: int, mean: Array, *, sqrt_information: Array) -> None:
        """sqrt_information (d, k): r = sqrt_information (x - mean); its square is the prior's inverse covariance."""
        self.mean = np.asarray(mean, dtype=np.float64)
        self.sqrt_information = np.asarray(sqrt_information, dtype=np.float64)
        super().__init__(
            name,
            variables=(variable,),
            indices=(np.array([index]),),
            dim=len(self.sqrt_information),
            noise=EXACT,
        )

    def linearize(self, *values: Array) -> tuple[Array, tuple[Array, ...]]:
        (x,) = values
        return (x - self.mean) @ self.sqrt_information.T, (
            np.broadcast_to(self.sqrt_information, (1, *self.sqrt_information.shape)),
        )


class RotationPrior(Factor):
    """Measured rotations: r = log(R R_measured^T), radians, along the parent's axes."""

    def __init__(
        self, name: str, variable: str, measured: Array, *, noise: str, indices: Indices | None = None
    ) -> None:
        self.measured = np.asarray(measured, dtype=np.float64)[:, :3, :3]
        index = np.arange(len(self.measured)) if indices is None else indices
        super().__init__(name, variables=(variable,), indices=(index,), dim=3, noise=noise)

    def linearize(self, *values: Array) -> tuple[Array, tuple[Array, ...]]:
        (T,) = values
        r = so3.log(T[:, :3, :3] @ np.swapaxes(self.measured, -1, -2))
        J = np.zeros((len(r), 3, 6))
        J[:, :, :3] = so3.left_jacobian_inverse(r)
        return r, (J,)


class TranslationPrior(Factor):
    """Measured positions: r = t - t_measured, metres, along the parent's axes."""

    def __init__(
        self, name: str, variable: str, measured: Array, *, noise: str, indices: Indices | None = None
    ) -> None:
        self.measured = np.asarray(measured, dtype=np.float64)[:, :3, 3]
        index = np.arange(len(self.measured)) if indices is None else indices
        super().__init__(name, variables=(variable,), indices=(index,), dim=3, noise=noise)

    def linearize(self, *values: Array) -> tuple[Array, tuple[Array, ...]]:
        (T,) = values
        J = np.zeros((len(T), 3, 6))
        J[:, :, 3:] = np.eye(3)
        return T[:, :3, 3] - self.measured, (J,)
