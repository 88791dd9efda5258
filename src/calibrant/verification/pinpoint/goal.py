"""Where the hand must be so that the tip stands over a target's middle, and how that is said."""

from __future__ import annotations

import numpy as np

from calibrant.arrays import Array
from calibrant.geometry import se3, so3
from calibrant.verification.touch.placing import Placing

QUARTERS = 4
"""Turns about the approach that are tried: a square marker looks the same to the tip from each."""


def goal_above(
    T_base_target: Array, middle: Array, T_gripper_tip: Array, R_base_gripper: Array, *, hover: float
) -> tuple[Array, Array]:
    """T_base_gripper (4, 4) with the tip `hover` metres over the middle (3,) of a target, its z into it, and
    T_target_tip.

    Of the four quarter turns about the approach the one that is nearest to the hand's rotation now, R_base_gripper
    (3, 3).
    """
    up = 1.0 if T_base_target[2, 2] > 0 else -1.0
    facing = so3.exp([np.pi, 0, 0]) if up > 0 else np.eye(3)
    ways = []
    for k in range(QUARTERS):
        T_target_tip = se3.make(facing @ so3.exp([0, 0, k * np.pi / 2]), np.add(middle, (0.0, 0.0, up * hover)))
        T = T_base_target @ T_target_tip @ se3.inverse(T_gripper_tip)
        ways.append((float(np.linalg.norm(so3.log(R_base_gripper.T @ T[:3, :3]))), T, T_target_tip))
    _, T, T_target_tip = min(ways, key=lambda way: way[0])
    return T, T_target_tip


def coordinate_words(placing: Placing, middle: Array) -> str:
    """Where the target's middle is, in words: what is shown before an arm moves."""
    place, J = placing.at(middle)
    sigma = 1e3 * np.sqrt(np.diag(J @ placing.covariance @ J.T))
    parts = ", ".join(f"{a} {1e3 * v:.1f} ± {s:.1f}" for a, v, s in zip("xyz", place, sigma))
    return f"the target's middle is at {parts} mm in the base"


def pose_words(T_base_gripper: Array) -> str:
    """A pose of the flange: x, y, z in mm and its rotation vector in degrees."""
    place = ", ".join(f"{1e3 * v:.2f}" for v in T_base_gripper[:3, 3])
    turn = ", ".join(f"{v:.3f}" for v in np.rad2deg(so3.log(T_base_gripper[:3, :3])))
    return f"x, y, z {place} mm, rotation vector {turn} deg"
