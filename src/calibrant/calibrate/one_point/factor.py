"""The measured point against where robot, camera and point put it, in the camera's frame.

    r_i = B_i ((1 + k) T_a_camera^-1 T_a_b_i p - q_i)

k: the depth camera's scale error, measured = (1 + k) true; B_i (d, 3): the directions that are compared, whitened or
along the sight and across it.
"""

from __future__ import annotations

import numpy as np

from calibrant.arrays import Array
from calibrant.geometry import se3, so3
from calibrant.optimize import Factor

CAMERA, POINT, SCALE = "camera", "point", "scale"


class PointFactor(Factor):
    """One edge a pose: T_a_b (n, 4, 4); q (n, 3), camera frame, metres; directions (n, d, 3)."""

    def __init__(
        self, name: str, T_a_b: Array, q: Array, directions: Array, *, noise: str, relative_sigma: Array | float = 1.0
    ) -> None:
        self.T_a_b, self.q, self.directions = T_a_b, q, directions
        one = np.zeros(len(q), dtype=np.int64)
        super().__init__(
            name,
            variables=(CAMERA, POINT, SCALE),
            indices=(one, one, one),
            dim=directions.shape[1],
            noise=noise,
            relative_sigma=relative_sigma,
        )

    def linearize(self, *values: Array) -> tuple[Array, tuple[Array, ...]]:
        """r (n, d), and its slopes by the camera (n, d, 6), the point (n, d, 3) and the scale (n, d, 1)."""
        T, p, k = values
        Rt = np.swapaxes(T[:, :3, :3], 1, 2)
        arm = se3.apply(self.T_a_b, p) - T[:, :3, 3]
        seen = (Rt @ arm[:, :, None])[:, :, 0]
        scaled = self.directions * (1 + k[:, :, None])
        r = (scaled @ seen[:, :, None] - self.directions @ self.q[:, :, None])[:, :, 0]
        by_camera = np.concatenate([Rt @ so3.hat(arm), -Rt], axis=2)
        return r, (
            scaled @ by_camera,
            scaled @ (Rt @ self.T_a_b[:, :3, :3]),
            self.directions @ seen[:, :, None],
        )
