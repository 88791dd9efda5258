"""Named synthetic data sets with their truth, for tests, the demo and the docs.

A scene is a camera that sees a grid of points from many places, at the level of points: no images are drawn. The
intrinsics scene is a camera and views; hand-eye scenes add the robot and, by name, the fault that the data carry.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.data import Observations, RobotPoses
from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.simulate.noise import flipped_board, noisy_pixels, noisy_poses, shifted

Setup = Literal["eye-in-hand", "eye-to-hand"]

IMAGE_SIZE = (1280, 1024)


@dataclass(frozen=True, eq=False)
class IntrinsicsScene:
    """A camera and what it saw: T_camera_target (n, 4, 4) are the true poses behind the observations."""

    camera: Camera
    points: Array
    T_camera_target: Array
    observations: Observations
    sigma_px: float


@dataclass(frozen=True, eq=False)
class HandEyeScene:
    """A hand-eye data set with its truth, in the normal form A_i X B_i = Z.

    eye-in-hand: X = T_gripper_camera, Z = T_base_target; eye-to-hand: X = T_base_camera, Z = T_gripper_target.
    T_base_gripper (n, 4, 4) and T_camera_target (n, 4, 4) are true; robot_poses, measured_T_camera_target and
    observations are what the data say. sigma_px, sigma_mm and sigma_deg are the noise of pixels and robot, per axis.
    """

    name: str
    setup: Setup
    camera: Camera
    points: Array
    X: Array
    Z: Array
    T_base_gripper: Array
    T_camera_target: Array
    robot_poses: RobotPoses
    observations: Observations
    measured_T_camera_target: Array
    sigma_px: float
    sigma_mm: float
    sigma_deg: float


def standard_camera() -> Camera:
    """A 1280x1024 camera with all five distortion terms, of the kind that industrial arms carry."""
    parameters = {"fx": 1102.4, "fy": 1099.7, "cx": 645.2, "cy": 507.9}
    distortion = {"k1": -0.182, "k2": 0.094, "p1": 6.0e-4, "p2": -4.0e-4, "k3": -0.015}
    return Camera.create("brown", parameters | distortion, image_size=IMAGE_SIZE)


def grid(columns: int, rows: int, spacing: float) -> Array:
    """Points of a plane grid, row by row, (columns * rows, 3) metres, the first at the origin."""
    row, column = np.divmod(np.arange(columns * rows), columns)
    return np.column_stack([column * spacing, row * spacing, np.zeros(columns * rows)])


def look_at_board(
    camera: Camera,
    points: Array,
    n: int,
    *,
    rng: np.random.Generator,
    distance: tuple[float, float] = (0.3, 0.9),
    tilt_deg: float = 40.0,
    roll_deg: float = 180.0,
) -> Array:
    """Target poses in which the camera sees every point, drawn at random.

    The board's middle lies at a random pixel and depth; the board is tilted about a random axis in the image plane and
    rolled about the camera's axis. Poses with a point outside the image are drawn again.
    Args: points (p, 3) metres, target frame; distance, metres; tilt_deg and roll_deg, largest angles.
    Returns T_camera_target (n, 4, 4). Raises: InputError when the board cannot be brought into view.
    """
    width, height = camera.image_size
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    kept: list[Array] = []
    count = 0
    for _ in range(200):  # a draw in 200 in view is taken for "does not fit"
        ray = camera.unproject(rng.uniform((0.2 * width, 0.2 * height), (0.8 * width, 0.8 * height), size=(n, 2)))
        direction = rng.uniform(0, 2 * np.pi, n)
        tilt = np.deg2rad(tilt_deg) * np.sqrt(rng.uniform(0, 1, n))  # even over the disc of tilts
        axis = np.column_stack([np.cos(direction), np.sin(direction), np.zeros(n)])
        roll = np.deg2rad(roll_deg) * rng.uniform(-1, 1, n)
        R = so3.exp(tilt[:, None] * axis) @ so3.exp(roll[:, None] * [0, 0, 1])
        centre = ray / ray[:, 2:] * rng.uniform(*distance, size=(n, 1))
        T = se3.make(R, centre - R @ middle)
        uv = camera.project(se3.apply(T[:, None], points))
        inside = np.all((uv > 2) & (uv < np.array([width, height]) - 3), axis=(1, 2))
        kept.append(T[inside])
        count += int(inside.sum())
        if count >= n:
            return np.concatenate(kept)[:n]
    raise InputError(
        f"a board of {np.ptp(points[:, 0]):.3g} x {np.ptp(points[:, 1]):.3g} m does not fit into the image at "
        f"{distance[0]:g} to {distance[1]:g} m; take a larger distance or a smaller board"
    )


def intrinsics_scene(
    views: int = 20,
    *,
    seed: int = 0,
    sigma_px: float = 0.1,
    columns: int = 11,
    rows: int = 8,
    square: float = 0.03,
) -> IntrinsicsScene:
    """A camera calibration: a board of 11x8 corners, 30 mm apart, tilted, 0.3 to 0.9 m away."""
    rng = np.random.default_rng(seed)
    camera, points = standard_camera(), grid(columns, rows, square)
    T = look_at_board(camera, points, views, rng=rng)
    observations = observe(camera, points, T, sigma_px=sigma_px, rng=rng)
    return IntrinsicsScene(camera, points, T, observations, sigma_px)


def observe(
    camera: Camera, points: Array, T_camera_target: Array, *, sigma_px: float, rng: np.random.Generator
) -> Observations:
    """Observations of points seen at poses (n, 4, 4); points outside the image are left out of their view."""
    uv = noisy_pixels(camera.project(se3.apply(T_camera_target[:, None], points)), sigma_px, rng=rng)
    with np.errstate(invalid="ignore"):
        inside = np.all((uv > -0.5) & (uv < np.array(camera.image_size) - 0.5), axis=-1)
    labels = np.arange(len(points))
    return Observations.from_points(
        [points[keep] for keep in inside],
        [u[keep] for u, keep in zip(uv, inside)],
        image_size=camera.image_size,
        point_ids=[labels[keep] for keep in inside],
    )


def gripper_poses(setup: Setup, X: Array, Z: Array, T_camera_target: Array) -> Array:
    """T_base_gripper that puts the target at T_camera_target, from A X B = Z.

    eye-in-hand: A = T_base_gripper = Z B^-1 X^-1; eye-to-hand: A^-1 = T_base_gripper = X B Z^-1.
    """
    if setup == "eye-in-hand":
        return Z @ se3.inverse(T_camera_target) @ se3.inverse(X)
    return X @ T_camera_target @ se3.inverse(Z)


def target_poses(setup: Setup, X: Array, Z: Array, T_base_gripper: Array) -> Array:
    """T_camera_target that a robot pose gives, B = X^-1 A^-1 Z: the inverse of `gripper_poses`."""
    A = T_base_gripper if setup == "eye-in-hand" else se3.inverse(T_base_gripper)
    return se3.inverse(X) @ se3.inverse(A) @ Z


def standard_mounting(setup: Setup) -> tuple[Array, Array]:
    """X and Z of an ordinary cell: a camera on the flange above a board, or above a board in the gripper."""
    down = so3.exp([np.pi, 0, 0])
    if setup == "eye-in-hand":
        X = se3.make(so3.exp([0.03, -0.05, 0.4]), [0.021, -0.064, 0.047])
        Z = se3.make(down @ so3.exp([0, 0, 0.3]), [0.62, 0.11, 0.02])
    else:
        X = se3.make(down @ so3.exp([0.05, 0.04, 0.8]), [0.55, -0.08, 1.15])
        Z = se3.make(so3.exp([0.04, 0.02, 0.7]), [-0.09, -0.07, 0.06])
    return X, Z


def _scene(
    name: str,
    setup: Setup,
    T_camera_target: Array,
    *,
    rng: np.random.Generator,
    sigma_px: float,
    sigma_mm: float,
    sigma_deg: float,
) -> HandEyeScene:
    """Scene of true target poses; measured ones carry the noise that sigma_px leaves on a board's pose."""
    camera, points = standard_camera(), _hand_eye_grid()
    X, Z = standard_mounting(setup)
    T_base_gripper = gripper_poses(setup, X, Z, T_camera_target)
    robot = noisy_poses(T_base_gripper, sigma_mm=sigma_mm, sigma_deg=sigma_deg, rng=rng)
    observations = observe(camera, points, T_camera_target, sigma_px=sigma_px, rng=rng)
    # A board 0.25 m wide seen at 0.5 m by 1100 px of focal length: 0.1 px give about 0.1 mm and 0.02 degrees.
    measured = noisy_poses(T_camera_target, sigma_mm=1.0 * sigma_px, sigma_deg=0.2 * sigma_px, rng=rng)
    poses = RobotPoses.from_matrices(robot)
    return HandEyeScene(
        name, setup, camera, points, X, Z, T_base_gripper, T_camera_target, poses, observations, measured,
        sigma_px, sigma_mm, sigma_deg,
    )  # fmt: skip


