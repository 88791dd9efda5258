"""Joints that a controller tells against another one, as J3 against the ground (Fanuc), found by what they explain."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibrant.calibrate.kinematics.model import RobotModel
from calibrant.calibrate.kinematics.problem import model_errors
from calibrant.calibrate.kinematics.start import base_and_tool
from calibrant.data.joint_measurements import JointMeasurements

_EXPLAINED = 0.1
"""A coupling of the wrong joints leaves the error as it was; the right one leaves that of the arm's geometry."""


@dataclass(frozen=True)
class CoupledJoints:
    """Joint `joint` is told with `sign` times joint `by` in it; error_mm: what is left, RMS, when that is taken out."""

    joint: int
    by: int
    sign: int
    error_mm: float


def coupled_joints(model: RobotModel, measurements: JointMeasurements) -> CoupledJoints | None:
    """The coupling of one joint to an earlier one that explains most of what is left, or None.

    Each pair and sign is tried on the nominal geometry, base and tool fitted anew:

        q_joint = told_joint - sign told_by
    """
    left, found = model_errors(model, measurements).rms_mm, None
    for joint in range(1, measurements.joints.shape[1]):
        for by in range(joint):
            for sign in (1, -1):
                told = np.array(measurements.joints)
                told[:, joint] -= sign * told[:, by]
                tried = replace(measurements, joints=told)
                base, tool = base_and_tool(model.chain, tried, hold_base=False, hold_tool=False)
                error = model_errors(replace(model, T_world_base=base, T_flange_tool=tool), tried).rms_mm
                if error < _EXPLAINED * left:
                    left, found = error / _EXPLAINED, CoupledJoints(joint, by, sign, error)
    return found
