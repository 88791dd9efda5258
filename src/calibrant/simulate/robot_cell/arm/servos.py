"""Position servos of joints: torque = stiffness * (command - position) - damping * speed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibrant.arrays import Array

if TYPE_CHECKING:
    import mujoco

_STIFFNESS = 8000.0
"""N m / rad: 1 N m of load bends a joint by 0.1 mrad before the controller's integral part takes it back."""
_DAMPING = 250.0
"""N m s / rad: about critical for the inertia of a stretched arm."""


def add_servo(world: mujoco.MjSpec, joint: str, name: str) -> None:
    """The servo `name` of a joint of an arm."""
    servo = _position(world, joint, name, _STIFFNESS, _DAMPING)
    servo.ctrllimited = False


def add_finger_servo(world: mujoco.MjSpec, joint: str, *, force_n: float) -> None:
    """The servo of a finger, called like its joint, no stronger than this."""
    servo = _position(world, joint, joint, 4000.0, 60.0)
    servo.forcelimited, servo.forcerange = True, np.array([-force_n, force_n])


def servo_lag_s() -> float:
    """Damping over stiffness: a servo trails its command by this time at constant speed; the controller leads by it."""
    return _DAMPING / _STIFFNESS


def _position(world: mujoco.MjSpec, joint: str, name: str, stiffness: float, damping: float) -> mujoco.MjsActuator:
    import mujoco

    servo = world.add_actuator(name=name, trntype=mujoco.mjtTrn.mjTRN_JOINT, target=joint)
    servo.gaintype, servo.biastype = mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_AFFINE
    servo.gainprm, servo.biasprm = _row(stiffness), _row(0.0, -stiffness, -damping)
    return servo


def _row(*values: float) -> Array:
    """MuJoCo's row of ten numbers."""
    row = np.zeros(10)
    row[: len(values)] = values
    return row
