"""The least-squares problem of kinematic calibration: one variable, the whole model; a factor for positions, one for
rotations, each with its own noise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array, Mask
from calibrant.calibrate.kinematics.model import RobotModel
from calibrant.data.joint_measurements import JointMeasurements
from calibrant.geometry import so3
from calibrant.optimize.factors import Factor
from calibrant.optimize.manifolds import Manifold, Variable
from calibrant.optimize.problem import Problem

POSITION, ROTATION = "position", "rotation"
FLOORS = {POSITION: 1e-8, ROTATION: 1e-8}
"""Noise worth telling from none, metres and radians: no tracker comes within a thousand times of these."""
START_SIGMAS = {POSITION: 1e-3, ROTATION: 1e-3}
"""A millimetre and a milliradian: between a tracker and a camera; the estimate does not depend on it."""


@dataclass(frozen=True, eq=False)
class ModelManifold(Manifold):
    """Models of one kind; `free` (p,) says which parameters may move."""

    template: RobotModel
    free: Mask

    @property
    def value_shape(self) -> tuple[int, ...]:
        return self.template.state.shape

    @property
    def natural_names(self) -> tuple[str, ...]:
        return tuple(p.name for p in self.template.parameters)

    @property
    def free_names(self) -> tuple[str, ...]:
        return tuple(p.name for p, free in zip(self.template.parameters, self.free) if free)

    def basis(self, values: Array) -> Array | None:
        return np.eye(len(self.free))[:, self.free][None]

    def retract(self, values: Array, free: Array) -> Array:
        delta = np.zeros(len(self.free))
        delta[self.free] = free[0]
        return self.template.with_state(values[0]).moved(delta).state[None]

    def local(self, origin: Array, values: Array) -> Array:
        return self.template.with_state(origin[0]).steps_to(self.template.with_state(values[0]))[None]


class _ModelFactor(Factor):
    """Residuals of measured tool poses, an edge a measurement."""

    def __init__(self, name: str, template: RobotModel, joints: Array, measured: Array, *, noise: str) -> None:
        self.template, self.joints, self.measured = template, joints, measured
        edges = np.zeros(len(joints), dtype=np.int64)
        super().__init__(name, variables=("model",), indices=(edges,), dim=3, noise=noise)


class PositionFactor(_ModelFactor):
    """r = t - t_measured, metres, along the measuring frame's axes. measured (n, 3)."""

    def linearize(self, *values: Array) -> tuple[Array, tuple[Array, ...]]:
        T, J = self.template.with_state(values[0][0]).linearize(self.joints)
        return T[:, :3, 3] - self.measured, (J[:, 3:],)


class RotationFactor(_ModelFactor):
    """r = log(R R_measured^T), radians, about the measuring frame's axes. measured (n, 3, 3)."""

    def linearize(self, *values: Array) -> tuple[Array, tuple[Array, ...]]:
        T, J = self.template.with_state(values[0][0]).linearize(self.joints)
        r = so3.log(T[:, :3, :3] @ np.swapaxes(self.measured, -1, -2))
        return r, (so3.left_jacobian_inverse(r) @ J[:, :3],)


def model_problem(
    model: RobotModel, measurements: JointMeasurements, free: Mask, *, sigmas: Mapping[str, float] | None = None
) -> Problem:
    """The problem that starts from `model` and moves the parameters where `free` (p,) is true."""
    variable = Variable("model", ModelManifold(model, free), model.state[None])
    factors: list[Factor] = [
        PositionFactor("positions", model, measurements.joints, measurements.positions, noise=POSITION)
    ]
    if measurements.rotations is not None:
        factors.append(RotationFactor("rotations", model, measurements.joints, measurements.rotations, noise=ROTATION))
    return Problem((variable,), tuple(factors), dict(sigmas or START_SIGMAS))


@dataclass(frozen=True, eq=False)
class ModelErrors:
    """Distance (n,) in mm and angle (n,) in degrees of measurements from the model; deg is None for positions only."""

    mm: Array
    deg: Array | None

    @property
    def rms_mm(self) -> float:
        return float(np.sqrt(np.mean(self.mm**2)))

    @property
    def rms_deg(self) -> float | None:
        return None if self.deg is None else float(np.sqrt(np.mean(self.deg**2)))


def model_errors(model: RobotModel, measurements: JointMeasurements) -> ModelErrors:
    """How far the model's tool is from where it was measured."""
    T = model.predict(measurements.joints)
    mm = 1e3 * np.linalg.norm(T[:, :3, 3] - measurements.positions, axis=1)
    if measurements.rotations is None:
        return ModelErrors(mm, None)
    return ModelErrors(mm, np.rad2deg(so3.angle(T[:, :3, :3] @ np.swapaxes(measurements.rotations, -1, -2))))
