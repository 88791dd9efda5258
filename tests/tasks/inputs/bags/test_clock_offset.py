"""The offset of a bag's clocks: its sigma holds the noise of corners and robot, and what the lens is off by."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from calibrant.calibrate.intrinsics.one_model import calibrate_keeping
from calibrant.cameras import Camera
from calibrant.data import Observations, View
from calibrant.geometry import se3
from calibrant.geometry.motion import Motion
from calibrant.simulate.scenes import gripper_poses, look_at_board, standard_mounting
from calibrant.targets.registry import parse_target
from calibrant.tasks.inputs.bags.clocks import clock_offset, seen_motion
from calibrant.tasks.inputs.bags.motion import RobotMotion
from calibrant.tasks.inputs.bags.topics import Recorded

OFFSET, CORNER_PX, BEGUN_S = 0.037, 0.02, 1.7e9
CAMERA = Camera.create(
    "brown", {"fx": 300.0, "fy": 299.0, "cx": 162.5, "cy": 117.5, "k1": -0.05}, image_size=(320, 240)
)
POINTS = parse_target("chessboard:7x6:30mm").points
X, Z = standard_mounting("eye-in-hand")


def recorded(seed: int, *, seconds: float = 8.0) -> tuple[RobotMotion, Observations, Recorded]:
    """Robot and camera on the move: what was recorded of both, the camera's clock behind by OFFSET."""
    rng = np.random.default_rng(seed)
    n = int(seconds) + 4
    seen = look_at_board(CAMERA, POINTS, n, rng=rng, distance=(0.45, 0.65), tilt_deg=30, roll_deg=25)
    turn = RotationSpline(np.arange(n) - 1.0, Rotation.from_matrix(seen[:, :3, :3]))
    place = CubicSpline(np.arange(n) - 1.0, seen[:, :3, 3])
    of_robot, of_camera = np.arange(0.0, seconds + 0.5, 0.01), np.arange(0.15, seconds, 1 / 15)
    boards = se3.make(turn(of_robot).as_matrix(), place(of_robot))
    T = se3.retract(gripper_poses("eye-in-hand", X, Z, boards), 2e-5 * rng.standard_normal((len(of_robot), 6)))
    files = tuple(Path(f"run.mcap/{k:06d}") for k in range(len(of_camera)))
    views = []
    for file, M in zip(files, se3.make(turn(of_camera).as_matrix(), place(of_camera))):
        uv = CAMERA.project(se3.apply(M, POINTS)) + CORNER_PX * rng.standard_normal((len(POINTS), 2))
        inside = np.all((uv > 0) & (uv < np.array(CAMERA.image_size) - 1), axis=1)
        if inside.sum() >= 12:
            ids = np.flatnonzero(inside)
            views.append(View(file.name, POINTS[inside], uv[inside], ids, "camera", file.name, file=str(file)))
    observations = Observations(tuple(views), {"camera": CAMERA.image_size})
    motion = RobotMotion(Motion(BEGUN_S + of_robot, T), "tf base to tool")
    return motion, observations, Recorded("/image", (), files, BEGUN_S + of_camera - OFFSET)


def lens_of_other_photos() -> Camera:
    """With the covariance that twelve photos of coarse corners leave."""
    rng = np.random.default_rng(999)
    poses = look_at_board(CAMERA, POINTS, 12, rng=rng, distance=(0.45, 0.65), tilt_deg=30, roll_deg=25)
    views = []
    for k, T in enumerate(poses):
        uv = CAMERA.project(se3.apply(T, POINTS)) + 0.1 * rng.standard_normal((len(POINTS), 2))
        views.append(View(str(k), POINTS, uv, np.arange(len(uv)), "camera", str(k)))
    seen = Observations(tuple(views), {"camera": CAMERA.image_size})
    return calibrate_keeping(seen, model="brown", fix=()).result.camera


def drawn(camera: Camera, seed: int) -> Camera:
    """The true lens, off by a draw from a camera's covariance, which it states."""
    values, vectors = np.linalg.eigh(camera.covariance)
    z = np.random.default_rng([seed, 5]).standard_normal(len(values))
    return replace(camera, values=CAMERA.values + vectors @ (np.sqrt(np.maximum(values, 0.0)) * z))


@pytest.mark.long
def test_what_the_lens_is_off_by_is_what_another_lens_would_give() -> None:
    """One direction of error alone: its share of the variance is the square of how far the offset then moves."""
    motion, observations, pictures = recorded(1)
    error = np.zeros(len(CAMERA.values))
    error[CAMERA.model.parameter_names.index("fx")] = 0.005
    known = replace(CAMERA, covariance=np.outer(error, error))
    seen = seen_motion(observations, pictures, known, "brown", ())
    found, _ = clock_offset(motion, seen, setup="eye-in-hand", largest=2.0)
    exact, _ = clock_offset(
        motion, replace(seen, camera=replace(known, covariance=None)), setup="eye-in-hand", largest=2.0
    )
    other = seen_motion(observations, pictures, replace(CAMERA, values=CAMERA.values + error), "brown", ())
    moved, _ = clock_offset(motion, replace(other, views=()), setup="eye-in-hand", largest=2.0)
    assert found.offset == exact.offset
    added = np.sqrt(found.sigma**2 - exact.sigma**2)
    # So small an error that turns and shifts keep their weights, which the noise of the loop sets.
    assert added == pytest.approx(abs(moved.offset - found.offset), rel=0.05)


@pytest.mark.statistics
@pytest.mark.parametrize("given", [True, False])
def test_errors_of_the_offset_are_as_large_as_its_sigma(*, given: bool) -> None:
    other = lens_of_other_photos()
    errors = []
    for seed in range(30):
        motion, observations, pictures = recorded(seed)
        lens = drawn(other, seed) if given else None
        seen = seen_motion(observations, pictures, lens, "brown", ())
        found, _ = clock_offset(motion, seen, setup="eye-in-hand", largest=2.0)
        errors.append((found.offset - OFFSET) / found.sigma)
    # Of 30 draws the root mean square is 1 +- 0.13; what a lens leaves in the loop counts as noise there, too.
    assert 0.65 < np.sqrt(np.mean(np.square(errors))) < 1.3
    assert np.abs(errors).max() < 3.5
