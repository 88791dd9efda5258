"""Where a projector starts: the pinhole that lights the boards' corners as the camera places them.

One board gives eight equations, and a projector whose lens is shifted has no centre to begin from. But the camera,
calibrated from the same boards, says where every corner is. All boards' corners together are points in space that one
projector lights: the direct linear transform gives its focal lengths, its principal point wherever that is, and its
place.
"""

from __future__ import annotations

import numpy as np

from calibrant.calibrate.classical.dlt import calibrate_dlt
from calibrant.calibrate.classical.refusals import Degenerate
from calibrant.calibrate.pose.target_poses import target_poses
from calibrant.cameras import Camera
from calibrant.data import View
from calibrant.errors import RefusedError
from calibrant.geometry import se3

FEWEST_BOARDS = 2
"""Two boards that are not in one plane are points with depth."""


def projector_start(
    camera: Camera, seen: tuple[View, ...], lit: tuple[View, ...], projector_size: tuple[int, int]
) -> Camera:
    """A brown projector without distortion from views of the camera and the projector's of the same moments.

    Raises: RefusedError where the boards do not determine it, and why.
    """
    poses = target_poses(camera, seen).T_camera_target
    at = {v.moment: T for v, T in zip(seen, poses)}
    shared = [v for v in lit if v.moment in at]
    if len(shared) < FEWEST_BOARDS:
        raise RefusedError(
            f"{len(shared)} boards were decoded in camera and projector; a projector needs {FEWEST_BOARDS} at least, "
            "tilted and at several distances, and ten make it certain"
        )
    points = np.concatenate([se3.apply(at[v.moment], v.points) for v in shared])
    try:
        found = calibrate_dlt(points, np.concatenate([v.uv for v in shared]), image_size=projector_size).camera
    except Degenerate as reason:
        raise RefusedError(
            f"the boards do not determine the projector: {reason}. Tilt them differently, and hold them nearer and "
            "farther"
        ) from reason
    given = found.parameters
    lens = dict.fromkeys(("k1", "k2", "p1", "p2", "k3"), 0.0)
    return Camera.create("brown", {n: given[n] for n in ("fx", "fy", "cx", "cy")} | lens, image_size=projector_size)
