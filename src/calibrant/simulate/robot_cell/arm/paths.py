"""Where the arm can go: inverse kinematics for one pose, joint paths and straight lines, the table as a floor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array
from calibrant.errors import RefusedError
from calibrant.geometry import se3, so3
from calibrant.robots.chain import KinematicChain
from calibrant.robots.inverse import solve_inverse
from calibrant.robots.links import LinkChain

_RANDOM_STARTS = 24
"""Besides where the arm is and its rest position; the arms here have at most eight families of solutions."""
_SAMPLES = 40
"""Places along a path that are looked at: a path of a radian is then known every 1.5 degrees."""
_TOUCH_M = 0.0005
"""The tip may be this far under the plane: it touches the table, and the plane's place is known to about as much."""
_FIRST_FREE = 3
"""The first link whose joint may come near the table; those before stand on the base."""
_LINK_M = 0.08
"""Of a joint's middle over the table: its radius and a little."""
_LIFT_M = 0.25
"""Over the table when the direct way would go below it."""


@dataclass(frozen=True, eq=False)
class Workspace:
    """What the controller keeps above the table (z = table_z): the tip, the corners of fingers and hand, the links."""

    chain: LinkChain
    tip_m: float
    table_z: float

    def below_table(self, T_base_gripper: Array) -> str | None:
        """Words on what would be below the table at a pose (4, 4); None where nothing is."""
        z = self._heights(T_base_gripper)
        lowest = int(np.argmin(z))
        if z[lowest] >= self.table_z - _TOUCH_M:
            return None
        what = "the tip" if lowest == 0 else "the hand"
        return f"{what} would be {1e3 * (self.table_z - z[lowest]):.1f} mm below the table"

    def first_below(self, path: Array) -> str | None:
        """The same along joint values (m, n): at the first place where something would be."""
        frames = self.chain.link_frames(path)
        for T in frames[:, -1] @ self.chain.links[-1]:
            low = self.below_table(T)
            if low is not None:
                return low
        links = frames[:, _FIRST_FREE:, 2, 3].min(initial=np.inf)
        return None if links > self.table_z + _LINK_M else "a link of the arm would touch the table"

    def path_over_table(self, start: Array, goal: Array, home: Array) -> Array:
        """Joint values from start to goal, straight or over a place above the table.

        Raises: RefusedError when both would go below it.
        """
        direct = joint_path(start, goal)
        if self.first_below(direct) is None:
            return direct
        over = []
        for q in (start, goal):
            T = np.array(self.chain.forward(q))
            T[2, 3] = max(T[2, 3], self.table_z + _LIFT_M + self.tip_m)
            found = solve_inverse(self.chain, T, np.stack([q, home]))
            over.append(found.q[int(np.argmax(found.reached))])
        path = np.concatenate(
            [joint_path(start, over[0]), joint_path(over[0], over[1])[1:], joint_path(over[1], goal)[1:]]
        )
        low = self.first_below(path)
        if low is not None:
            raise RefusedError(
                f"on the way {low}, and no way over the table; nothing has moved. Go there in smaller steps"
            )
        return path

    def _heights(self, T_base_gripper: Array) -> Array:
        points = [[0.0, 0.0, self.tip_m]]
        points += [[x, y, min(self.tip_m, 0.112)] for x in (-0.009, 0.009) for y in (-0.018, 0.018)]
        points += [[x, y, 0.066] for x in (-0.02, 0.02) for y in (-0.095, 0.095)]
        return se3.apply(T_base_gripper, np.array(points))[:, 2]


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
