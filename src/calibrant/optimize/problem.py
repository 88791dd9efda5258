"""A least-squares problem: variables, factors, and the noise levels that the factors' residuals are in units of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.optimize import linear
from calibrant.optimize.factors import EXACT, Factor
from calibrant.optimize.linear import NormalEquations, Step
from calibrant.optimize.losses import Loss
from calibrant.optimize.manifolds import Variable
from calibrant.optimize.structure import SHARED, Placement, Structure, analyse

Values = tuple[Array, ...]
"""Values of all variables, in the problem's order."""


@dataclass(frozen=True, eq=False)
class Problem:
    """Minimise 1/2 sum rho(|r / sigma|^2) over the variables that are not constant.

    sigmas: standard deviation of each noise group, in the residuals' unit; groups not named have 1.
    Raises: InputError for unknown or repeated names, indices out of range, a variable that no factor touches.
    """

    variables: tuple[Variable, ...]
    factors: tuple[Factor, ...]
    sigmas: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "variables", tuple(self.variables))
        object.__setattr__(self, "factors", tuple(self.factors))
        names = [v.name for v in self.variables]
        if len(set(names)) < len(names):
            raise InputError(f"variable names must differ, got {', '.join(names)}")
        if not self.factors:
            raise InputError("a problem needs at least one factor")
        touched: set[str] = set()
        for factor in self.factors:
            for name, indices in zip(factor.variables, factor.indices):
                if name not in names:
                    raise InputError(f"factor {factor.name!r} uses variable {name!r}; there are: {', '.join(names)}")
                count = self.variables[names.index(name)].count
                if indices.min() < 0 or indices.max() >= count:
                    raise InputError(
                        f"factor {factor.name!r} uses instance {indices.max()} of {name!r}, which has {count}"
                    )
                touched.add(name)
        idle = [v.name for v in self.variables if v.free_dim and v.name not in touched]
        if idle:
            raise InputError(f"no factor touches the variable {idle[0]!r}; leave it out or make it constant")
        self._check_shares()
        bad = {k: s for k, s in self.sigmas.items() if not (np.isfinite(s) and s > 0)}
        if bad:
            raise InputError(f"noise levels must be finite and above 0, got {bad}")

    def _check_shares(self) -> None:
        by_name = {v.name: v for v in self.variables}
        followed: set[str] = set()
        for v in self.variables:
            if v.shares is None:
                continue
            name, n = v.shares
            other = by_name.get(name)
            if other is None or other is v or name in followed or max(v.count, other.count) > 1:
                raise InputError(
                    f"variable {v.name!r} shares components with {name!r}: both stand alone, and one follows another"
                )
            if n > min(v.free_dim, other.free_dim):
                raise InputError(f"variable {v.name!r} shares {n} components with {name!r}, more than they have")
            followed.add(name)

    @cached_property
    def structure(self) -> Structure:
        """Index maps, built once."""
        return analyse(self.variables, self.factors)

    @property
    def start(self) -> Values:
        """The values that the variables start from."""
        return tuple(v.values for v in self.variables)

    @property
    def noise_groups(self) -> tuple[str, ...]:
        """Noise groups in order of appearance, without the exact priors."""
        return tuple(dict.fromkeys(f.noise for f in self.factors if f.noise != EXACT))

    @property
    def residual_count(self) -> int:
        """Number of scalar residuals, priors included."""
        return sum(f.residual_count for f in self.factors)

    @property
    def free_count(self) -> int:
        """Number of free unknowns."""
        return sum(v.count * v.free_dim - (v.shares[1] if v.shares else 0) for v in self.variables)

    def variable_index(self, name: str) -> int:
        """Position of a variable. Raises: InputError with the names there are."""
        for i, v in enumerate(self.variables):
            if v.name == name:
                return i
        raise InputError(f"the problem has no variable {name!r}; it has {', '.join(v.name for v in self.variables)}")

    def factor_index(self, name: str) -> int:
        """Position of a factor. Raises: InputError with the names there are."""
        for i, f in enumerate(self.factors):
            if f.name == name:
                return i
        raise InputError(f"the problem has no factor {name!r}; it has {', '.join(f.name for f in self.factors)}")

    def with_losses(self, losses: Mapping[str, Loss]) -> Problem:
        """The problem with other losses on the named factors."""
        changed = Problem(
            self.variables,
            tuple(f.with_loss(losses[f.name]) if f.name in losses else f for f in self.factors),
            self.sigmas,
        )
        # The index maps depend on variables and edges alone.
        changed.__dict__["structure"] = self.structure
        return changed

    def sigma(self, factor: Factor, sigmas: Mapping[str, float]) -> float:
        """Noise level of a factor: 1 for exact priors and for groups not named."""
        return 1.0 if factor.noise == EXACT else float(sigmas.get(factor.noise, 1.0))

    def gather(self, factor_index: int, values: Values) -> tuple[Array, ...]:
        """Values of a factor's slots, one row an edge."""
        slots, picks = self.structure.slots[factor_index], self.structure.picks[factor_index]
        return tuple(values[v] if i is None else values[v][i] for v, i in zip(slots, picks))

    def linearize(self, values: Values, sigmas: Mapping[str, float]) -> NormalEquations:
        """Normal equations at `values`."""
        blocks = [f.blocks(self.gather(k, values), sigma=self.sigma(f, sigmas)) for k, f in enumerate(self.factors)]
        return linear.assemble(self.structure, blocks, bases=[self.bases(k, values) for k in range(len(self.factors))])

    def reweigh(
        self, equations: NormalEquations, values: Values, before: Mapping[str, float], after: Mapping[str, float]
    ) -> NormalEquations:
        """The normal equations at the same values with other noise levels.

        A plain square scales with its weight; a robust loss has to be evaluated again.
        """
        blocks = []
        for k, (factor, known) in enumerate(zip(self.factors, equations.factors)):
            old, new = self.sigma(factor, before), self.sigma(factor, after)
            if old == new:
                blocks.append(known)
            elif factor.loss.is_plain:
                blocks.append(known.scaled((old / new) ** 2))
            else:
                blocks.append(factor.blocks(self.gather(k, values), sigma=new))
        return linear.assemble(self.structure, blocks, bases=[self.bases(k, values) for k in range(len(self.factors))])

    def bases(self, factor_index: int, values: Values) -> list[Array | None]:
        """Natural-from-free basis of each slot of a factor: (edges or 1, natural, free), None for the identity."""
        out: list[Array | None] = []
        for v, i in zip(self.structure.slots[factor_index], self.factors[factor_index].indices):
            variable = self.variables[v]
            basis = None if variable.constant else variable.manifold.basis(values[v])
            out.append(basis if basis is None or len(basis) == 1 else basis[i])
        return out

    def retract(self, values: Values, step: Step) -> Values:
        """Values moved by a step."""
        out = []
        for variable, value, placement in zip(self.variables, values, self.structure.placements):
            if placement is None:
                out.append(value)
                continue
            out.append(variable.manifold.retract(value, _free_step(step, placement)))
        return tuple(out)


def _free_step(step: Step, p: Placement) -> Array:
    """A variable's part of a step, (count, free)."""
    if p.together == SHARED:
        first = int(p.offset[0])
        return step.shared[first : first + p.dim * len(p.offset)].reshape(-1, p.dim)
    if p.together is not None:
        return step.components[p.together]
    free = np.empty((len(p.offset), p.dim))
    columns = p.offset[:, None] + np.arange(p.dim)
    for batch, d in enumerate(step.components):
        mine = p.batch == batch
        free[mine] = d[p.row[mine][:, None], columns[mine]]
    return free


def problem(variables: Sequence[Variable], factors: Sequence[Factor], **sigmas: float) -> Problem:
    """Problem from sequences; keyword arguments are noise levels."""
    return Problem(tuple(variables), tuple(factors), sigmas)
