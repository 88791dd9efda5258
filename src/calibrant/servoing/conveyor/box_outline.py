"""A box that stands on a belt, by the outline of its colour: place and turn on the plane, from one picture.

Its size and the plane are known, so that three numbers are left, x, y and the turn about the normal. They are those for
which the box's drawn outline, the convex hull of its projected corners, lies on the rim of the segment:

    min over (x, y, turn) of sum over rim pixels of distance(pixel, hull)^2

by Gauss-Newton. No depth is needed, which cameras do not have from as near as a gripper comes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.data import Picture
from calibrant.geometry import se3, so3
from calibrant.opencv import cv2
from calibrant.perceive.colour.ranges import ColourRange
from calibrant.perceive.colour.segments import find_segments
from calibrant.servoing.conveyor.grasp import Sighting

TURNS = 6
"""Starts over a quarter turn."""
ITERATIONS = 8
STEP = np.array([1e-4, 1e-4, 1e-3])
RIM_PX = 0.5
"""From the middle of a segment's outermost pixels to its rim."""
SHARED_PX = 0.6
"""1 sigma of what a whole outline errs by: a threshold and blur move all of it alike."""
RIM_POINTS = 150
"""Of the rim that are used: neighbours err together."""
MISFIT_PX = 3.0
"""Rms distance from which the segment is not the box: two things, or one half hidden."""
WIDE = 1e-2
"""1 sigma of what is not asked: height and tilt, metres and radians, are the plane's."""


@dataclass(frozen=True, eq=False)
class BoxOutline:
    """Finds a box: camera; colour; size (3,), metres; height_m of the plane in the base, whose z is its normal."""

    camera: Camera
    colour: ColourRange
    size: tuple[float, float, float]
    height_m: float

    def __call__(self, picture: Picture, T_base_camera: Array) -> Sighting | str:
        """The box's middle in the camera, its z along the base's; or why there is none."""
        found = find_segments(picture.colour, self.colour)
        if not found:
            return f"nothing has the colour {self.colour.spec}"
        if found[0].on_edge:
            return "the picture's border cuts the object"
        outlines, _ = cv2.findContours(found[0].mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        rim = max(outlines, key=len)[:, 0].astype(np.float64)
        rim = rim[:: max(len(rim) // RIM_POINTS, 1)]
        start = self._on_plane(found[0].centre, T_base_camera)
        if start is None:
            return "the colour is seen above the plane's horizon"
        fits = [
            self._fitted(np.array([*start, turn]), rim, T_base_camera)
            for turn in np.linspace(0, np.pi / 2, TURNS, endpoint=False)
        ]
        state, J, rms = min(fits, key=lambda f: f[2])
        if rms > MISFIT_PX:
            return f"the outline is {rms:.1f} px from the box's: is it hidden in part?"
        C3 = np.linalg.inv(J.T @ J) * (rms**2 * 4 + SHARED_PX**2 * len(rim) / 4)
        C = np.diag(np.full(6, WIDE**2))
        rows = [3, 4, 2]
        C[np.ix_(rows, rows)] = C3
        C[5, 5] = 1e-3**2
        T = se3.inverse(T_base_camera)
        turn = np.zeros((6, 6))
        turn[:3, :3] = turn[3:, 3:] = T[:3, :3]
        return Sighting(T @ self._pose(state), turn @ C @ turn.T)

    def _pose(self, state: Array) -> Array:
        return se3.make(so3.exp([0.0, 0.0, state[2]]), [state[0], state[1], self.height_m + self.size[2] / 2])

    def _on_plane(self, uv: Array, T_base_camera: Array) -> Array | None:
        ray = T_base_camera[:3, :3] @ self.camera.unproject(uv)
        way = (self.height_m + self.size[2] / 2 - T_base_camera[2, 3]) / ray[2] if ray[2] else -1.0
        return (T_base_camera[:3, 3] + way * ray)[:2] if way > 0 else None

    def _fitted(self, state: Array, rim: Array, T_base_camera: Array) -> tuple[Array, Array, float]:
        J = np.zeros((len(rim), 3))
        r = self._distances(state, rim, T_base_camera)
        for _ in range(ITERATIONS):
            J = np.stack(
                [
                    (self._distances(state + STEP * e, rim, T_base_camera) - r) / STEP[k]
                    for k, e in enumerate(np.eye(3))
                ],
                axis=1,
            )
            step = np.linalg.lstsq(J, -r, rcond=None)[0]
            state = state + np.clip(step, [-0.02, -0.02, -0.3], [0.02, 0.02, 0.3])
            r = self._distances(state, rim, T_base_camera)
        return state, J, float(np.sqrt(np.mean(r**2)))

    def _distances(self, state: Array, rim: Array, T_base_camera: Array) -> Array:
        """Signed distance of each rim pixel to the drawn outline, pixels; outside above 0."""
        corners = 0.5 * np.array(self.size) * np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
        uv = self.camera.project(se3.apply(se3.inverse(T_base_camera) @ self._pose(state), corners))
        if not np.isfinite(uv).all():
            return np.full(len(rim), 1e3)
        hull = cv2.convexHull(uv.astype(np.float32))[:, 0].astype(np.float64)
        a, b = hull, np.roll(hull, -1, axis=0)
        along = b - a
        length = np.maximum((along**2).sum(axis=1), 1e-12)
        off = rim[:, None] - a[None]
        s = np.clip((off * along).sum(axis=2) / length, 0, 1)
        near = np.linalg.norm(off - s[..., None] * along, axis=2)
        side = along[:, 0] * off[..., 1] - along[:, 1] * off[..., 0]
        area = float(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]))
        inside = np.all(side * np.sign(area) >= 0, axis=1)
        return np.where(inside, -near.min(axis=1), near.min(axis=1)) + RIM_PX
