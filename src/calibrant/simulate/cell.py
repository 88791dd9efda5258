"""A robot cell to calibrate: an arm, a camera, a ChArUco board, the pictures taken and the poses the controller says.

`make_cell` draws a cell with its truth; `photograph` writes what a user would have in hand: a folder of images and a
file of robot poses. Everything follows from the seed.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.data import Observations, RobotPoses
from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.opencv import cv2
from calibrant.robots.arms import arm
from calibrant.simulate.arm import choose_views
from calibrant.simulate.noise import noisy_poses
from calibrant.simulate.render import Look, pixel_rays, render
from calibrant.simulate.scenes import Setup, observe, standard_camera, standard_mounting
from calibrant.targets import Target
from calibrant.targets.registry import parse_target
from calibrant.targets.target import Artwork

TARGET = "charuco:8x6:30mm:22mm:DICT_5X5_100"
"""Fills half to most of the image at the arm's working distances, on a sheet of A4."""

WORKING_DISTANCE = (0.32, 0.6)
"""Metres from the camera to the board's middle: from where it just fits to where its squares are 50 px."""

SIGMA_ROBOT_MM = 0.1
SIGMA_ROBOT_DEG = 0.02
"""A good arm: repeats to some hundredths of a millimetre, its kinematics are off by a little more."""

_MOUNTING_SPREAD = np.array([0.1, 0.1, 0.1, 0.01, 0.01, 0.01])
"""Radians and metres by which cells differ from the ordinary one (1 sigma)."""


@dataclass(frozen=True, eq=False)
class Cell:
    """The truth of a simulated cell, in the normal form A X B = Z (see `HandEyeScene`), and what its robot reports."""

    seed: int
    setup: Setup
    target: Target
    camera: Camera
    X: Array
    Z: Array
    T_base_gripper: Array
    T_camera_target: Array
    robot_poses: RobotPoses

    @property
    def workpiece(self) -> Array:
        """Where the camera sees its work: on its axis, at the mean distance of the board, (3,) metres, camera frame."""
        middle = 0.5 * (self.target.points.min(axis=0) + self.target.points.max(axis=0))
        return np.array([0.0, 0.0, se3.apply(self.T_camera_target, middle)[:, 2].mean()])


def make_cell(seed: int, *, setup: Setup = "eye-in-hand", views: int = 20) -> Cell:
    """Draw a cell: mounting, views the arm can take, noise of its reported poses.

    Images are called 00.png, 01.png, …, as are their poses. Raises: InputError for fewer than 3 views.
    """
    if views < 3:
        raise InputError(f"a hand-eye calibration needs at least 3 views, asked for {views}")
    rng = np.random.default_rng([seed, 0])
    target, camera = parse_target(TARGET), standard_camera()
    X, Z = (se3.retract(T, _MOUNTING_SPREAD * rng.standard_normal(6)) for T in standard_mounting(setup))
    taken = choose_views(
        arm("ur5e"), camera, target.points, views, setup=setup, X=X, Z=Z, rng=rng, distance=WORKING_DISTANCE
    )
    reported = noisy_poses(taken.T_base_gripper, sigma_mm=SIGMA_ROBOT_MM, sigma_deg=SIGMA_ROBOT_DEG, rng=rng)
    names = [f"{i:02d}.png" for i in range(views)]
    poses = RobotPoses.from_matrices(reported, ids=names)
    return Cell(seed, setup, target, camera, X, Z, taken.T_base_gripper, taken.T_camera_target, poses)


def observe_cell(cell: Cell, *, sigma_px: float) -> Observations:
    """What a perfect detector with noise sigma_px would hand back for the cell, without drawing images."""
    rng = np.random.default_rng([cell.seed, 1])
    seen = observe(cell.camera, cell.target.points, cell.T_camera_target, sigma_px=sigma_px, rng=rng)
    return Observations.from_points(
        [v.points for v in seen.views],
        [v.uv for v in seen.views],
        image_size=cell.camera.image_size,
        ids=cell.robot_poses.ids,
        point_ids=[v.point_ids for v in seen.views],
        target=cell.target.spec,
    )


def photograph(
    cell: Cell,
    folder: Path,
    *,
    look: Look | None = None,
    workers: int = 2,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[list[Path], Path]:
    """Write folder/images/NN.png and folder/poses.csv; returns the image paths and the poses' path.

    Args: progress, called with (done, total) after each image. Raises: InputError when the folder cannot be written.
    """
    images = folder / "images"
    try:
        images.mkdir(parents=True, exist_ok=True)
        poses = folder / "poses.csv"
        poses.write_text(poses_csv(cell.robot_poses), encoding="utf-8")
    except OSError as error:
        raise InputError(f"cannot write to {folder}: {error.strerror}; choose another folder with --out") from error
    artwork = cell.target.artwork()
    pixel_rays(cell.camera)  # once, before the threads share it

    def take(i: int) -> Path:
        return _take(cell, artwork, i, images / cell.robot_poses.ids[i], look)

    paths = []
    # Threads suffice: the work is in NumPy and OpenCV, which let go of the interpreter.
    with ThreadPoolExecutor(max_workers=workers) as pool:
        for path in pool.map(take, range(len(cell.robot_poses))):
            paths.append(path)
            if progress is not None:
                progress(len(paths), len(cell.robot_poses))
    return paths, poses


def poses_csv(poses: RobotPoses) -> str:
    """Robot poses in the native form: image,x,y,z,qx,qy,qz,qw; T_base_gripper, metres."""
    lines = ["image,x,y,z,qx,qy,qz,qw"]
    for name, T in zip(poses.ids, poses.T_base_gripper):
        w, x, y, z = so3.quaternion_wxyz(T[:3, :3])
        numbers = [*T[:3, 3], x, y, z, w]
        lines.append(",".join([name, *(f"{value:.9f}" for value in numbers)]))
    return "\n".join(lines) + "\n"


def _take(cell: Cell, artwork: Artwork, i: int, path: Path, look: Look | None) -> Path:
    rng = np.random.default_rng([cell.seed, 2, i])  # an image does not depend on the order they are taken in
    image = render(artwork, cell.camera, cell.T_camera_target[i], rng=rng, look=look)
    written, data = cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 1])
    if not written:
        raise InputError(f"the image {path.name} could not be encoded as PNG")
    try:
        path.write_bytes(data.tobytes())
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror}; choose another folder with --out") from error
    return path
