"""Residuals of views whose rows a shutter reads one after the other while camera or target moves.

A view's pose T_camera_target is that of its middle row. Over the readout of the whole height the target turns by omega
about the centre c of its points seen, which moves by v, at constant speed, in the target's own frame. Row y sees

    p(y) = exp(s omega) (p - c) + c + s v,     s = (y + 1/2) / height - 1/2,     r = project(theta, T p(y)) - uv,

y the row where the point was observed. It is known to the noise of a corner, which adds (motion / height) of that
noise: 1 % for 10 px a frame of 1000 rows. A turn about the centre rather than a screw about the camera, so that v alone
is how far the target is seen to move; without motion the residual is `ReprojectionFactor`'s.
"""

from __future__ import annotations

import numpy as np

from calibrant.arrays import Array, Indices
from calibrant.calibrate.reprojection.factor import StackedViews
from calibrant.calibrate.review.target_points import in_motion, readout_time
from calibrant.cameras import CameraModel
from calibrant.geometry import so3
from calibrant.optimize.factors import Factor

MOTION = "motion"
"""Variable (m, 6) of (omega, v), radians and metres over the readout."""
TURN, SHIFT = "turn", "shift"
"""Noise groups of its halves, px."""
POSES, CAMERA = "T_camera_target", "camera"


class RollingFactor(Factor):
    """Reprojection of views in motion, px; an edge is a view. Slots: T_camera_target, camera, motion."""

    def __init__(self, name: str, *, model: CameraModel, views: StackedViews, centres: Array, height: int) -> None:
        """Args: centres (m, 3), the point of each view's target that v moves, target frame, metres."""
        m = len(views.offsets) - 1
        each = np.arange(m)
        super().__init__(
            name,
            variables=(POSES, CAMERA, MOTION),
            indices=(each, np.zeros(m, dtype=np.int64), each),
            dim=2,
            noise="pixel",
            relative_sigma=views.sigma,
            whitening=views.whitening,
            row_offsets=views.offsets,
        )
        self.model, self.views = model, views
        self.edge: Indices = np.repeat(each, np.diff(views.offsets))
        self.centre = centres[self.edge]
        self.time = readout_time(views.uv[:, 1], height)

    def linearize(self, *values: Array) -> tuple[Array, tuple[Array, ...]]:
        T, parameters, motion = values
        R, t, x, s = T[self.edge, :3, :3], T[self.edge, :3, 3], motion[self.edge], self.time[:, None]
        p = in_motion(self.views.points, self.centre, x, self.time)
        rotated = (R @ p[:, :, None])[:, :, 0]
        uv, J_point, J_camera = self.model.project_with_jacobians(parameters[0], rotated + t)
        J_pose = np.concatenate([-J_point @ so3.hat(rotated), J_point], axis=-1)
        J_target = J_point @ R * s[:, :, None]
        turned = p - self.centre - s * x[:, 3:]
        J_turn = -J_target @ so3.hat(turned) @ so3.left_jacobian(s * x[:, :3])
        return uv - self.views.uv, (J_pose, J_camera, np.concatenate([J_turn, J_target], axis=-1))


class MotionPrior(Factor):
    """Views turn, or shift, at random about rest: r = px_per_rad omega or px_per_m v, px over the readout.

    A group of noise for turns and one for shifts, whose levels are estimated: a hand that holds a board turns it less
    than it shifts it, seen in pixels, and a camera on an arm as much. Without them a plane would leave the
    lens next to nothing: of the two conditions that each view has beside its pose, its motion takes both.
    """

    def __init__(self, name: str, scales: Array) -> None:
        """Args: name, TURN or SHIFT; scales (m,), px per radian or per metre."""
        self.scales, self.first = scales[:, None], 0 if name == TURN else 3
        super().__init__(name, variables=(MOTION,), indices=(np.arange(len(scales)),), dim=3, noise=name)

    def linearize(self, *values: Array) -> tuple[Array, tuple[Array, ...]]:
        (x,) = values
        J = self.scales[:, :, None] * np.eye(3, 6, k=self.first)
        return self.scales * x[:, self.first : self.first + 3], (J,)
