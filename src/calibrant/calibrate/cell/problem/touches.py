"""Touches: poses of a robot at which the tip of its tool is on a point, of a target or one that nobody knows.

    r_i = T_root_base (R_i p + t_i) - T_root_target q_i,     or     - c for a point that is touched again and again,

p the tip in the gripper, R_i, t_i the pose as the robot said it. The noise, one level a tool, holds what the robot and
the hand that guided it did wrong, alike along all axes, as `calibrate.tool.tip` has it: a touch is at a pose of its
own, whose error is in no picture.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.cell.problem.groups import ONLY_ROBOT
from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.optimize.factors import Factor

TIP, POINT = "tip", "point"


@dataclass(frozen=True, eq=False)
class Touches:
    """Poses of a robot, by their ids (n,), at which the tip of its tool is on points.

    target with points (n, 3): the places in the frame of that target, metres, that were touched, as corners of a board;
    without: one point that stands still and that nobody knows, by its name `point`. tool: the name of the tip.

        >>> import calibrant as cb
        >>> cb.Touches(("7", "8", "9", "10"))
        Touches(4 of point with tip)
    """

    ids: tuple[str, ...]
    robot: str = ONLY_ROBOT
    tool: str = TIP
    point: str = POINT
    target: str = ""
    points: Array = field(default_factory=lambda: np.zeros((0, 3)))

    def __post_init__(self) -> None:
        ids, points = tuple(self.ids), np.asarray(self.points, dtype=np.float64).reshape(-1, 3)
        object.__setattr__(self, "ids", ids)
        object.__setattr__(self, "points", points)
        if not ids or len(set(ids)) < len(ids):
            raise InputError(f"touches with {self.tool}: give the id of one pose a touch, each once; got {len(ids)}")
        if bool(self.target) != bool(len(points)) or len(points) not in (0, len(ids)):
            raise InputError(
                f"touches with {self.tool}: {len(ids)} touches and {len(points)} points of target {self.target!r}; a "
                "target goes with the place of every touch in its frame, metres, a point that nobody knows with neither"
            )
        if not np.all(np.isfinite(points)):
            raise InputError(f"touches with {self.tool}: points of target {self.target!r} are not finite")

    def __repr__(self) -> str:
        return f"Touches({len(self.ids)} of {self.target or self.point} with {self.tool})"

    @property
    def places(self) -> Array:
        """q (n, 3), in the frame of what is touched."""
        return self.points if self.target else np.zeros((len(self.ids), 3))


class TouchFactor(Factor):
    """The tip less what it touches, in the root, metres.

    said (n, 4, 4): T_base_gripper; places (n, 3): q. Variables: the tip and what is touched, each a frame; base, the
    robot's base in the root, None where it is the root; scale, the target's size less 1, None where it is as given.
    """

    def __init__(
        self,
        name: str,
        said: Array,
        places: Array,
        *,
        tip: str,
        touched: str,
        noise: str,
        base: str | None = None,
        scale: str | None = None,
    ) -> None:
        self.said, self.places, self.base, self.scale = said, places, base, scale
        variables = [v for v in (tip, touched, base, scale) if v is not None]
        once = np.zeros(len(said), dtype=np.int64)
        super().__init__(name, variables=variables, indices=[once] * len(variables), dim=3, noise=noise)

    def linearize(self, *values: Array) -> tuple[Array, tuple[Array, ...]]:
        tip, touched, *more = values
        n = len(self.said)
        B = more.pop(0) if self.base is not None else np.broadcast_to(np.eye(4), (n, 4, 4))
        size = 1 + more.pop(0) if self.scale is not None else 1.0
        arm = B[:, :3, :3] @ se3.apply(self.said, tip[:, :3, 3])[..., None]
        on = touched[:, :3, :3] @ (size * self.places)[..., None]
        r = arm[..., 0] + B[:, :3, 3] - on[..., 0] - touched[:, :3, 3]
        of_tip, of_touched = np.zeros((n, 3, 6)), np.zeros((n, 3, 6))
        of_tip[:, :, 3:] = B[:, :3, :3] @ self.said[:, :3, :3]
        of_touched[:, :, :3], of_touched[:, :, 3:] = so3.hat(on[..., 0]), -np.eye(3)
        J = [of_tip, of_touched]
        if self.base is not None:
            of_base = np.zeros((n, 3, 6))
            of_base[:, :, :3], of_base[:, :, 3:] = -so3.hat(arm[..., 0]), np.eye(3)
            J.append(of_base)
        if self.scale is not None:
            J.append(-touched[:, :3, :3] @ self.places[..., None])
        return r, tuple(J)


def touch_name(k: int) -> str:
    """Name of the factor of the k-th list of touches."""
    return f"touches {k}"


def touch_group(tool: str) -> str:
    """Noise group of what is touched with a tool."""
    return f"touch {tool}"
