"""Inverse kinematics by damped least squares, many targets and starts at once.

    dq = J^T (J J^T + lambda^2 I)^-1 e,   e = (log(R_target R^T), (t_target - t) / length)

(Nakamura and Hanafusa 1986; Wampler 1986.) Joints are clipped to their limits after every step. Any chain will do; it
finds one solution near the start, not all of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calibrant.arrays import Array
from calibrant.geometry import se3
from calibrant.robots.chain import KinematicChain

_LENGTH = 0.3
"""Metres that weigh as much as one radian: about an arm's lever, so that both kinds of error fall alike."""

_LARGEST_STEP = 0.5
"""Radians a joint moves in one step: the linear model of a rotation is good to a tenth at half a radian."""

_RATE_DAMPING = 1e-3
"""Of rates: a direction in which the arm moves the flange by 1 mm/s a rad/s is gone at half the speed asked for."""


@dataclass(frozen=True, eq=False)
class InverseSolution:
    """q (..., n), inside the limits, and whether it reaches the target: |e| below the tolerance, (...,)."""

    q: Array
    reached: NDArray[np.bool_]


def solve_inverse(
    chain: KinematicChain,
    T_base_flange: ArrayLike,
    q_start: ArrayLike,
    *,
    iterations: int = 100,
    tolerance: float = 1e-9,
) -> InverseSolution:
    """Joint values that bring the flange to a pose.

    Args: T_base_flange (..., 4, 4) and q_start (..., n) broadcast together; tolerance of |e|, radians.
    Raises: InputError for poses that are no transforms or joints of a wrong number.
    """
    target = se3.check(T_base_flange, name="T_base_flange")
    start = chain.check(q_start)
    batch = np.broadcast_shapes(target.shape[:-2], start.shape[:-1])
    T = np.broadcast_to(target, (*batch, 4, 4)).reshape(-1, 4, 4)
    q = np.clip(
        np.broadcast_to(start, (*batch, start.shape[-1])).reshape(-1, start.shape[-1]), chain.lower, chain.upper
    )
    scale = np.array([1.0, 1.0, 1.0, 1 / _LENGTH, 1 / _LENGTH, 1 / _LENGTH])
    reached = np.zeros(len(q), dtype=bool)
    for _ in range(iterations):
        error = scale * se3.local(chain.forward(q), T)
        size = np.linalg.norm(error, axis=-1)
        reached = size < tolerance
        if np.all(reached):
            break
        J = scale[:, None] * chain.jacobian(q)
        # Damping falls with the error: slow and safe far away and near singular arms, Newton's speed at the end.
        damping = np.minimum(0.05 * size, 0.05) ** 2 + 1e-12
        gram = J @ np.swapaxes(J, -1, -2) + damping[:, None, None] * np.eye(6)
        step = np.einsum("bij,bi->bj", J, np.linalg.solve(gram, error[..., None])[..., 0])
        largest = np.abs(step).max(axis=-1, keepdims=True)
        step *= np.minimum(1.0, _LARGEST_STEP / np.maximum(largest, 1e-300))
        q = np.clip(q + np.where(reached[:, None], 0.0, step), chain.lower, chain.upper)
    return InverseSolution(q.reshape(*batch, start.shape[-1]), reached.reshape(batch))


def joint_rates(chain: KinematicChain, q: ArrayLike, twist: ArrayLike, speeds: ArrayLike) -> Array:
    """Joint velocities (n,) that move the flange with a twist, slowed down as a whole to the joints' speeds (n,).

        q' = J^T (J J^T + mu^2 I)^-1 twist

    Args: q (n,) where the arm is; twist (6,): rotation, then translation, along the base's axes, of the flange's
    origin, rad/s and m/s. Near a singular arm the motion is slow instead of wild.
    Raises: InputError for joints of a wrong number.
    Source: Nakamura and Hanafusa 1986.
    """
    J = chain.jacobian(chain.check(q))
    rates = J.T @ np.linalg.solve(J @ J.T + _RATE_DAMPING**2 * np.eye(6), np.asarray(twist, dtype=np.float64))
    return np.asarray(rates / max(1.0, float(np.max(np.abs(rates) / np.asarray(speeds, dtype=np.float64)))))
