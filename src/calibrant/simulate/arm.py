"""A camera and an arm in a cell: poses that the arm can take and in which the camera sees the board."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.errors import InputError
from calibrant.robots.chain import KinematicChain
from calibrant.robots.inverse import solve_inverse
from calibrant.simulate.scenes import Setup, gripper_poses, look_at_board

_STARTS = 6
"""Starts of the inverse kinematics for each pose; the family of arms in `robots.arms` has up to eight solutions."""

_FLOOR = 0.05
"""Metres above the base's plane that the flange keeps: it stands on the table."""


@dataclass(frozen=True, eq=False)
class ArmViews:
    """What the arm does: joint values q (n, joints), and T_base_gripper and T_camera_target (n, 4, 4) that follow."""

    q: Array
    T_base_gripper: Array
    T_camera_target: Array


def choose_views(
    chain: KinematicChain,
    camera: Camera,
    points: Array,
    n: int,
    *,
    setup: Setup,
    X: Array,
    Z: Array,
    rng: np.random.Generator,
    distance: tuple[float, float] = (0.35, 0.75),
    tilt_deg: float = 35.0,
) -> ArmViews:
    """Draw views in which every point lies in the image and that the arm reaches within its joint limits.

    Args: points (p, 3) metres, target frame; X, Z of the normal form A X B = Z (see `HandEyeScene`); distance, metres,
    of the board's middle. The flange is the gripper.
    Raises: InputError when the arm cannot reach enough of them.
    """
    kept_q: list[Array] = []
    kept_B: list[Array] = []
    for _ in range(20):  # an arm that reaches fewer than a twentieth of the views is in the wrong place
        B = look_at_board(camera, points, n, rng=rng, distance=distance, tilt_deg=tilt_deg)
        q, reached = _reachable(chain, gripper_poses(setup, X, Z, B), rng)
        kept_q += list(q[reached])
        kept_B += list(B[reached])
        if len(kept_q) >= n:
            joints, views = np.array(kept_q[:n]), np.array(kept_B[:n])
            return ArmViews(joints, gripper_poses(setup, X, Z, views), views)
    raise InputError(
        f"the arm reaches only {len(kept_q)} of the {n} poses asked for; move the board or the camera nearer to it, "
        "or ask for shorter distances"
    )


def _reachable(
    chain: KinematicChain, T_base_gripper: Array, rng: np.random.Generator
) -> tuple[Array, NDArray[np.bool_]]:
    """Joint values (n, joints) of poses (n, 4, 4) and where there are some, from several random starts."""
    middle, half = 0.5 * (chain.lower + chain.upper), 0.5 * (chain.upper - chain.lower)
    spread = np.minimum(half, np.pi / 2)  # arms work around the middle of their range
    starts = middle + spread * rng.uniform(-1, 1, size=(len(T_base_gripper), _STARTS, len(middle)))
    solution = solve_inverse(chain, T_base_gripper[:, None], starts)
    good = solution.reached & chain.within_limits(solution.q) & (T_base_gripper[:, None, 2, 3] > _FLOOR)
    first = np.argmax(good, axis=1)
    rows = np.arange(len(first))
    return solution.q[rows, first], good[rows, first]
