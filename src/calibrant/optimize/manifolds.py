"""The spaces that variables live in, and the charts that the solver steps through.

A manifold holds a batch of values, leading axis `count`. Factors differentiate with respect to the *natural* tangent of
a value (a vector's components; `se3.retract`'s chart for a pose). The solver steps in the *free* tangent, which may be
smaller (fixed or tied parameters) or stretched (bounds): natural = basis @ free, the basis taken at the current value.
Bounds, ties and constants are all parameterisations, so the solver itself is unconstrained.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.geometry import se3, so3


class Manifold(ABC):
    """A space of values with a tangent of fixed dimension at each of them."""

    @property
    @abstractmethod
    def value_shape(self) -> tuple[int, ...]:
        """Shape of one value."""

    @property
    @abstractmethod
    def natural_names(self) -> tuple[str, ...]:
        """Names of the natural tangent's components."""

    @property
    def free_names(self) -> tuple[str, ...]:
        """Names of the components that the solver may move."""
        return self.natural_names

    def basis(self, values: Array) -> Array | None:
        """Natural from free tangent: (count or 1, natural, free); None stands for the identity."""
        return None

    @abstractmethod
    def retract(self, values: Array, free: Array) -> Array:
        """Values (count, …) moved by free tangents (count, free)."""

    @abstractmethod
    def local(self, origin: Array, values: Array) -> Array:
        """Natural tangents (count, natural) that lead from `origin` to `values`."""

    def describe(self, direction: Array, share: Array) -> str:
        """A natural tangent in words, for what the data do not determine.

        share (natural,): how much each component takes part, 0 to 1; what takes little part is not named.
        """
        strong = [i for i in np.argsort(-share, kind="stable").tolist() if share[i] > 0.2] or [int(np.argmax(share))]
        return " with ".join(self.natural_names[i] for i in strong)


@dataclass(frozen=True)
class _Vectors(Manifold):
    """Vectors of named components: what all of them share, whichever way the solver may move them."""

    names: tuple[str, ...]

    @property
    def value_shape(self) -> tuple[int, ...]:
        return (len(self.names),)

    @property
    def natural_names(self) -> tuple[str, ...]:
        return self.names

    def local(self, origin: Array, values: Array) -> Array:
        return values - origin


@dataclass(frozen=True)
class Euclidean(_Vectors):
    """Vectors of named components; `held` components stay as they are."""

    held: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        unknown = [n for n in self.held if n not in self.names]
        if unknown:
            raise InputError(f"cannot hold {', '.join(unknown)}: the components are {', '.join(self.names)}")

    @property
    def free_names(self) -> tuple[str, ...]:
        return tuple(n for n in self.names if n not in self.held)

    def basis(self, values: Array) -> Array | None:
        if not self.held:
            return None
        return np.eye(len(self.names))[:, [n not in self.held for n in self.names]][None]

    def retract(self, values: Array, free: Array) -> Array:
        basis = self.basis(values)
        return values + (free if basis is None else free @ basis[0].T)


@dataclass(frozen=True, eq=False)
class Subspace(_Vectors):
    """Vectors that move only along the columns of `directions` (natural, free): tied parameters."""

    directions: Array
    direction_names: tuple[str, ...]

    @property
    def free_names(self) -> tuple[str, ...]:
        return self.direction_names

    def basis(self, values: Array) -> Array | None:
        return np.asarray(self.directions, dtype=np.float64)[None]

    def retract(self, values: Array, free: Array) -> Array:
        return values + free @ np.asarray(self.directions).T


@dataclass(frozen=True)
class Positive(_Vectors):
    """Vectors of positive components (scales): x <- x exp(free), so no step leaves the positive side."""

    def basis(self, values: Array) -> Array | None:
        return values[:, :, None] * np.eye(len(self.names))

    def retract(self, values: Array, free: Array) -> Array:
        return values * np.exp(free)


@dataclass(frozen=True, eq=False)
class Interval(_Vectors):
    """Vectors bounded by lower < x < upper, componentwise: x = lower + (upper - lower) / (1 + exp(-q)), q moves."""

    lower: Array
    upper: Array

    def basis(self, values: Array) -> Array | None:
        slope = (values - self.lower) * (self.upper - values) / (np.asarray(self.upper) - self.lower)
        return slope[:, :, None] * np.eye(len(self.names))

    def retract(self, values: Array, free: Array) -> Array:
        q = np.log(values - self.lower) - np.log(self.upper - values) + free
        with np.errstate(over="ignore"):
            return self.lower + (np.asarray(self.upper) - self.lower) / (1 + np.exp(-q))


