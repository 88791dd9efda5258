"""Chains whose geometry can be varied: what kinematic identification works on.

A geometric parameter moves the flange as a joint does, by an instantaneous twist (omega, v), v that of the point at the
base's origin: dT = hat(V) T dp. A description of robots (Denavit-Hartenberg, product of exponentials, links) says which
parameters it has and what twists they cause; the derivative of the pose follows here, and so do conversions.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import Literal, Self

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array
from calibrant.geometry import so3
from calibrant.robots.chain import KinematicChain


@dataclass(frozen=True)
class Parameter:
    """A number of a robot's geometry: its name, and radians or metres."""

    name: str
    unit: Literal["rad", "m"]


class ParametricChain(KinematicChain):
    """A chain with a geometry: `state` holds it as numbers, `moved` steps from it, `geometry_twists` differentiates."""

    @property
    @abstractmethod
    def parameters(self) -> tuple[Parameter, ...]:
        """The p geometric parameters that `moved` steps in."""

    @property
    @abstractmethod
    def state(self) -> Array:
        """The geometry as a flat array: `with_state(state)` is the same chain."""

    @abstractmethod
    def with_state(self, state: ArrayLike) -> Self:
        """The chain of the same kind with another geometry."""

    @abstractmethod
    def moved(self, delta: ArrayLike) -> Self:
        """The chain after a step delta (p,) of its parameters, radians and metres."""

    @abstractmethod
    def steps_to(self, other: Self) -> Array:
        """The delta (p,) with moved(delta) = other, where there is one; else the nearest in the parameters' sense."""

    @abstractmethod
    def with_joint_offsets(self, offsets: ArrayLike) -> Self:
        """The chain whose pose at q is this one's at q + offsets (n,)."""

    @abstractmethod
    def link_frames(self, q: ArrayLike) -> Array:
        """Poses in the base (..., m + 1, 4, 4): the base itself, then what each moving joint carries."""

    @abstractmethod
    def geometry_twists(self, q: ArrayLike) -> Array:
        """Twist of every geometric parameter at its present value, base frame: (..., p, 6)."""

    def joint_twists(self, q: ArrayLike) -> Array:
        """Twist of every joint, base frame: (..., n, 6)."""
        centre, axis = self.joint_axes(q)
        turns = np.array([j.kind == "revolute" for j in self.joints])[:, None]
        return np.where(turns, turning(centre, axis), sliding(axis))

    def geometry_jacobian(self, q: ArrayLike) -> Array:
        """Derivative of the flange's pose in the chart of `se3.retract` by the geometry: (..., 6, p)."""
        return flange_rates(self.geometry_twists(q), self.forward(q)[..., :3, 3])


def turning(point: Array, direction: Array) -> Array:
    """Twists (..., 6) of turning about unit directions (..., 3) through points (..., 3)."""
    return np.concatenate([direction, np.cross(point, direction)], axis=-1)


def sliding(direction: Array) -> Array:
    """Twists (..., 6) of moving along directions (..., 3)."""
    return np.concatenate([np.zeros_like(direction), direction], axis=-1)


def flange_rates(twists: Array, flange: Array) -> Array:
    """(omega, velocity of point flange (..., 3)) of a body under twists (..., k, 6): (..., 6, k)."""
    omega = twists[..., :3]
    v = twists[..., 3:] + np.cross(omega, flange[..., None, :])
    return np.swapaxes(np.concatenate([omega, v], axis=-1), -1, -2)


def across(direction: Array) -> tuple[Array, Array]:
    """Two unit vectors (..., 3) that make a right-handed frame with unit directions (..., 3)."""
    # The coordinate axis farthest from the direction cannot be parallel to it.
    helper = np.eye(3)[np.argmin(np.abs(direction), axis=-1)]
    u = np.cross(helper, direction)
    u = u / np.linalg.norm(u, axis=-1, keepdims=True)
    return u, np.cross(direction, u)


def frame_about(direction: Array) -> Array:
    """Rotations (..., 3, 3) whose z axis is the unit direction (..., 3); the identity for z itself."""
    axis = np.cross([0.0, 0.0, 1.0], direction)
    sine, cosine = np.linalg.norm(axis, axis=-1, keepdims=True), direction[..., 2:]
    u = np.where(sine > 1e-12, axis / np.maximum(sine, 1e-12), [1.0, 0.0, 0.0])
    return so3.exp(u * np.arctan2(sine, cosine))
