"""2 1/2-D control: one point of the picture and its depth for the place, the pose for the turn alone.

    e = (x - x*, y - y*, log(Z / Z*), log R),   R = R_wanted_camera

The Jacobian is triangular, the point goes straight in the picture and the turn straight in space, so that the target
stays in view (Malis, Chaumette and Boudet 1999, "2 1/2 D visual servoing"). The point is the one nearest to the middle
of those wanted. The depth is the camera's where it measures it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array
from calibrant.geometry import so3
from calibrant.servoing.laws.law import ALL, Pull
from calibrant.servoing.laws.position_based import wanted_from_camera
from calibrant.servoing.sight.features import Features
from calibrant.servoing.sight.interaction import log_depth_row, point_rows, turn_rows


@dataclass(frozen=True)
class Hybrid:
    """A target whose points are known."""

    name: str = "hybrid"
    least: int = 4
    model: bool = True

    def subspace(self, R_camera_gripper: Array) -> Array:
        """All twists."""
        return ALL

    def pull(self, seen: Features, wanted: Features, R_camera_gripper: Array) -> Pull:
        """See the module. Raises: InputError for features without a pose."""
        R = wanted_from_camera(seen, wanted)[:3, :3]
        middle = wanted.xy.mean(axis=0)
        i = int(np.argmin(np.linalg.norm(wanted.xy - middle, axis=1)))
        ratio = float(np.log(seen.depth[i] / wanted.depth[i]))
        error = np.concatenate([seen.xy[i] - wanted.xy[i], [ratio], so3.log(R)])
        rows = point_rows(seen.xy[i : i + 1], seen.depth[i : i + 1])
        J = np.concatenate([rows, log_depth_row(seen.xy[i], float(seen.depth[i]))[None], turn_rows(R)])
        return Pull(error, J, ALL)
