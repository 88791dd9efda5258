"""Joint offsets in the image problem: a robot pose is what its geometry makes of the joints that were read.

    r_rot = log(R_i R(q_i + e_i; p)^T),   r_trans = t_i - t(q_i + e_i; p),   r_joint = e_i,
    p = (joint offsets, gear errors, couplings, geometry)

stand in the place of the priors that tie a robot pose to what the controller says. What p explains is systematic and is
taken out of every pose; what it leaves is the robot's noise, with three levels: that of the joints (their encoders and
gears: it turns and moves a pose together, and not alike in all directions) and two of what links and frame add to a
pose. Without p this is the problem of `problem`.

An offset of the first joint turns the robot about its base as the target's (or the camera's) place does, and one of the
last joint turns the flange as the camera's mounting does: which parameters remain is asked of the regressor with base
and tool free (`kinematics.identifiability`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array, Mask
from calibrant.calibrate.kinematics.identifiability import select
from calibrant.calibrate.kinematics.identify import WEAKEST, IdentifiedParameter, figure
from calibrant.calibrate.kinematics.model import RobotModel, joint_terms
from calibrant.calibrate.kinematics.problem import ModelManifold
from calibrant.data import RobotPoses
from calibrant.errors import InputError
from calibrant.geometry import so3
from calibrant.optimize.factors import Factor
from calibrant.optimize.manifolds import Euclidean, Variable
from calibrant.optimize.solution import Solution
from calibrant.robots.geometry import ParametricChain
from calibrant.robots.limits import check_limits

KINDS = ("offsets", "gear", "coupling", "geometry")
"""What may be identified from pictures; elasticity needs masses, and poses of the whole working space."""


@dataclass(frozen=True, eq=False)
class JointReadings:
    """What a robot's joints read at named moments: ids (n,), q (n, k) radians and metres, of a chain.

    >>> import calibrant as cb
    >>> from calibrant.formats.robots.read import read_robot
    >>> chain = read_robot("ur5e").chain
    >>> cb.JointReadings(("0.png",), [[0.0, -1.2, 1.5, -0.3, 1.5, 0.0]], chain).ids
    ('0.png',)
    """

    ids: tuple[str, ...]
    q: Array
    chain: ParametricChain

    def __post_init__(self) -> None:
        q = self.chain.check(self.q)
        if q.ndim != 2 or len(q) != len(self.ids):
            raise InputError(f"{len(self.ids)} names but joint values of shape {q.shape}; expected one row a name")
        check_limits(self.chain, q, self.ids)
        object.__setattr__(self, "q", q)

    @classmethod
    def from_values(cls, q: ArrayLike, chain: ParametricChain) -> JointReadings:
        """Readings (n, k) named "0", "1", …"""
        values = np.atleast_2d(np.asarray(q, dtype=np.float64))
        return cls(tuple(str(i) for i in range(len(values))), values, chain)

    @property
    def poses(self) -> RobotPoses:
        """T_base_gripper by the chain as it is."""
        return RobotPoses(self.ids, self.chain.forward(self.q), "forward kinematics of the joint values")

    def only(self, ids: Sequence[str]) -> JointReadings:
        """The readings of these ids, in the order asked. Raises: InputError naming one that is not there."""
        index = {name: i for i, name in enumerate(self.ids)}
        unknown = [i for i in ids if i not in index]
        if unknown:
            raise InputError(f"no joint values for {unknown[0]!r}; there are {', '.join(self.ids[:5])} …")
        return replace(self, ids=tuple(ids), q=self.q[[index[i] for i in ids]])


@dataclass(frozen=True, eq=False)
class FreeJoints:
    """Which parameters of a robot are unknown. keep (p,): those fitted; candidates (p,): those asked for;
    reasons: why the others of these are held, by their index."""

    readings: JointReadings
    model: RobotModel
    candidates: Mask
    keep: Mask
    reasons: dict[int, str]

    def variable(self, name: str) -> Variable:
        """The unknown of the problem."""
        return Variable(name, ModelManifold(self.model, self.keep), self.model.state[None])

    def errors_variable(self, name: str, rows: Sequence[int]) -> Variable:
        """What the joints did beyond the model, at the readings `rows`."""
        names = tuple(j.name for j in self.readings.chain.joints)
        labels = tuple(self.readings.ids[r] for r in rows)
        start = np.zeros((len(rows), len(names)))
        return Variable(name, Euclidean(names), start, labels=labels, words="the joints of")

    def factors(
        self, poses: str, model: str, errors: str, rows: Sequence[int], *, noise: tuple[str, str, str]
    ) -> list[Factor]:
        """Rotation and translation of the poses variable's instances, whose readings are `rows`, and the joints."""
        q = self.readings.q[list(rows)]
        slots = (poses, model, errors)
        return [
            JointRotation(self.model, slots, q, noise[0]),
            JointTranslation(self.model, slots, q, noise[1]),
            JointErrors(errors, q.shape, noise[2]),
        ]

    def at(self, state: Array) -> RobotModel:
        """The robot at the values (p,) of its unknown."""
        return self.model.with_state(state)

    def parameters(self, solution: Solution, name: str) -> tuple[IdentifiedParameter, ...]:
        """Every parameter asked for: its correction and sigma, or why it is held."""
        delta = self.model.steps_to(self.at(solution.value(name)[0]))
        sigma = np.sqrt(np.diag(solution.covariance(name)))
        return tuple(
            IdentifiedParameter(p, float(delta[k]), float(sigma[k]))
            if self.keep[k]
            else IdentifiedParameter(p, 0.0, None, self.reasons.get(k, ""))
            for k, p in enumerate(self.model.parameters)
            if self.candidates[k]
        )

    def without_weak(self, solution: Solution, name: str) -> FreeJoints:
        """The same with what came out worse than any maker's tolerance held, the worst one first; itself if none did.

        A weak parameter makes its neighbours weak: one goes at a time.
        """
        if not self.keep.any():
            return self
        sigma = np.sqrt(np.diag(solution.covariance(name)))
        limit = np.array([WEAKEST[p.unit] for p in self.model.parameters])
        ratio = np.where(self.keep, sigma / limit, 0.0)
        worst = int(np.argmax(ratio))
        if ratio[worst] <= 1:
            return self
        unit = self.model.parameters[worst].unit
        reason = f"known to {figure(float(sigma[worst]), unit)} only, worse than a maker's tolerance; held at its value"
        keep = self.keep.copy()
        keep[worst] = False
        return replace(self, keep=keep, reasons={**self.reasons, worst: reason})