@dataclass(frozen=True)
class SE3(Manifold):
    """Rigid transforms (4, 4) in `se3.retract`'s chart: rotation about, then translation along, the parent's axes."""

    @property
    def value_shape(self) -> tuple[int, ...]:
        return (4, 4)

    @property
    def natural_names(self) -> tuple[str, ...]:
        return ("rotation x", "rotation y", "rotation z", "x", "y", "z")

    def retract(self, values: Array, free: Array) -> Array:
        from calibrant.optimize import pose_kernels

        moved = np.empty((len(values), 4, 4))
        pose_kernels.retract(np.ascontiguousarray(values), np.ascontiguousarray(free), moved)
        return moved

    def local(self, origin: Array, values: Array) -> Array:
        return se3.local(origin, values)

    def describe(self, direction: Array, share: Array) -> str:
        phrases = [
            f"{what} {_axis_name(part)}"
            for what, part, size in (
                ("the rotation about", direction[:3], np.linalg.norm(share[:3])),
                ("the position along", direction[3:], np.linalg.norm(share[3:])),
            )
            if size > 0.2
        ]
        return " with ".join(phrases) or super().describe(direction, share)


@dataclass(frozen=True)
class Position(SE3):
    """Rigid transforms of which only the position moves: a point in its parent's axes, T = (I, p)."""

    @property
    def free_names(self) -> tuple[str, ...]:
        return ("x", "y", "z")

    def basis(self, values: Array) -> Array | None:
        return np.eye(6)[:, 3:][None]

    def retract(self, values: Array, free: Array) -> Array:
        moved = values.copy()
        moved[:, :3, 3] += free
        return moved


def _axis_name(direction: Array) -> str:
    """An axis by its letter when it is one within 5 degrees, else as a unit vector."""
    unit = direction / max(float(np.linalg.norm(direction)), 1e-300)
    largest = int(np.argmax(np.abs(unit)))
    if abs(unit[largest]) > np.cos(np.deg2rad(5)):
        return "xyz"[largest]
    unit = unit * np.sign(unit[largest])
    return "(" + ", ".join(f"{c:.2f}" for c in unit) + ")"


@dataclass(frozen=True)
class SO3(Manifold):
    """Rotations (3, 3): R <- exp(omega) R."""

    @property
    def value_shape(self) -> tuple[int, ...]:
        return (3, 3)

    @property
    def natural_names(self) -> tuple[str, ...]:
        return ("rotation x", "rotation y", "rotation z")

    def retract(self, values: Array, free: Array) -> Array:
        return so3.exp(free) @ values

    def local(self, origin: Array, values: Array) -> Array:
        return so3.log(values @ np.swapaxes(origin, -1, -2))


@dataclass(frozen=True, eq=False)
class Variable:
    """A named batch of unknowns of one kind: values (count, *manifold.value_shape).

    `constant` variables take part in factors but are not solved for. `labels` name the instances for people, `words`
    the variable ("the camera on the gripper"), `hint` says what would determine it ("turn about another axis").
    shares: (name, n) of another variable of one instance whose last n free components are this one's first n: one
    unknown each, not two; both then start from the same values of them.
    Raises: InputError for a wrong shape, an empty batch or values that are not finite.
    """

    name: str
    manifold: Manifold
    values: Array
    constant: bool = False
    labels: Sequence[str] | None = None
    words: str = ""
    hint: str = ""
    shares: tuple[str, int] | None = None

    def __post_init__(self) -> None:
        values = np.array(self.values, dtype=np.float64)
        if values.shape[1:] != self.manifold.value_shape or len(values) == 0:
            shape = ", ".join(map(str, self.manifold.value_shape))
            raise InputError(
                f"variable {self.name!r}: expected values of shape (count, {shape}) with count >= 1, got {values.shape}"
            )
        if not np.all(np.isfinite(values)):
            raise InputError(f"variable {self.name!r} starts from NaN or infinite values")
        if isinstance(self.manifold, Interval) and not np.all(
            (values > self.manifold.lower) & (values < self.manifold.upper)
        ):
            raise InputError(f"variable {self.name!r} does not start strictly inside its bounds")
        if isinstance(self.manifold, Positive) and not np.all(values > 0):
            raise InputError(f"variable {self.name!r} must start above 0, got {values.min():g}")
        values.setflags(write=False)
        object.__setattr__(self, "values", values)

    @property
    def count(self) -> int:
        return len(self.values)

    @cached_property
    def free_dim(self) -> int:
        return 0 if self.constant else len(self.manifold.free_names)

    def label(self, index: int) -> str:
        """How messages call one instance."""
        called = self.words or self.name
        if self.count == 1 and self.labels is None:
            return called
        return f"{called} {self.labels[index] if self.labels is not None else index}"


def vector(name: str, values: ArrayLike, names: Sequence[str], *, held: Sequence[str] = ()) -> Variable:
    """One vector as a variable of count 1."""
    return Variable(name, Euclidean(tuple(names), tuple(held)), np.asarray(values, dtype=np.float64)[None])
