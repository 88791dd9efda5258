"""Errors that a whole image shares: told from the robot's where the loop can, and never where there are none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calibrant.calibrate.cell.hand_eye import calibrate_hand_eye
from calibrant.calibrate.cell.loop.image_poses import EVIDENT, ImagePoses, image_poses
from calibrant.calibrate.cell.loop.noise import fit_loop_noise
from calibrant.calibrate.cell.loop.target_size import target_size
from calibrant.calibrate.cell.problem.views import HandEyeViews, from_observations, from_target_poses
from calibrant.calibrate.pose.target_poses import target_poses
from calibrant.calibrate.solvers.setup import get_setup
from calibrant.cameras import Camera
from calibrant.data import RobotPoses
from calibrant.detection import detect
from calibrant.formats.poses.read import notations, read_poses
from calibrant.geometry import se3
from calibrant.simulate.noise import noisy_poses
from calibrant.simulate.scenes import (
    HandEyeScene,
    Setup,
    grid,
    gripper_poses,
    hand_eye_scene,
    look_at_board,
    observe,
    standard_camera,
    standard_mounting,
)


def views_with(share_px: float, *, setup: Setup, seed: int, robot: tuple[float, float]) -> tuple[HandEyeViews, Camera]:
    """20 views of 0.1 px whose target poses are off besides as if by points of share_px; robot: mm and deg."""
    rng = np.random.default_rng(seed)
    camera, points = standard_camera(), grid(9, 7, 0.03)
    B = look_at_board(camera, points, 20, rng=rng, distance=(0.35, 0.75), tilt_deg=35)
    X, Z = standard_mounting(setup)
    A = noisy_poses(gripper_poses(setup, X, Z, B), sigma_mm=robot[0], sigma_deg=robot[1], rng=rng)
    clean = observe(camera, points, B, sigma_px=0.1, rng=rng)
    root = np.linalg.cholesky(target_poses(camera, clean.views).covariance)
    moved = se3.retract(B, share_px * np.einsum("nij,nj->ni", root, rng.standard_normal((20, 6))))
    seen = observe(camera, points, moved, sigma_px=0.1, rng=rng)
    poses = RobotPoses.from_matrices(A)
    named = replace(seen, views=tuple(replace(v, moment=i) for v, i in zip(seen.views, poses.ids)))
    return from_observations(poses, named, camera), camera


def said_of(data: HandEyeViews, camera: Camera, setup: Setup) -> ImagePoses:
    X = standard_mounting(setup)[0]
    size = target_size(get_setup(setup), data, X, used=data.use, camera=camera)
    found = image_poses(get_setup(setup), data, size, camera=camera)
    assert found is not None
    return found


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_a_share_of_the_images_is_found_with_its_size(setup: Setup) -> None:
    levels = []
    for seed in range(6):
        found = said_of(*views_with(1.0, setup=setup, seed=seed, robot=(0.3, 0.03)), setup)
        assert found.evident
        assert found.shows_px < 1.0
        levels.append((found.px, found.robot_mm))
    # 120 numbers a set for three levels: each is known to a fifth at worst, the median of six sets to a tenth.
    np.testing.assert_allclose(np.median(levels, axis=0), (np.hypot(1.0, 0.1), 0.3), rtol=0.25)


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
@pytest.mark.parametrize("robot", [(0.0, 0.0), (0.1, 0.03), (1.0, 0.2)])
def test_noise_of_robot_and_points_is_not_put_down_to_the_images(setup: Setup, robot: tuple[float, float]) -> None:
    for seed in range(3):
        found = said_of(*views_with(0.0, setup=setup, seed=seed, robot=robot), setup)
        assert not found.evident
        # Robot noise hides errors of the images below it: what would show grows with it.
        assert found.shows_px > found.scatter_px


def test_evidence_compares_likelihoods_of_nested_fits() -> None:
    """A level that is free fits at least as well; held at the level found, it fits the same."""
    data, _ = views_with(0.5, setup="eye-in-hand", seed=3, robot=(0.1, 0.03))
    X, setup = standard_mounting("eye-in-hand")[0], get_setup("eye-in-hand")
    args = (setup, data.T_base_gripper, data.B, X)
    free = fit_loop_noise(*args, covariance=data.covariance, least_px=data.sigma_px)
    same = fit_loop_noise(*args, covariance=data.covariance, held_px=free.target)
    alone = fit_loop_noise(*args, covariance=data.covariance, held_px=data.sigma_px)
    assert same.log_likelihood == pytest.approx(free.log_likelihood, abs=1e-3)
    assert alone.target == pytest.approx(data.sigma_px)
    assert 2 * (free.log_likelihood - alone.log_likelihood) > EVIDENT


def test_pairs_measured_elsewhere_have_no_images() -> None:
    scene = hand_eye_scene("good")
    data = from_target_poses(scene.robot_poses, scene.measured_T_camera_target)
    assert image_poses(get_setup("eye-in-hand"), data, None) is None


def wrong_lens(scene: HandEyeScene) -> Camera:
    values = scene.camera.values.copy()
    values[scene.camera.model.parameter_names.index("k1")] += 0.02
    return Camera(scene.camera.model, scene.camera.image_size, values)


def test_a_wrong_lens_is_not_called_the_robots() -> None:
    scene = hand_eye_scene("good", seed=4)
    asked = {"setup": "eye-in-hand"}
    right = calibrate_hand_eye(scene.robot_poses, scene.observations, camera=scene.camera, **asked)
    wrong = calibrate_hand_eye(scene.robot_poses, scene.observations, camera=wrong_lens(scene), **asked)
    assert right.check("image-poses").status == "ok"
    check = wrong.check("image-poses")
    assert check.status == "warn"
    assert "the lens model" in check.message
    assert wrong.sigma_robot is not None
    # The robot's true noise is 0.05 mm: what the refinement calls the robot's is the lens.
    assert wrong.sigma_robot.mm > 5 * scene.sigma_mm


def test_circles_on_paper(shared_data: Callable[[str], Path]) -> None:
    """The joint refinement's 10 mm are not the robot's: beside errors of the images it has 1 mm, and a board of the
    wrong size."""
    folder = shared_data("handeye_rct_circles_eih")
    observations = detect([str(folder / "images")], target="circles:10x10:25.4mm:bigdot")
    poses = notations(read_poses(str(folder / "poses" / "*.yaml")))[0]
    ids = [v.id for v in observations.views]
    poses = poses.take([poses.ids.index(Path(i).stem) for i in ids], ids)
    result = calibrate_hand_eye(poses.poses, observations, setup="eye-in-hand")
    check = result.check("image-poses")
    assert check.status == "warn"
    # The lens is uncertain by what its photos share, which holds the other half of 15.
    assert check.value == pytest.approx(8, rel=0.3)
    assert "Beside them the robot errs by" in check.message
