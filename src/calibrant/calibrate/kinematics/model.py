"""The model of a measured robot: base, chain, joints that are not quite what they say, tool.

    T_world_tool = T_world_base  FK(q + B(q) theta; geometry)  T_flange_tool

B(q) theta is what the joints do beyond their readings, linear in theta: a constant offset; a gear error, in proportion
to the joint itself; a coupling, in proportion to another joint; a compliance, in proportion to the torque of gravity on
the joint (Roth, Mooring, Ravani 1987; Khalil and Dombre, ch. 11). The torque is that of the nominal geometry: the
change of the lever arms by calibration is of second order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.geometry import se3
from calibrant.robots.geometry import ParametricChain, flange_rates
from calibrant.robots.links import LinkChain, Load

Group = Literal["base", "tool", "offsets", "geometry", "gear", "coupling", "elasticity"]
GROUPS: tuple[Group, ...] = ("base", "tool", "offsets", "geometry", "gear", "coupling", "elasticity")
"""In the order in which they are preferred where two parameters have the same effect."""

STANDARD_GRAVITY = 9.80665
"""m/s^2 (CGPM 1901); the few per mille by which places differ go into the compliances."""

_POSE_PARTS = (*((f"rotation {axis}", "rad") for axis in "xyz"), *((axis, "m") for axis in "xyz"))


@dataclass(frozen=True)
class ModelParameter:
    """A parameter: name, unit (rad, m, a ratio "1", rad/Nm), and the group it belongs to."""

    name: str
    unit: str
    group: Group


@dataclass(frozen=True)
class JointTerm:
    """One column of B: what joint `joint` does in proportion to 1, to joint `source`, or to its own gravity torque."""

    kind: Literal["offsets", "gear", "coupling", "elasticity"]
    joint: int
    source: int


@dataclass(frozen=True, eq=False)
class Gravity:
    """Masses on a chain. down (3,): direction of gravity in the base frame; payload in kg at the flange's origin."""

    chain: ParametricChain
    loads: tuple[Load, ...]
    payload: float = 0.0
    down: tuple[float, float, float] = (0.0, 0.0, -1.0)

    def torques(self, q: ArrayLike) -> Array:
        """Torque of gravity on every joint, N m (force in N for a sliding joint): (..., n).

        The power of the weights under each joint's twist: tau_i = sum_k m_k g . (velocity of mass k).
        """
        twists = self.chain.joint_twists(q)
        frames = self.chain.link_frames(q)
        g = STANDARD_GRAVITY * np.asarray(self.down) / np.linalg.norm(self.down)
        masses = [(w.mover, w.mass, se3.apply(frames[..., w.mover + 1, :, :], w.centre)) for w in self.loads]
        if self.payload > 0:
            masses.append((frames.shape[-3] - 2, self.payload, self.chain.forward(q)[..., :3, 3]))
        tau = np.zeros(twists.shape[:-1])
        carried = self._carried(frames.shape[-3] - 1)
        for mover, mass, centre in masses:
            velocity = twists[..., 3:] + np.cross(twists[..., :3], centre[..., None, :])
            tau += carried[:, mover] * mass * np.einsum("...nk,k->...n", velocity, g)
        return tau

    def _carried(self, movers: int) -> Array:
        """1 where a mass on mover k moves with joint i, (n, movers): on it or behind it."""
        if not isinstance(self.chain, LinkChain):
            return np.triu(np.ones((len(self.chain.joints), movers)))
        first = [int(np.flatnonzero(column)[0]) for column in np.asarray(self.chain.mixing).T]
        return np.array([[float(mover >= start) for mover in range(movers)] for start in first])


