"""A simulated arm with errors of geometry, measured with noise: the truth against which identification is judged."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array
from calibrant.data.joint_measurements import JointMeasurements
from calibrant.geometry import se3, so3
from calibrant.robots.geometry import ParametricChain


@dataclass(frozen=True, eq=False)
class SimulatedArm:
    """A nominal chain, the true one, where the arm stands and what it carries: T_world_base, T_flange_tool."""

    nominal: ParametricChain
    true: ParametricChain
    T_world_base: Array
    T_flange_tool: Array

    def tool(self, q: Array) -> Array:
        """True T_world_tool (n, 4, 4)."""
        return self.T_world_base @ self.true.forward(q) @ self.T_flange_tool

    def draw_joints(self, rng: np.random.Generator, count: int) -> Array:
        """Joint values (count, n) anywhere within the limits, at most half a turn from zero."""
        lower, upper = np.maximum(self.nominal.lower, -np.pi), np.minimum(self.nominal.upper, np.pi)
        return rng.uniform(lower, upper, (count, len(lower)))


def simulate_arm(
    nominal: ParametricChain, rng: np.random.Generator, *, sigma_mm: float, sigma_deg: float
) -> SimulatedArm:
    """The chain with every length off by sigma_mm and every angle by sigma_deg (1 sigma), at a random place."""
    scale = np.array([1e-3 * sigma_mm if p.unit == "m" else np.deg2rad(sigma_deg) for p in nominal.parameters])
    true = nominal.moved(rng.normal(size=len(scale)) * scale)
    base = se3.make(so3.random(rng, 1)[0], rng.normal(scale=1.0, size=3))
    tool = se3.make(so3.random(rng, 1)[0], rng.normal(scale=0.1, size=3))
    return SimulatedArm(nominal, true, base, tool)


def measure(
    arm: SimulatedArm, q: Array, rng: np.random.Generator, *, sigma_mm: float, sigma_deg: float | None
) -> JointMeasurements:
    """The tool at joints q (n, k) with noise, 1 sigma per axis; without sigma_deg its positions alone."""
    T = arm.tool(q)
    positions = T[:, :3, 3] + rng.normal(scale=1e-3 * sigma_mm, size=(len(q), 3))
    rotations = None
    if sigma_deg is not None:
        rotations = so3.exp(rng.normal(scale=np.deg2rad(sigma_deg), size=(len(q), 3))) @ T[:, :3, :3]
    names = tuple(j.name for j in arm.nominal.joints)
    return JointMeasurements(tuple(str(i) for i in range(len(q))), q, positions, rotations, names, "simulated")
