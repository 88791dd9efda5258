"""Image-based control: the features' own way to where they are wanted.

    e = s - s*,   J = (L(s, Z) + L(s*, Z*)) / 2

The mean of both interaction matrices takes large turns about the line of sight without the camera's retreat that either
alone makes (Malis 2004, "Improving vision-based control using efficient second-order minimization techniques"). Errors
of the calibration change the way, not where it ends.
"""

from __future__ import annotations

from dataclasses import dataclass

from calibrant.arrays import Array
from calibrant.servoing.laws.law import ALL, Pull
from calibrant.servoing.sight.features import Features
from calibrant.servoing.sight.interaction import point_rows


@dataclass(frozen=True)
class ImageBased:
    """Points of the picture, weighted by their sigma."""

    name: str = "image"
    least: int = 4
    model: bool = False

    def subspace(self, R_camera_gripper: Array) -> Array:
        """All twists."""
        return ALL

    def pull(self, seen: Features, wanted: Features, R_camera_gripper: Array) -> Pull:
        """See the module."""
        return image_pull(seen, wanted, ALL)


def image_pull(seen: Features, wanted: Features, subspace: Array) -> Pull:
    """The pull of points in the picture on the twists of a subspace (6, m)."""
    W = wanted.weights
    L = 0.5 * (point_rows(seen.xy, seen.depth) + point_rows(wanted.xy, wanted.depth))
    return Pull(W @ (seen.xy - wanted.xy).ravel(), W @ L, subspace)
