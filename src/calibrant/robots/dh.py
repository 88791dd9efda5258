"""Denavit-Hartenberg chains in both conventions; each row gives the pose of link i in link i-1.

    standard (Denavit and Hartenberg 1955; Siciliano):  T = Rz(theta + q) Tz(d) Tx(a) Rx(alpha)
    modified (Craig, Introduction to Robotics, ch. 3):  T = Rx(alpha) Tx(a) Rz(theta + q) Tz(d)

with alpha and a of the row itself: for the modified convention these are Craig's alpha_{i-1} and a_{i-1}. A prismatic
joint adds q to d in place of theta.

Neither can describe two axes that are almost parallel without numbers that explode: their common normal runs away.
Hayati's turn beta about y fills the gap (Hayati and Mirmirani 1985); it is 0 in a maker's table:

    standard:  T = Rz(theta + q) Tz(d) Tx(a) Rx(alpha) Ry(beta)
    modified:  T = Rx(alpha) Tx(a) Ry(beta) Rz(theta + q) Tz(d)
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.robots.chain import Joint
from calibrant.robots.geometry import Parameter, ParametricChain, sliding, turning

_SYMBOLS = ("a", "alpha", "d", "theta", "beta")
_UNITS = ("m", "rad", "m", "rad", "rad")


@dataclass(frozen=True)
class DHRow:
    """One line of a table: a, d in metres, alpha, theta, beta in radians; theta (or d) is the value at q = 0."""

    a: float
    alpha: float
    d: float
    theta: float = 0.0
    beta: float = 0.0


@dataclass(frozen=True)
class DHChain(ParametricChain):
    """A table of rows with a joint each; its parameters are the table's numbers."""

    rows: tuple[DHRow, ...]
    joints: tuple[Joint, ...]

    def __post_init__(self) -> None:
        if not self.rows or len(self.rows) != len(self.joints):
            raise InputError(
                f"a chain needs as many rows as joints, at least one; got {len(self.rows)}, {len(self.joints)}"
            )

    @abstractmethod
    def link_transforms(self, q: ArrayLike) -> Array:
        """Pose of every link in the one before it, (..., n, 4, 4)."""

    def link_frames(self, q: ArrayLike) -> Array:
        """Pose of every link in the base, (..., n + 1, 4, 4): the base itself first, the flange last."""
        T = self.link_transforms(q)
        frames = np.empty((*T.shape[:-3], len(self.rows) + 1, 4, 4))
        frames[..., 0, :, :] = np.eye(4)
        for i in range(len(self.rows)):
            frames[..., i + 1, :, :] = frames[..., i, :, :] @ T[..., i, :, :]
        return frames

    def forward(self, q: ArrayLike) -> Array:
        return self.link_frames(q)[..., -1, :, :]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return tuple(
            Parameter(f"{joint.name} {symbol}", unit)  # type: ignore[arg-type]
            for joint in self.joints
            for symbol, unit in zip(_SYMBOLS, _UNITS)
        )

    @property
    def state(self) -> Array:
        return np.array([[getattr(row, symbol) for symbol in _SYMBOLS] for row in self.rows]).ravel()

    def with_state(self, state: ArrayLike) -> Self:
        table = np.asarray(state, dtype=np.float64).reshape(-1, len(_SYMBOLS))
        return replace(self, rows=tuple(DHRow(**dict(zip(_SYMBOLS, row.tolist()))) for row in table))

    def moved(self, delta: ArrayLike) -> Self:
        return self.with_state(self.state + np.asarray(delta, dtype=np.float64))

    def steps_to(self, other: Self) -> Array:
        return other.state - self.state

    def with_joint_offsets(self, offsets: ArrayLike) -> Self:
        values = np.asarray(offsets, dtype=np.float64).tolist()
        rows = tuple(
            replace(row, theta=row.theta + o) if joint.kind == "revolute" else replace(row, d=row.d + o)
            for row, joint, o in zip(self.rows, self.joints, values)
        )
        return replace(self, rows=rows)

    def _screw(self, q: ArrayLike) -> tuple[Array, Array, Array]:
        """Rz(theta) Tz(d), Tx(a) Rx(alpha) and Ry(beta) of every row, three (..., n, 4, 4)."""
        values = self.check(q)
        turns = np.array([j.kind == "revolute" for j in self.joints])
        theta = np.array([r.theta for r in self.rows]) + np.where(turns, values, 0.0)
        d = np.array([r.d for r in self.rows]) + np.where(turns, 0.0, values)
        alpha, a, beta = (np.array([getattr(r, s) for r in self.rows]) for s in ("alpha", "a", "beta"))
        about_z = _elementary_turn(theta, 0, 1)
        about_z[..., 2, 3] = d
        about_x = _elementary_turn(alpha, 1, 2)
        about_x[:, 0, 3] = a
        shape = about_z.shape
        return about_z, np.broadcast_to(about_x, shape), np.broadcast_to(_elementary_turn(beta, 2, 0), shape)


def _elementary_turn(angle: Array, i: int, j: int) -> Array:
    """Turns (..., 4, 4) in the plane of axes i and j, from i towards j."""
    T = np.zeros((*angle.shape, 4, 4))
    T[...] = np.eye(4)
    T[..., i, i] = T[..., j, j] = np.cos(angle)
    T[..., j, i], T[..., i, j] = np.sin(angle), -np.sin(angle)
    return T


def _stacked_twists(twists: list[Array]) -> Array:
    """Twists of a, alpha, d, theta, beta, each (..., n, 6), as (..., 5 n, 6), row by row."""
    out = np.stack(twists, axis=-2)
    return out.reshape(*out.shape[:-3], -1, 6)


@dataclass(frozen=True)
class StandardDH(DHChain):
    """Standard convention: joint i moves about z of link i-1."""

    def link_transforms(self, q: ArrayLike) -> Array:
        about_z, about_x, about_y = self._screw(q)
        return about_z @ about_x @ about_y

    def joint_axes(self, q: ArrayLike) -> tuple[Array, Array]:
        frames = self.link_frames(q)[..., :-1, :, :]
        return frames[..., :3, 3], frames[..., :3, 2]

    def geometry_twists(self, q: ArrayLike) -> Array:
        frames = self.link_frames(q)
        before, after = frames[..., :-1, :, :], frames[..., 1:, :, :]
        x = (before @ self._screw(q)[0])[..., :3, 0]
        z, start, end = before[..., :3, 2], before[..., :3, 3], after[..., :3, 3]
        y = after[..., :3, 1]
        return _stacked_twists([sliding(x), turning(end, x), sliding(z), turning(start, z), turning(end, y)])


@dataclass(frozen=True)
class ModifiedDH(DHChain):
    """Modified convention: joint i moves about z of link i."""

    def link_transforms(self, q: ArrayLike) -> Array:
        about_z, about_x, about_y = self._screw(q)
        return about_x @ about_y @ about_z

    def joint_axes(self, q: ArrayLike) -> tuple[Array, Array]:
        frames = self.link_frames(q)[..., 1:, :, :]
        return frames[..., :3, 3], frames[..., :3, 2]

    def geometry_twists(self, q: ArrayLike) -> Array:
        frames = self.link_frames(q)
        before, after = frames[..., :-1, :, :], frames[..., 1:, :, :]
        middle = before @ self._screw(q)[1]
        x, y, z = before[..., :3, 0], middle[..., :3, 1], after[..., :3, 2]
        start, corner, end = before[..., :3, 3], middle[..., :3, 3], after[..., :3, 3]
        return _stacked_twists([sliding(x), turning(start, x), sliding(z), turning(end, z), turning(corner, y)])