def _hand_eye_grid() -> Array:
    return grid(9, 7, 0.03)


def _random_views(n: int, rng: np.random.Generator) -> Array:
    return look_at_board(standard_camera(), _hand_eye_grid(), n, rng=rng, distance=(0.35, 0.75), tilt_deg=35)


def _good(name: str, setup: Setup, rng: np.random.Generator, views: int) -> HandEyeScene:
    T = _random_views(views, rng)
    return _scene(name, setup, T, rng=rng, sigma_px=0.1, sigma_mm=0.05, sigma_deg=0.01)


def _noisy(name: str, setup: Setup, rng: np.random.Generator, views: int) -> HandEyeScene:
    return _scene(name, setup, _random_views(views, rng), rng=rng, sigma_px=0.5, sigma_mm=1.0, sigma_deg=0.2)


def _exact(name: str, setup: Setup, rng: np.random.Generator, views: int) -> HandEyeScene:
    return _scene(name, setup, _random_views(views, rng), rng=rng, sigma_px=0.0, sigma_mm=0.0, sigma_deg=0.0)


def _parallel_axes(name: str, setup: Setup, rng: np.random.Generator, views: int) -> HandEyeScene:
    """The wrist turns about one direction only, as a SCARA's does; positions differ freely."""
    turn = rng.uniform(-np.pi / 2, np.pi / 2, views)
    R = so3.exp(turn[:, None] * [0, 0, 1]) @ so3.exp([0.3, 0.1, 0])
    return _scene(name, setup, _placed(R, rng), rng=rng, sigma_px=0.1, sigma_mm=0.05, sigma_deg=0.01)


