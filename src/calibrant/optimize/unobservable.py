"""What the data do not determine, in the problem's own words.

A direction is undetermined when the normal matrix is singular along it: a null vector of the dense part, or a pivot of
an eliminated component that is nothing but rounding. The null vector is split by variable; each variable's manifold
says what its part means ("the position along z"), and the variable says what it is called.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibrant.arrays import Array
from calibrant.optimize.linear import Elimination
from calibrant.optimize.manifolds import Variable
from calibrant.optimize.structure import SHARED, Placement

if TYPE_CHECKING:
    from calibrant.optimize.problem import Problem, Values

STRONG_SHARE = 0.2
"""A variable's part of a unit null vector that is worth naming: below, it only follows the others."""
MOST_NAMED = 10
"""Components named at most: a hundred views without a pose have one cause."""


@dataclass(frozen=True)
class Unobservable:
    """A direction that the data do not determine.

    components: names with their share of the unit vector, in units of what each unknown's own data would determine;
    words: the same as phrases, strongest first; hint: what would determine it, when the variable says so.
    """

    components: tuple[tuple[str, float], ...]
    words: tuple[str, ...] = ()
    hint: str = ""

    @property
    def message(self) -> str:
        """The direction in the problem's own words."""
        text = "the data do not determine " + " together with ".join(self.words or (self.components[0][0],))
        return f"{text}: {self.hint}" if self.hint else text


def of_shared(problem: Problem, values: Values, whitened: Array, scale: Array) -> tuple[Unobservable, ...]:
    """Null directions of the dense part. whitened (s, n): unit null vectors of the scaled matrix; scale (s,) undoes."""
    found = []
    for w in whitened.T:
        parts = []
        for variable, value, columns, index in _shared_instances(problem, values):
            size = float(np.linalg.norm(w[columns]))
            if size > 0.05:  # for the components; words need more
                parts.append((size, variable, index, value, columns))
        parts.sort(key=lambda part: -part[0])
        components = [
            (f"{name} of {variable.label(index)}", float(w[column]))
            for _, variable, index, _, columns in parts
            for name, column in zip(variable.manifold.free_names, range(columns.start, columns.stop))
            if abs(w[column]) > 0.05
        ]
        strong = [part for part in parts if part[0] > STRONG_SHARE] or parts[:1]
        words = tuple(
            _phrase(variable, index, value, w[columns], w[columns] * scale[columns])
            for _, variable, index, value, columns in strong
        )
        hint = next((variable.hint for _, variable, *_ in strong if variable.hint), "")
        found.append(Unobservable(tuple(sorted(components, key=lambda c: -abs(c[1]))), words, hint))
    return tuple(found)


def _shared_instances(problem: Problem, values: Values) -> Iterator[tuple[Variable, Array, slice, int]]:
    for variable, value, p in zip(problem.variables, values, problem.structure.placements):
        if p is not None and p.together == SHARED:
            for index in range(variable.count):
                first = int(p.offset[index])
                yield variable, value[index : index + 1], slice(first, first + p.dim), index


def _phrase(variable: Variable, index: int, value: Array, share: Array, direction: Array) -> str:
    basis = variable.manifold.basis(value)
    natural = direction if basis is None else basis[0] @ direction
    shares = share if basis is None else (basis[0] != 0).astype(np.float64) @ np.abs(share)
    what = variable.manifold.describe(natural, np.abs(shares))
    return f"{what} of {variable.label(index)}"


def of_components(problem: Problem, parts: Sequence[Elimination]) -> tuple[Unobservable, ...]:
    """Eliminated components (views, points) with a pivot that is rounding."""
    found = []
    for batch, part in enumerate(parts):
        for row in np.flatnonzero(part.weak >= 0)[:MOST_NAMED].tolist():
            variable, name = _component(problem, batch, row, int(part.weak[row]))
            found.append(Unobservable(((name, 1.0),), (f"the {name}",), variable.hint))
    return tuple(found)


def _component(problem: Problem, batch: int, row: int, column: int) -> tuple[Variable, str]:
    for variable, p in zip(problem.variables, problem.structure.placements):
        hit = _instance_at(p, batch, row, column) if p is not None else None
        if p is not None and hit is not None:
            free = variable.manifold.free_names[column - int(p.offset[hit])]
            return variable, f"{free} of {variable.label(hit)}"
    raise AssertionError("every column of a component belongs to a variable")


def _instance_at(p: Placement, batch: int, row: int, column: int) -> int | None:
    hit = np.flatnonzero((p.batch == batch) & (p.row == row) & (p.offset <= column) & (column < p.offset + p.dim))
    return int(hit[0]) if len(hit) else None
