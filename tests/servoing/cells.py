"""A cell without pictures for the tests of servoing: a UR5e, a camera, a board of points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrant.cameras import Camera
from calibrant.data import Picture
from calibrant.detection.detection import Detection
from calibrant.geometry import se3, so3
from calibrant.robots.arms import arm
from calibrant.robots.inverse import solve_inverse
from calibrant.servoing.sight.eye import Depth, Eye, Model
from calibrant.servoing.sight.features import Features, averaged
from calibrant.servoing.sight.mounting import Mounting, Setup
from calibrant.simulate.point_cell import KinematicArm, PointCamera, tilted
from calibrant.simulate.scenes import grid

Array = NDArray[np.float64]
CAMERA = Camera.create("pinhole", {"fx": 610.0, "fy": 612.0, "cx": 322.0, "cy": 238.0}, image_size=(640, 480))
HAND = se3.make(so3.exp([0.05, -0.08, 0.3]), [0.03, -0.06, 0.04])
BOARD = grid(8, 6, 0.025)
READY = np.array([0.2, -1.4, 1.6, -1.7, -1.55, 0.3])


@dataclass(eq=False)
class Cell:
    robot: KinematicArm
    source: PointCamera
    T_wanted: Array
    mounting: Mounting

    def find(self, picture: Picture) -> Detection:
        uv = self.source.pixels(picture)
        if uv is None:
            return Detection.nothing("not all of the board is in the picture")
        return Detection(np.arange(len(uv)), uv, np.full(len(uv), max(self.source.sigma_px, 1e-3)))

    def eye(self, *, camera: Camera = CAMERA, mounting: Mounting | None = None, depth: Depth = "estimated") -> Eye:
        model = Model(np.arange(len(self.source.points)), self.source.points)
        return Eye(camera, mounting or self.mounting, self.source, self.find, model, depth)

    def taught(self, eye: Eye, pictures: int = 12) -> Features:
        """What the eye sees from the wanted pose, where the arm is when this returns."""
        seen = [eye.look() for _ in range(pictures)]
        return averaged([s for s in seen if not isinstance(s, str)])

    def place(self, T_base_gripper: Array) -> bool:
        found = solve_inverse(self.robot.chain, T_base_gripper, self.robot.q)
        if bool(found.reached):
            self.robot.q = found.q.copy()
        return bool(found.reached)

    def off(self) -> tuple[float, float]:
        """How far the gripper is from where it was taught, mm and deg."""
        mm, deg = se3.deviation(self.T_wanted, self.robot.chain.forward(self.robot.q))
        return float(mm), float(deg)

    def visible(self) -> bool:
        uv = self.source.camera.project(
            se3.apply(se3.inverse(self.source.place()) @ self.source.target(0.0), self.source.points)
        )
        return bool(np.isfinite(uv).all() and (uv > 8).all() and (uv < np.array(CAMERA.image_size) - 9).all())

    def start(self, rng: np.random.Generator, *, metres: float = 0.2, degrees: float = 30.0) -> None:
        """The arm somewhere at that distance from which the camera sees the board."""
        ready = self.robot.q.copy()
        for _ in range(1000):
            self.robot.q = ready.copy()
            if self.place(tilted(self.T_wanted, rng, metres=metres, degrees=degrees)) and self.visible():
                return
        raise AssertionError("no start found")


def make_cell(seed: int, *, setup: Setup = "eye-in-hand", sigma_px: float = 0.1, distance: float = 0.35) -> Cell:
    """The arm at the wanted pose, the camera `distance` from the board's middle."""
    rng = np.random.default_rng(seed)
    robot = KinematicArm(arm("ur5e"), READY)
    T = robot.pose()
    middle = BOARD.mean(axis=0)
    tilt = so3.exp(np.deg2rad(rng.uniform(-12, 12, 3)))
    T_camera_target = se3.make(tilt, np.array([0, 0, distance]) - tilt @ middle)
    if setup == "eye-in-hand":
        fixed = T @ HAND @ T_camera_target
        mounting = Mounting(setup, HAND)
        source = PointCamera(
            robot, CAMERA, BOARD, lambda: robot.chain.forward(robot.q) @ HAND, lambda t: fixed, rng, sigma_px
        )
    else:
        held = se3.make(so3.exp([0.1, 0.05, -0.2]), [0.02, 0.03, 0.08])
        T_base_camera = T @ held @ se3.inverse(T_camera_target)
        mounting = Mounting(setup, T_base_camera)
        source = PointCamera(
            robot, CAMERA, BOARD, lambda: T_base_camera, lambda t: robot.chain.forward(robot.q) @ held, rng, sigma_px
        )
    return Cell(robot, source, T, mounting)
