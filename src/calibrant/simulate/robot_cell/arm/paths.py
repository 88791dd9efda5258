"""Where the arm can go: the table as a floor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array
from calibrant.errors import RefusedError
from calibrant.geometry import se3
from calibrant.robots.inverse import solve_inverse
from calibrant.robots.links import LinkChain
from calibrant.robots.paths import joint_path

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