def free_joints(readings: JointReadings, identify: Sequence[str]) -> FreeJoints:
    """The parameters of these groups that the robot has and these readings show.

    Args: identify, any of offsets, gear, coupling, geometry. Raises: InputError for another word.
    """
    unknown = [name for name in identify if name not in KINDS]
    if unknown:
        raise InputError(f"cannot identify {unknown[0]!r} from pictures; choose from {', '.join(KINDS)}")
    terms = joint_terms(len(readings.chain.joints), identify)
    model = RobotModel(readings.chain, np.eye(4), np.eye(4), terms)
    frames = np.array([p.group in ("base", "tool") for p in model.parameters])
    asked = np.array([p.group in identify for p in model.parameters])
    # Base and tool stand for where target and camera are: they come first, and what acts as they do is redundant.
    chosen = select(model, readings.q, frames | asked, rotations_measured=True)
    return FreeJoints(readings, model, asked, chosen.keep & asked, chosen.reasons)


class _JointFactor(Factor):
    """Robot poses against the model at the joints that were read; an edge is a pose."""

    def __init__(self, template: RobotModel, variables: tuple[str, str, str], q: Array, noise: str) -> None:
        """variables: poses, model, errors of the joints."""
        self.template, self.q = template, q
        each, once = np.arange(len(q)), np.zeros(len(q), dtype=np.int64)
        super().__init__(f"joints {noise}", variables=variables, indices=(each, once, each), dim=3, noise=noise)

    def _predicted(self, state: Array, errors: Array) -> tuple[Array, Array, Array]:
        """Poses (n, 4, 4), their derivative by the model (n, 6, p) and by the joints (n, 6, k)."""
        model = self.template.with_state(state[0])
        T, J = model.linearize(self.q, errors)
        return T, J, model.joint_jacobian(self.q, errors)


class JointRotation(_JointFactor):
    """r = log(R_i R(q_i + e_i; p)^T), radians, about the base's axes."""

    def linearize(self, *values: Array) -> tuple[Array, tuple[Array, ...]]:
        T, state, errors = values
        predicted, J, of_joints = self._predicted(state, errors)
        E = T[:, :3, :3] @ np.swapaxes(predicted[:, :3, :3], -1, -2)
        r = so3.log(E)
        of_r = so3.left_jacobian_inverse(r)
        of_pose = np.zeros((len(r), 3, 6))
        of_pose[:, :, :3] = of_r
        # R_i (exp(w) R)^T = E exp(-w) = exp(-E w) E
        return r, (of_pose, -of_r @ E @ J[:, :3], -of_r @ E @ of_joints[:, :3])


class JointTranslation(_JointFactor):
    """r = t_i - t(q_i + e_i; p), metres, along the base's axes."""

    def linearize(self, *values: Array) -> tuple[Array, tuple[Array, ...]]:
        T, state, errors = values
        predicted, J, of_joints = self._predicted(state, errors)
        of_pose = np.zeros((len(T), 3, 6))
        of_pose[:, :, 3:] = np.eye(3)
        return T[:, :3, 3] - predicted[:, :3, 3], (of_pose, -J[:, 3:], -of_joints[:, 3:])


class JointErrors(Factor):
    """r = e_i, radians and metres alike: a sliding joint that repeats to 50 micrometres does what a turning one that
    repeats to 50 microradians does a metre away."""

    def __init__(self, errors: str, shape: tuple[int, ...], noise: str) -> None:
        super().__init__(
            f"joints {noise}", variables=(errors,), indices=(np.arange(shape[0]),), dim=shape[1], noise=noise
        )

    def linearize(self, *values: Array) -> tuple[Array, tuple[Array, ...]]:
        (errors,) = values
        return errors, (np.broadcast_to(np.eye(self.dim), (len(errors), self.dim, self.dim)),)
