"""Compensation: the joint readings that bring the real tool to a wanted pose (document 002, P5, the fourth step)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array
from calibrant.calibrate.kinematics.model import RobotModel
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3
from calibrant.robots.inverse import solve_inverse

_ROUNDS = 50
_SETTLED = 1e-12
"""Radians and metres; each round shrinks the rest by the size of the joints' errors, a thousandth or so."""


@dataclass(frozen=True, eq=False)
class Compensation:
    """joints (n, k): the readings to command; change (n, k): from the nominal ones, radians and metres.

    off_mm (n,): how far from the wanted position the tool would be without the change.
    """

    joints: Array
    change: Array
    off_mm: Array


def compensate_poses(model: RobotModel, T_base_flange: ArrayLike, q_start: ArrayLike) -> Array:
    """Joint readings (n, k) that bring the real flange to T_base_flange (n, 4, 4), from near q_start (n, k).

    Raises: RefusedError naming the first pose that the arm does not reach within its limits from there.
    """
    target = se3.check(T_base_flange, name="T_base_flange").reshape(-1, 4, 4)
    start = np.broadcast_to(model.chain.check(q_start), (len(target), len(model.chain.joints)))
    solution = solve_inverse(model.chain, target, start)
    if not solution.reached.all():
        i = int(np.flatnonzero(~solution.reached)[0])
        raise RefusedError(
            f"pose {i}: the corrected arm does not reach it within its joint limits from its starting joints; move it "
            "away from limits and singular postures, or start closer"
        )
    q = solution.q
    for _ in range(_ROUNDS):
        # q + B(q) theta = x by repeated substitution: B theta is small and smooth.
        step = solution.q - model.true_joints(q)
        q = q + step
        if np.abs(step).max() < _SETTLED:
            break
    return q


def compensate_joints(model: RobotModel, nominal: RobotModel, q: ArrayLike) -> Compensation:
    """Readings that bring the real flange to where the nominal robot believes to be at q (n, k)."""
    values = np.atleast_2d(nominal.chain.check(q))
    count = len(model.chain.joints)
    if count < 6:
        raise InputError(
            f"an arm with {count} joints cannot correct its pose in all six directions; plan with the corrected robot "
            "file instead of compensated commands"
        )
    wanted = nominal.chain.forward(values)
    joints = compensate_poses(model, wanted, values)
    return Compensation(joints, joints - values, _off(model, wanted, values))


def _off(model: RobotModel, wanted: Array, q: Array) -> Array:
    real = model.chain.forward(model.true_joints(q))
    tool = model.T_flange_tool[:3, 3]
    return 1e3 * np.linalg.norm(se3.apply(real, tool) - se3.apply(wanted, tool), axis=1)
