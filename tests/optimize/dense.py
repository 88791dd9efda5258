"""Brute force to compare with: the whole Jacobian as one matrix, no elimination, no sparsity."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calibrant.optimize import Problem
from calibrant.optimize.problem import Values

Array = NDArray[np.float64]


def first_columns(problem: Problem) -> list[int]:
    """First column of every variable in the order variables, instances, free components."""
    sizes = [v.count * v.free_dim for v in problem.variables]
    return np.concatenate([[0], np.cumsum(sizes)]).astype(int).tolist()


def system(problem: Problem, values: Values) -> tuple[Array, Array]:
    """Whitened residuals (N,) and Jacobian (N, unknowns) in the free tangents."""
    starts = first_columns(problem)
    names = [v.name for v in problem.variables]
    residuals, rows = [], []
    for k, factor in enumerate(problem.factors):
        r, jacobians = factor.linearize(*problem.gather(k, values))
        offsets = np.arange(factor.edges + 1) if factor.row_offsets is None else factor.row_offsets
        edge = np.repeat(np.arange(factor.edges), np.diff(offsets))
        weight = factor.weight / problem.sigma(factor, problem.sigmas)
        J = np.zeros((len(r), factor.dim, starts[-1]))
        for name, index, block in zip(factor.variables, factor.indices, jacobians):
            v = names.index(name)
            variable, dim = problem.variables[v], problem.variables[v].free_dim
            basis = variable.manifold.basis(values[v])
            instance = index[edge]
            if basis is not None:
                block = block @ basis[instance if len(basis) > 1 else np.zeros(len(r), int)]
            if dim:
                columns = starts[v] + dim * instance[:, None] + np.arange(dim)
                J[np.arange(len(r))[:, None, None], np.arange(factor.dim)[:, None], columns[:, None, :]] += block
        residuals.append((r * weight[:, None]).ravel())
        rows.append((J * weight[:, None, None]).reshape(-1, starts[-1]))
    return np.concatenate(residuals), np.concatenate(rows)


def retract(problem: Problem, values: Values, delta: Array) -> Values:
    """Values moved by one vector of all free tangents."""
    starts = first_columns(problem)
    return tuple(
        value if not v.free_dim else v.manifold.retract(value, delta[a:b].reshape(v.count, v.free_dim))
        for v, value, a, b in zip(problem.variables, values, starts[:-1], starts[1:])
    )
