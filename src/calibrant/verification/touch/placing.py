"""Where a camera says a target is in the robot's base, with every part of its uncertainty.

    T_base_target = A X T_camera_target (in the hand),    X T_camera_target (beside the robot)

    C = [M_X, M_T D] C_(X, lens) [M_X, M_T D]^T + M_T C_points M_T^T + M_A C_robot M_A^T

M are the maps of the chain's links, D what the lens moves a fitted pose by. The first term is the calibration's, the
same at every look; the others are drawn anew.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.reprojection.links import Link, link_maps, product
from calibrant.calibrate.tool.self_visibility import moved_by_camera
from calibrant.cameras import Camera
from calibrant.geometry import se3, so3
from calibrant.verification.touch.errors import Touch
from calibrant.verification.unchanged.robot_noise import RobotSide
from calibrant.verification.watch.placed import PlacedView


@dataclass(frozen=True, eq=False)
class Placing:
    """T_base_target (4, 4) and the covariances (6, 6) of what the calibration, the picture and the robot's pose err by.

    of_move (6, 6): what an error of the camera's pose X does to it.
    """

    name: str
    T_base_target: Array
    calibration: Array
    picture: Array
    robot: Array
    of_move: Array

    @property
    def covariance(self) -> Array:
        """All of it, (6, 6)."""
        return np.asarray(self.calibration + self.picture + self.robot)

    def at(self, point: Array) -> tuple[Array, Array]:
        """A point (3,) of the target in the base, and the map (3, 6) from errors of the pose to its own."""
        arm = self.T_base_target[:3, :3] @ point
        return arm + self.T_base_target[:3, 3], np.concatenate([-so3.hat(arm), np.eye(3)], axis=1)


def robot_covariance(side: RobotSide) -> Array:
    """Covariance (6, 6) of a robot's pose, with what its arm errs by."""
    metres = 0.0 if side.arm is None else side.arm.metres
    return np.diag(np.repeat([side.rotation**2, side.translation**2 + metres**2], 3))


def placed_in_base(camera: Camera, side: RobotSide, placed: PlacedView, T_base_gripper: Array | None) -> Placing:
    """A picture's target in the base. Args: T_base_gripper (4, 4), not used by a camera beside the robot."""
    once = np.zeros(1, dtype=np.int64)
    carried = side.in_hand and T_base_gripper is not None
    A = np.eye(4) if T_base_gripper is None or not carried else T_base_gripper
    links = [Link("A", once), Link("X", once), Link("T", once)]
    values = [A[None], side.X[None], placed.T_camera_target[None]]
    T = product(links, values)[0]
    of_A, of_X, of_T = (M[0] for M in link_maps(links, values))
    lens = moved_by_camera(camera, placed.view, placed.T_camera_target)
    J = np.concatenate([of_X, np.zeros((6, 6)), of_T @ lens], axis=1)
    calibration = J @ side.covariance @ J.T
    robot = of_A @ robot_covariance(side) @ of_A.T if carried else np.zeros((6, 6))
    return Placing(placed.view.id, T, calibration, of_T @ placed.covariance @ of_T.T, robot, of_X)


def at_touch(side: RobotSide, tip: Array, T_base_gripper: Array) -> Array:
    """Covariance (6, 6) of a tip's pose that the robot's own error makes where it touches. Args: tip (3,), gripper."""
    arm = T_base_gripper[:3, :3] @ tip
    M = np.eye(6)
    M[3:, :3] = -so3.hat(arm)
    return np.asarray(M @ robot_covariance(side) @ M.T)


def moved_camera(side: RobotSide, correction: Array) -> Array:
    """T_parent_camera (4, 4) after a correction (6,) of `se3.retract`."""
    return se3.retract(side.X, correction)


def touch_of(
    placing: Placing,
    side: RobotSide,
    point: Array,
    *,
    touched: Array,
    tip: Array,
    T_base_gripper: Array,
    sigma: float,
    turn: Array | None = None,
    sigma_turn: float = 0.0,
) -> Touch:
    """A point (3,) of the target, where the camera said it is, against where a tip (3,), gripper frame, touched it.

    Args: touched (3,) in the base; sigma, metres, of how it was measured; turn (3,), base axes, radians: how the target
    is turned as the camera said against how it is, with its sigma.
    """
    said, J = placing.at(point)
    M = np.concatenate([np.eye(3, 6), J])
    measured = np.diag(np.repeat([sigma_turn**2, sigma**2], 3))
    drawn = M @ (placing.picture + placing.robot) @ M.T + at_touch(side, tip, T_base_gripper) + measured
    return Touch(placing.name, said - touched, turn, M @ placing.calibration @ M.T, drawn, M @ placing.of_move)
