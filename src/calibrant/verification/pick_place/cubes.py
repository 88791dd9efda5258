"""Where cubes are in the robot's base, three ways.

`by_shape` fits the cube to colour and depth: its centre and turn, with covariance; nothing is typed in but the side.
`by_point` is that of the thesis (section 2.3.3, equations 2.10-2.12): the pixel in the middle of the coloured area,
and the depth there, are taken as the cube: a point of its surface, or of what the camera sees beside it. `half_added`
moves it by half a side along the line of sight, the thesis's second version.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.data.devices import Picture
from calibrant.errors import RefusedError
from calibrant.geometry import se3, so3
from calibrant.perceive.colour.ranges import ColourRange
from calibrant.perceive.colour.segments import find_segments
from calibrant.perceive.object_pose.cubes import locate_cubes
from calibrant.perceive.registered_depth.noise import DepthNoise
from calibrant.perceive.registered_depth.register import DepthRig, RegisteredDepth
from calibrant.verification.touch.errors import radius_95
from calibrant.verification.unchanged.robot_noise import RobotSide

CENTRE_PX = 1
"""Around the middle of the area where a depth is read: the median of nine pixels, or of those that have one."""


@dataclass(frozen=True, eq=False)
class Cube:
    """centre (3,) in the base, metres; yaw, radians, of a horizontal side; covariance (3, 3) of the centre, None where
    the way knows none."""

    centre: Array
    yaw: float | None
    covariance: Array | None = None

    @property
    def predicted_95(self) -> float | None:
        """What the error of the centre stays below with 95 %, metres."""
        return None if self.covariance is None else radius_95(self.covariance)


@dataclass(frozen=True, eq=False)
class Eye:
    """A calibrated RGB-D camera on or beside a robot. T_base_camera (4, 4) of now."""

    camera: Camera
    rig: DepthRig
    noise: DepthNoise
    side: RobotSide
    T_base_camera: Array
    cube_m: float


def by_shape(eye: Eye, picture: Picture, colour: ColourRange) -> Cube:
    """The cube of a colour, by its shape. Raises: RefusedError with the reason where there is none, or several."""
    found = locate_cubes(picture, eye.camera, colour, side=eye.cube_m, rig=eye.rig, noise=eye.noise)
    if len(found) > 1:
        raise RefusedError(f"{len(found)} cubes have the colour {colour.spec}: leave one of them in view")
    pose = found[0]
    T = eye.T_base_camera @ pose.matrix
    return Cube(T[:3, 3], yaw_of(T[:3, :3]), centre_covariance(eye, pose.matrix[:3, 3], pose.covariance[3:, 3:]))


def centre_covariance(eye: Eye, p_camera: Array, of_picture: Array) -> Array:
    """Covariance (3, 3) in the base of a point (3,) of the camera's frame: the picture's, the calibration's, the
    robot's."""
    R = eye.T_base_camera[:3, :3]
    # X moves by (omega, v) along its parent's axes: the point by omega x (R_X p) + v there.
    arm = eye.side.X[:3, :3] @ p_camera
    J = np.concatenate([-so3.hat(arm), np.eye(3)], axis=1)
    to_base = R @ eye.side.X[:3, :3].T
    of_X = to_base @ J @ eye.side.covariance[:6, :6] @ J.T @ to_base.T
    metres = 0.0 if eye.side.arm is None else eye.side.arm.metres
    lever = float(np.linalg.norm(arm + eye.side.X[:3, 3]))
    robot = eye.side.translation**2 + metres**2 + (eye.side.rotation * lever) ** 2
    return np.asarray(R @ of_picture @ R.T + of_X + (robot if eye.side.in_hand else 0.0) * np.eye(3))


def by_point(eye: Eye, picture: Picture, registered: RegisteredDepth, colour: ColourRange) -> Cube:
    """The thesis's first version: the point in the middle of the coloured area.

    Args: registered, the picture's depth on its colour. Raises: RefusedError where nothing has the colour, or the
    middle has no depth.
    """
    found = find_segments(picture.colour, colour)
    if not found:
        raise RefusedError(f"nothing has the colour {colour.spec}")
    rows, columns = np.nonzero(found[0].mask)
    u, v = float(columns.mean()), float(rows.mean())
    z = _depth_at(registered, u, v)
    if z is None:
        raise RefusedError("no depth on the cube: the middle of its colour has none")
    ray = eye.camera.unproject(np.array([[u, v]]))[0]
    p = ray / ray[2] * z
    return Cube(se3.apply(eye.T_base_camera, p), None)


def half_added(eye: Eye, cube: Cube) -> Cube:
    """The thesis's second version: half a side farther along the line of sight."""
    away = cube.centre - eye.T_base_camera[:3, 3]
    return replace(cube, centre=cube.centre + 0.5 * eye.cube_m * away / np.linalg.norm(away))


def _depth_at(registered: RegisteredDepth, u: float, v: float) -> float | None:
    """Depth in the colour camera at a pixel, metres; None where there is none."""
    c, r = round(u), round(v)
    near = registered.z[max(r - CENTRE_PX, 0) : r + CENTRE_PX + 1, max(c - CENTRE_PX, 0) : c + CENTRE_PX + 1]
    return float(np.nanmedian(near)) if np.isfinite(near).any() else None


def yaw_of(R_base_cube: Array) -> float:
    """The turn about z of a cube's horizontal sides, within a quarter turn: -45 to 45 degrees."""
    up = int(np.argmax(np.abs(R_base_cube[2])))
    x = R_base_cube[:, (up + 1) % 3]
    yaw = float(np.arctan2(x[1], x[0]))
    return (yaw + np.pi / 4) % (np.pi / 2) - np.pi / 4