def _pure_translation(name: str, setup: Setup, rng: np.random.Generator, views: int) -> HandEyeScene:
    R = np.broadcast_to(so3.exp([0.3, 0.1, 0.2]), (views, 3, 3))
    return _scene(name, setup, _placed(R, rng), rng=rng, sigma_px=0.1, sigma_mm=0.05, sigma_deg=0.01)


def _placed(R: Array, rng: np.random.Generator) -> Array:
    """Target poses of given rotations with the board's middle near the camera's axis, 0.55 to 0.75 m away."""
    points = _hand_eye_grid()
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    centre = rng.uniform((-0.06, -0.04, 0.55), (0.06, 0.04, 0.75), size=(len(R), 3))
    return se3.make(R, centre - R @ middle)


def _two_poses(name: str, setup: Setup, rng: np.random.Generator, views: int) -> HandEyeScene:
    return _good(name, setup, rng, 2)


def _one_flip(name: str, setup: Setup, rng: np.random.Generator, views: int) -> HandEyeScene:
    """One view whose corners are numbered from the opposite end."""
    scene = _good(name, setup, rng, views)
    k = views // 2
    measured = scene.measured_T_camera_target.copy()
    measured[k] = flipped_board(scene.points, measured[k])
    view = scene.observations.views[k]
    turned = replace(view, points=view.points.max(axis=0) + view.points.min(axis=0) - view.points)
    turned = replace(turned, point_ids=len(scene.points) - 1 - view.point_ids)
    every = (*scene.observations.views[:k], turned, *scene.observations.views[k + 1 :])
    return replace(scene, measured_T_camera_target=measured, observations=replace(scene.observations, views=every))


def _shifted_pairs(name: str, setup: Setup, rng: np.random.Generator, views: int) -> HandEyeScene:
    scene = _good(name, setup, rng, views)
    return replace(scene, robot_poses=RobotPoses.from_matrices(shifted(scene.robot_poses.T_base_gripper)))


def _inverted_poses(name: str, setup: Setup, rng: np.random.Generator, views: int) -> HandEyeScene:
    scene = _good(name, setup, rng, views)
    return replace(scene, robot_poses=RobotPoses.from_matrices(se3.inverse(scene.robot_poses.T_base_gripper)))


HAND_EYE_SCENES: dict[str, Callable[[str, Setup, np.random.Generator, int], HandEyeScene]] = {
    "exact": _exact,
    "good": _good,
    "noisy": _noisy,
    "parallel-axes": _parallel_axes,
    "pure-translation": _pure_translation,
    "two-poses": _two_poses,
    "one-flip": _one_flip,
    "shifted-pairs": _shifted_pairs,
    "inverted-poses": _inverted_poses,
}


def hand_eye_scene(name: str = "good", *, setup: Setup = "eye-in-hand", seed: int = 0, views: int = 15) -> HandEyeScene:
    """The hand-eye data set of that name.

    Args: name, a key of HAND_EYE_SCENES; views, how many poses ("two-poses" has two).
    Raises: InputError listing the names, or for an unknown setup.
    """
    if name not in HAND_EYE_SCENES:
        raise InputError(f"unknown scene {name!r}; known scenes: {', '.join(HAND_EYE_SCENES)}")
    if setup not in ("eye-in-hand", "eye-to-hand"):
        raise InputError(f"unknown setup {setup!r}; expected eye-in-hand or eye-to-hand")
    return HAND_EYE_SCENES[name](name, setup, np.random.default_rng(seed), views)
