"""A belt in the cell without pictures: a cube with a tag on its top that is carried along and turns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from tests.servoing.cells import CAMERA

from calibrant.data import Picture
from calibrant.detection.detection import Detection
from calibrant.geometry import se3, so3
from calibrant.robots.arms import arm
from calibrant.robots.inverse import solve_inverse
from calibrant.servoing.conveyor.sighting import TargetSight
from calibrant.servoing.sight.eye import Model
from calibrant.servoing.sight.mounting import Mounting
from calibrant.simulate.point_cell import KinematicArm, PointCamera

Array = NDArray[np.float64]
SIDE = 0.015
TAG = np.array([[-SIDE, -SIDE, 0], [SIDE, -SIDE, 0], [SIDE, SIDE, 0], [-SIDE, SIDE, 0]])
CUBE = 0.04
DOWN = so3.exp([np.pi, 0.0, 0.0])
HAND = se3.make(so3.exp([0, 0, np.pi / 2]), [0.0318, -0.0362, 0.0632])
T_OBJECT_GRIPPER = se3.make(DOWN, [0.0, 0.0, 0.103])
"""The flange looks down on the cube's middle, which is between the pads."""
T_TARGET_OBJECT = se3.make(DOWN, [0.0, 0.0, CUBE / 2])
"""The tag lies on the top, its z into the cube."""
START = np.array([0.55, -0.25, 0.30])
ALONG_M, ACROSS_M, YAW = 0.018, 0.012, np.deg2rad(12)
"""How far off the fingers (78 mm open) still close on a cube of 40 mm, and turned."""


@dataclass(eq=False)
class Belt:
    robot: KinematicArm
    source: PointCamera
    find: TargetSight
    mounting: Mounting
    velocity: Array
    turn: float
    first: Array

    def object_at(self, t: float) -> Array:
        return se3.make(so3.exp([0, 0, self.turn * t]) @ self.first[:3, :3], self.first[:3, 3] + self.velocity * t)


def make_belt(seed: int, *, speed: float, turn: float, sigma_px: float = 0.1, latency_s: float = 0.0) -> Belt:
    """The arm waits above the belt (along +y), the cube comes from before it."""
    rng = np.random.default_rng(seed)
    chain = arm("ur5e")
    T = se3.make(DOWN, [0.45, -0.20, 0.34])
    found = solve_inverse(chain, T, np.array([0.0, -1.2, 1.6, -2.0, -1.57, 0.0]))
    assert bool(found.reached)
    q = found.q.copy()
    q[5] = (q[5] + np.pi) % (2 * np.pi) - np.pi  # with room to turn to both sides
    robot = KinematicArm(chain, q)
    heading = rng.uniform(-0.3, 0.3)
    velocity = speed * np.array([np.sin(heading), np.cos(heading), 0.0])
    seen = (T @ HAND)[:3, 3]
    place = np.array([seen[0] + rng.uniform(-0.03, 0.03), seen[1] + rng.uniform(-0.05, 0.0) - 0.35 * speed, CUBE / 2])
    first = se3.make(so3.exp([0, 0, rng.uniform(-0.6, 0.6)]), place)

    def moving(t: float) -> Array:
        return se3.make(so3.exp([0, 0, turn * t]) @ first[:3, :3], first[:3, 3] + velocity * t)

    to_target = se3.inverse(T_TARGET_OBJECT)
    source = PointCamera(
        robot, CAMERA, TAG, lambda: robot.chain.forward(robot.q) @ HAND, lambda t: moving(t) @ to_target, rng,
        sigma_px=sigma_px, latency_s=latency_s,
    )  # fmt: skip

    def find(picture: Picture) -> Detection:
        uv = source.pixels(picture)
        if uv is None:
            return Detection.nothing("no tag in the picture")
        return Detection(np.arange(4), uv, np.full(4, sigma_px))

    def closes_on(T_base_gripper: Array, time_s: float) -> bool:
        off = se3.inverse(moving(time_s) @ T_OBJECT_GRIPPER) @ T_base_gripper
        yaw = np.arctan2(off[1, 0], off[0, 0])
        yaw = (yaw + np.pi / 4) % (np.pi / 2) - np.pi / 4
        x, y, z = np.abs(off[:3, 3])
        return bool(y < ALONG_M and x < ACROSS_M and z < 0.012 and abs(yaw) < YAW)

    robot.holds = closes_on
    sight = TargetSight(
        CAMERA, find, Model(np.arange(4), TAG), T_TARGET_OBJECT,
        into=np.array([0.0, 0.0, -1.0]),
    )  # fmt: skip
    return Belt(robot, source, sight, Mounting("eye-in-hand", HAND), velocity, turn, first)
