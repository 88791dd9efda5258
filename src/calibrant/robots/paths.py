"""Ways of an arm in its joints: the joints of a pose near those it has, even motions, straight lines of the flange."""

from __future__ import annotations

import numpy as np

from calibrant.arrays import Array
from calibrant.errors import RefusedError
from calibrant.geometry import se3, so3
from calibrant.robots.chain import KinematicChain
from calibrant.robots.inverse import solve_inverse

_RANDOM_STARTS = 24
"""Besides where the arm is and its rest position; the arms here have at most eight families of solutions."""
_SAMPLES = 40
"""Places along a path that are looked at: a path of a radian is then known every 1.5 degrees."""


def joint_path(start: Array, goal: Array) -> Array:
    """All joints evenly from start to goal, (m, n)."""
    return start + np.linspace(0, 1, _SAMPLES)[:, None] * (goal - start)


def line_path(chain: KinematicChain, start: Array, T_goal: Array) -> Array:
    """Joint values (m, n) along the flange's straight line, turning evenly. Raises: RefusedError where it cannot be."""
    T_start = chain.forward(start)
    turn = so3.log(T_start[:3, :3].T @ T_goal[:3, :3])
    length = float(np.linalg.norm(T_goal[:3, 3] - T_start[:3, 3]))
    count = max(2, int(np.ceil(max(length / 0.005, float(np.linalg.norm(turn)) / 0.03))) + 1)
    path = [np.array(start)]
    for s in np.linspace(0, 1, count)[1:]:
        T = se3.make(T_start[:3, :3] @ so3.exp(s * turn), (1 - s) * T_start[:3, 3] + s * T_goal[:3, 3])
        found = solve_inverse(chain, T, path[-1])
        jump = float(np.abs(found.q - path[-1]).max())
        if not found.reached or jump > 0.35:  # a step of 5 mm that turns a joint by 20 degrees passes a singular place
            raise RefusedError(
                f"the straight line to this pose ends after {1e3 * s * length:.0f} of {1e3 * length:.0f} mm: a joint "
                "would leave its range or the arm is stretched; nothing has moved. Use move_to, or another start"
            )
        path.append(found.q)
    return np.array(path)


def nearest_joints(chain: KinematicChain, T: Array, now: Array, home: Array) -> Array:
    """Joints (n,) of a pose: of the solutions from several starts the one with the shortest way that keeps clear of the
    joints' ends. Raises: RefusedError when none is found."""
    found = solve_inverse(chain, T, np.stack([now, home]))
    if not found.reached.any():
        rng = np.random.default_rng(0)
        low, high = np.maximum(chain.lower, home - np.pi / 2), np.minimum(chain.upper, home + np.pi / 2)
        found = solve_inverse(chain, T, rng.uniform(low, high, (_RANDOM_STARTS, len(home))))
    if not found.reached.any():
        x, y, z = 1e3 * T[:3, 3]
        raise RefusedError(
            f"the arm cannot reach the flange pose at ({x:.0f}, {y:.0f}, {z:.0f}) mm with this orientation: no joint "
            "values within the limits; nothing has moved. Bring the target nearer, or turn the tool"
        )
    q = found.q[found.reached]
    way = np.asarray(np.abs(q - now).max(axis=1))
    clear = np.asarray(np.minimum(q - chain.lower, chain.upper - q).min(axis=1))
    return np.asarray(q[int(np.argmin(way + np.maximum(0.0, 0.3 - clear) * 5))])
