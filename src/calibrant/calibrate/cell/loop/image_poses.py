"""Do the images' target poses err by more than the scatter of their points says?

A lens that the model does not follow, a board that is not flat and marks that are found off their middle move all
points of an image together: the residuals of the image stay small, and its target pose is wrong. In the joint
refinement such an error has nowhere to go but the robot's poses, whose noise it then raises. The loop can tell the two
apart, by the lever arm from flange to target and by the shape of the errors: those of an image are mostly tilt and
distance, those of a robot favour no axis. With C_i = sum_k theta_k V_ik of `loop_noise`, theta_3 the variance of the
images' share,

    evidence = 2 (ln L(theta_3 free) - ln L(theta_3 = sigma_px^2))

is 0 or chi-square with one degree of freedom, with even odds, when points scatter independently (Self and Liang,
"Asymptotic properties of maximum likelihood estimators under nonstandard conditions", 1987).

The share is found and said; it does not enter the refinement as a third level. As independent noise of each image it
would make the camera's stated sigma far too small, for errors by lens and board repeat from image to image: with a
given lens whose k1 is off by 0.02, errors are 3.5 to 5 times their sigma when the share is its own level, and 1.1 to
1.6 times when it is the robot's, whose errors spread more.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibrant.calibrate.cell.loop.noise import LoopNoise
from calibrant.calibrate.cell.loop.target_size import loop_of_views
from calibrant.calibrate.cell.problem.views import HandEyeViews
from calibrant.calibrate.solvers.setup import Setup
from calibrant.cameras import Camera

EVIDENT = 9.55
"""Evidence that points alone give in one of a thousand sets."""
WORTH_SAYING = 1.5
"""Levels from one and a half of the scatter on, twice the variance: less hardly moves weights and sigmas."""
SHOWS_SIGMAS = 3.0
"""An excess of this many of its own sigma shows: where the evidence reaches its limit."""


@dataclass(frozen=True)
class ImagePoses:
    """px: the noise of points that the errors of the target poses amount to; scatter_px: what the points themselves
    show; evidence: see the module; shows_px: the least level that these views would show; robot_mm and robot_deg: what
    is left for the robot."""

    px: float
    scatter_px: float
    evidence: float
    shows_px: float
    robot_mm: float
    robot_deg: float

    @property
    def evident(self) -> bool:
        """Whether the images err by more than their points scatter, beyond chance and enough to matter."""
        return self.evidence > EVIDENT and self.px > WORTH_SAYING * self.scatter_px


def image_poses(
    setup: Setup, data: HandEyeViews, size: LoopNoise | None, *, camera: Camera | None = None
) -> ImagePoses | None:
    """What the loop says of the images' share; None without images, or where the loop tells nothing (`target_size`).

    size: the loop with the target's scale and the images' level free, over the views `data.use`.
    """
    if data.views is None or size is None:
        return None
    alone = loop_of_views(setup, data, size.X, used=data.use, camera=camera, held_px=data.sigma_px)
    return ImagePoses(
        size.target,
        data.sigma_px,
        max(2 * (size.log_likelihood - alone.log_likelihood), 0.0),
        data.sigma_px * float(np.sqrt(1 + SHOWS_SIGMAS * alone.target_spread)),
        1e3 * size.flange_translation,
        float(np.rad2deg(size.flange_rotation)),
    )