@dataclass(frozen=True, eq=False)
class RobotModel:
    """A robot as it is measured: T_world_base and T_flange_tool (4, 4), joint terms with their amounts theta (g,)."""

    chain: ParametricChain
    T_world_base: Array
    T_flange_tool: Array
    terms: tuple[JointTerm, ...] = ()
    theta: Array | None = None
    gravity: Gravity | None = None

    def __post_init__(self) -> None:
        if self.gravity is None and any(t.kind == "elasticity" for t in self.terms):
            raise InputError("joint elasticity needs the robot's masses (URDF inertials) or a payload")
        if self.theta is None:
            object.__setattr__(self, "theta", np.zeros(len(self.terms)))

    @property
    def amounts(self) -> Array:
        """theta (g,)."""
        return np.asarray(self.theta)

    @cached_property
    def parameters(self) -> tuple[ModelParameter, ...]:
        """All parameters in the order of the columns: base, joint terms, geometry, tool."""
        return (
            *(ModelParameter(f"base {name}", unit, "base") for name, unit in _POSE_PARTS),
            *(self._term_parameter(term) for term in self.terms),
            *(ModelParameter(p.name, p.unit, "geometry") for p in self.chain.parameters),
            *(ModelParameter(f"tool {name}", unit, "tool") for name, unit in _POSE_PARTS),
        )

    def _term_parameter(self, term: JointTerm) -> ModelParameter:
        joint = self.chain.joints[term.joint]
        own = "rad" if joint.kind == "revolute" else "m"
        if term.kind == "offsets":
            return ModelParameter(f"{joint.name} offset", own, term.kind)
        if term.kind == "gear":
            return ModelParameter(f"{joint.name} gear error", "1", term.kind)
        if term.kind == "coupling":
            return ModelParameter(f"{joint.name} by {self.chain.joints[term.source].name}", "1", term.kind)
        return ModelParameter(f"{joint.name} compliance", f"{own}/{'Nm' if own == 'rad' else 'N'}", term.kind)

    @property
    def state(self) -> Array:
        """The model as a flat array."""
        return np.concatenate([self.T_world_base.ravel(), self.amounts, self.chain.state, self.T_flange_tool.ravel()])

    def with_state(self, state: Array) -> RobotModel:
        """The same kind of model with other numbers."""
        g = len(self.terms)
        return replace(
            self,
            T_world_base=state[:16].reshape(4, 4),
            theta=state[16 : 16 + g],
            chain=self.chain.with_state(state[16 + g : -16]),
            T_flange_tool=state[-16:].reshape(4, 4),
        )

    def moved(self, delta: Array) -> RobotModel:
        """The model after a step delta (p,) of its parameters."""
        g = len(self.terms)
        return replace(
            self,
            T_world_base=se3.retract(self.T_world_base, delta[:6]),
            theta=self.amounts + delta[6 : 6 + g],
            chain=self.chain.moved(delta[6 + g : -6]),
            T_flange_tool=se3.retract(self.T_flange_tool, delta[-6:]),
        )

    def steps_to(self, other: RobotModel) -> Array:
        """The delta (p,) with moved(delta) = other."""
        return np.concatenate(
            [
                se3.local(self.T_world_base, other.T_world_base),
                other.amounts - self.amounts,
                self.chain.steps_to(other.chain),
                se3.local(self.T_flange_tool, other.T_flange_tool),
            ]
        )

    def joint_basis(self, q: ArrayLike) -> Array:
        """B(q): (..., n, g)."""
        values = self.chain.check(q)
        B = np.zeros((*values.shape, len(self.terms)))
        elastic = any(t.kind == "elasticity" for t in self.terms)
        tau = self.gravity.torques(values) if self.gravity is not None and elastic else None
        for column, term in enumerate(self.terms):
            if term.kind == "offsets":
                B[..., term.joint, column] = 1.0
            elif term.kind == "elasticity" and tau is not None:
                B[..., term.joint, column] = tau[..., term.joint]
            else:
                B[..., term.joint, column] = values[..., term.source]
        return B

    def true_joints(self, q: ArrayLike) -> Array:
        """What the joints really are when they read q: q + B(q) theta, (..., n)."""
        return self.chain.check(q) + self.joint_basis(q) @ self.amounts

    def predict(self, q: ArrayLike) -> Array:
        """T_world_tool (..., 4, 4) at joint readings q (..., n)."""
        return self.T_world_base @ self.chain.forward(self.true_joints(q)) @ self.T_flange_tool

    def joint_jacobian(self, q: ArrayLike, beyond: Array | float = 0.0) -> Array:
        """Derivative of T_world_tool by each joint's true value, (..., 6, n), in the chart of `se3.retract`.

        beyond (..., n): what the joints did beyond what the model says of their readings q.
        """
        x = self.true_joints(q) + beyond
        point = (self.chain.forward(x) @ self.T_flange_tool)[..., :3, 3]
        J, R = flange_rates(self.chain.joint_twists(x), point), self.T_world_base[:3, :3]
        return np.concatenate([R @ J[..., :3, :], R @ J[..., 3:, :]], axis=-2)

    def linearize(self, q: ArrayLike, beyond: Array | float = 0.0) -> tuple[Array, Array]:
        """T_world_tool (..., 4, 4) and its derivative in the chart of `se3.retract`, (..., 6, p).

        beyond (..., n): what the joints did beyond what the model says of their readings q.
        """
        x = self.true_joints(q) + beyond
        T_base_flange = self.chain.forward(x)
        T_base_tool = T_base_flange @ self.T_flange_tool
        T = self.T_world_base @ T_base_tool
        R = self.T_world_base[:3, :3]
        point = T_base_tool[..., :3, 3]
        joints = flange_rates(self.chain.joint_twists(x), point) @ self.joint_basis(q)
        inner = np.concatenate([joints, flange_rates(self.chain.geometry_twists(x), point)], axis=-1)
        inner = np.concatenate([R @ inner[..., :3, :], R @ inner[..., 3:, :]], axis=-2)
        base = np.zeros((*T.shape[:-2], 6, 6))
        base[..., :3, :3] = base[..., 3:, 3:] = np.eye(3)
        arm = T[..., :3, 3] - self.T_world_base[:3, 3]
        base[..., 3:, :3] = np.swapaxes(np.cross(np.eye(3), arm[..., None, :]), -1, -2)
        tool = np.zeros((*T.shape[:-2], 6, 6))
        tool[..., :3, :3] = tool[..., 3:, 3:] = R @ T_base_flange[..., :3, :3]
        return T, np.concatenate([base, inner, tool], axis=-1)


def joint_terms(joints: int, groups: Sequence[str]) -> tuple[JointTerm, ...]:
    """The columns of B for the groups asked for. A joint may be coupled to any before it, as wrists' gears are."""
    terms: list[JointTerm] = []
    if "offsets" in groups:
        terms += [JointTerm("offsets", i, i) for i in range(joints)]
    if "gear" in groups:
        terms += [JointTerm("gear", i, i) for i in range(joints)]
    if "coupling" in groups:
        terms += [JointTerm("coupling", i, j) for i in range(joints) for j in range(i)]
    if "elasticity" in groups:
        terms += [JointTerm("elasticity", i, i) for i in range(joints)]
    return tuple(terms)
