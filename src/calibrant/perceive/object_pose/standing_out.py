"""Segments without a colour: what stands out of the table by its depth."""

from __future__ import annotations

import numpy as np

from calibrant.perceive.colour.segments import Segment, cleaned, segments
from calibrant.perceive.object_pose.seen import Scene
from calibrant.perceive.registered_depth.planes import find_plane

LEAST_SIGMAS = 5.0
LEAST_M = 0.0015
"""A plate thinner than this is lost in what tables are not flat by."""


def standing_out(scene: Scene) -> list[Segment]:
    """Parts of the colour picture whose depth stands out of the largest plane, largest first.

    Raises: RefusedError where the depth shows no plane.
    """
    depth = scene.registered.depth
    table = find_plane(depth, scene.rays, np.isfinite(depth), noise=scene.noise)
    with np.errstate(invalid="ignore"):
        height = table.height(scene.rays * depth[..., None])
        out = height > np.maximum(LEAST_SIGMAS * table.noise.sigma_z(depth), LEAST_M)
    height_px, width_px = scene.registered.z.shape
    mask = np.zeros(height_px * width_px, dtype=np.bool_)
    lands = scene.lands[out & (scene.lands >= 0)]
    mask[lands] = True
    return segments(cleaned(mask.reshape(height_px, width_px)))
