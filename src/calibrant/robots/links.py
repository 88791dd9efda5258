"""Chains of links: fixed transforms between joints with an axis each, as URDF describes robots.

    T_base_flange = F_1 M_1(x_1) F_2 M_2(x_2) ... F_m M_m(x_m) F_end,     x = G q + offset

F_k is where joint k sits in the link before it, M_k turns about (or slides along) its axis by x_k. G is the identity
unless joints mimic others: then a joint of q moves several x. Geometric parameters are six an F: turns about the
parent link's axes through the joint's origin, shifts along them (the chart of `se3.retract`).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal, Self

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.robots.chain import Joint, KinematicChain
from calibrant.robots.geometry import Parameter, ParametricChain, flange_rates, frame_about, sliding, turning

_PARTS = tuple((f"{kind}{axis}", unit) for kind, unit in (("rotation ", "rad"), ("", "m")) for axis in "xyz")


@dataclass(frozen=True)
class Mover:
    """One moving joint of the mechanism: its name, its unit axis in its own frame, and how it moves."""

    name: str
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    kind: Literal["revolute", "prismatic"] = "revolute"


@dataclass(frozen=True)
class Load:
    """A mass in kg carried by what moving joint `mover` moves, its centre (3,) in that joint's moved frame, metres."""

    mover: int
    mass: float
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class LinkChain(ParametricChain):
    """joints (n) are what q holds; movers (m) with links F (m + 1, 4, 4), the last F_end; mixing G (m, n), offset (m,).

    loads: masses, for gravity. Raises: InputError for sizes that do not fit.
    """

    joints: tuple[Joint, ...]
    movers: tuple[Mover, ...]
    links: Array
    mixing: Array | None = None
    offset: Array | None = None
    loads: tuple[Load, ...] = ()
    _axes: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        m, n = len(self.movers), len(self.joints)
        set_ = object.__setattr__
        set_(self, "links", se3.check(self.links, name="links"))
        set_(self, "mixing", np.eye(m, n) if self.mixing is None else np.asarray(self.mixing, dtype=np.float64))
        set_(self, "offset", np.zeros(m) if self.offset is None else np.asarray(self.offset, dtype=np.float64))
        if not n or not m:
            raise InputError("a chain needs at least one moving joint")
        sizes = (self.links.shape, self._mixing.shape, self._offset.shape)
        if sizes != ((m + 1, 4, 4), (m, n), (m,)) or (m != n and self.mixing is None):
            raise InputError(f"{m} moving joints, {n} joint values: links, mixing, offset have shapes {sizes}")
        axes = np.array([mover.axis for mover in self.movers], dtype=np.float64)
        lengths = np.linalg.norm(axes, axis=1)
        if not np.all(lengths > 1e-9):
            raise InputError(f"joint {self.movers[int(np.argmin(lengths))].name!r}: its axis has no direction")
        set_(self, "_axes", axes / lengths[:, None])

    @property
    def _mixing(self) -> Array:
        return np.asarray(self.mixing)

    @property
    def _offset(self) -> Array:
        return np.asarray(self.offset)

    @property
    def _turns(self) -> Array:
        return np.array([m.kind == "revolute" for m in self.movers])

    def forward(self, q: ArrayLike) -> Array:
        return self.link_frames(q)[..., -1, :, :] @ self.links[-1]

    def link_frames(self, q: ArrayLike) -> Array:
        return self._frames(q)[1]

    def _frames(self, q: ArrayLike) -> tuple[Array, Array]:
        """Frames of the joints before (..., m, 4, 4) and after they move, the base first (..., m + 1, 4, 4)."""
        x = np.einsum("mn,...n->...m", self._mixing, self.check(q)) + self._offset
        turn = so3.exp(np.where(self._turns[:, None], x[..., None] * self._axes, 0.0))
        motion = se3.make(turn, np.where(self._turns[:, None], 0.0, x[..., None] * self._axes))
        fixed = np.empty((*x.shape, 4, 4))
        moved = np.empty((*x.shape[:-1], len(self.movers) + 1, 4, 4))
        moved[..., 0, :, :] = np.eye(4)
        for k in range(len(self.movers)):
            fixed[..., k, :, :] = moved[..., k, :, :] @ self.links[k]
            moved[..., k + 1, :, :] = fixed[..., k, :, :] @ motion[..., k, :, :]
        return fixed, moved

    def joint_axes(self, q: ArrayLike) -> tuple[Array, Array]:
        """Axes of the joints' own movers; what mimics them moves too, so derivatives come from `joint_twists`."""
        fixed = self._frames(q)[0]
        names = [m.name for m in self.movers]
        own = [names.index(j.name) if j.name in names else 0 for j in self.joints]
        frames = fixed[..., own, :, :]
        return frames[..., :3, 3], np.einsum("...kij,kj->...ki", frames[..., :3, :3], self._axes[own])

    def joint_twists(self, q: ArrayLike) -> Array:
        fixed = self._frames(q)[0]
        axis = np.einsum("...kij,kj->...ki", fixed[..., :3, :3], self._axes)
        twists = np.where(self._turns[:, None], turning(fixed[..., :3, 3], axis), sliding(axis))
        return np.einsum("mn,...mk->...nk", self._mixing, twists)

    def jacobian(self, q: ArrayLike) -> Array:
        return flange_rates(self.joint_twists(q), self.forward(q)[..., :3, 3])

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        names = (*(m.name for m in self.movers), "flange")
        return tuple(Parameter(f"{name} {part}", unit) for name in names for part, unit in _PARTS)  # type: ignore[arg-type]

    @property
    def state(self) -> Array:
        return self.links.ravel()

    def with_state(self, state: ArrayLike) -> Self:
        return replace(self, links=np.asarray(state, dtype=np.float64).reshape(-1, 4, 4))

    def moved(self, delta: ArrayLike) -> Self:
        return replace(self, links=se3.retract(self.links, np.asarray(delta, dtype=np.float64).reshape(-1, 6)))

    def steps_to(self, other: Self) -> Array:
        return se3.local(self.links, other.links).ravel()

    def geometry_twists(self, q: ArrayLike) -> Array:
        fixed, moved = self._frames(q)
        flange = moved[..., -1:, :, :] @ self.links[-1]
        origins = np.concatenate([fixed[..., :3, 3], flange[..., :3, 3]], axis=-2)[..., None, :]
        axes = np.swapaxes(moved[..., :3, :3], -1, -2)  # row i: the parent link's axis i in the base
        points = np.broadcast_to(origins, axes.shape)
        twists = np.concatenate([turning(points, axes), sliding(axes)], axis=-2)
        return twists.reshape(*twists.shape[:-3], -1, 6)

    def with_joint_offsets(self, offsets: ArrayLike) -> Self:
        return self._baked(self._mixing @ np.asarray(offsets, dtype=np.float64))

    def _baked(self, x: Array) -> Self:
        """The chain with joint positions x (m,) made part of its fixed transforms."""
        turn = so3.exp(np.where(self._turns[:, None], x[:, None] * self._axes, 0.0))
        motion = se3.make(turn, np.where(self._turns[:, None], 0.0, x[:, None] * self._axes))
        links = np.array(self.links)
        links[:-1] = links[:-1] @ motion
        return replace(self, links=links)


def as_links(chain: KinematicChain) -> LinkChain:
    """Any chain as links with joints about z: frames stand on the joints' axes as they are at q = 0."""
    if isinstance(chain, LinkChain):
        return chain
    zero = np.zeros(len(chain.joints))
    centre, axis = chain.joint_axes(zero)
    frames = np.concatenate([np.eye(4)[None], se3.make(frame_about(axis), centre), chain.forward(zero)[None]])
    links = se3.inverse(frames[:-1]) @ frames[1:]
    return LinkChain(chain.joints, tuple(Mover(j.name, kind=j.kind) for j in chain.joints), links)
