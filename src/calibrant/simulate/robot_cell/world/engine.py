"""MuJoCo, asked for in one place."""

from __future__ import annotations

from typing import Any

import numpy as np

from calibrant.arrays import Array
from calibrant.errors import MissingExtraError
from calibrant.geometry import so3


def need_mujoco() -> Any:
    """The module. Raises: MissingExtraError naming the extra."""
    try:
        import mujoco
    except ImportError as error:
        raise MissingExtraError(
            "the robot cell needs MuJoCo, which is not installed: pip install 'calibrant[sim]'"
        ) from error
    return mujoco


def pose_of(position: Array, quaternion_wxyz: Array) -> Array:
    """MuJoCo's position and quaternion as a transform (4, 4)."""
    T = np.eye(4)
    T[:3, :3] = so3.from_quaternion_wxyz(quaternion_wxyz)
    T[:3, 3] = position
    return T
