"""The target's size by the robot's motion: its sigma on noisy data, the sources of noise, and a real printed sheet."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calibrant.calibrate.cell.hand_eye import calibrate_hand_eye
from calibrant.calibrate.cell.loop.noise import fit_loop_noise
from calibrant.calibrate.cell.loop.target_size import camera_share, target_size
from calibrant.calibrate.cell.problem.views import from_observations
from calibrant.calibrate.intrinsics.calibrate import calibrate_intrinsics
from calibrant.calibrate.intrinsics.one_model import calibrate_keeping
from calibrant.calibrate.pose.target_poses import target_poses
from calibrant.calibrate.solvers.setup import get_setup
from calibrant.cameras import Camera
from calibrant.data import Observations, RobotPoses
from calibrant.detection import detect
from calibrant.diagnose.doctor.diagnosis import diagnose_views
from calibrant.formats.poses.read import notations, read_poses
from calibrant.geometry import se3
from calibrant.simulate.scenes import hand_eye_scene

TILTS = 10.0
"""Images whose poses are ten times less certain than the scatter of their points: a sheet that is not flat."""


@pytest.mark.statistics
@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_the_size_is_found_within_its_sigma_whatever_the_noise_comes_from(setup: str) -> None:
    chosen = get_setup(setup)
    errors, turns, images = [], [], []
    for seed in range(60):
        scene = hand_eye_scene("good", seed=seed, setup=setup)  # type: ignore[arg-type]
        rng = np.random.default_rng([3, seed])
        found = target_poses(scene.camera, scene.observations.views)
        root = np.linalg.cholesky(found.covariance) * scene.sigma_px * TILTS
        B = se3.retract(scene.T_camera_target, (root @ rng.normal(size=(len(root), 6, 1)))[..., 0])
        B[:, :3, 3] *= 1.03
        fit = fit_loop_noise(
            chosen, scene.robot_poses.T_base_gripper, B, scene.X, covariance=found.covariance, least_px=scene.sigma_px
        )
        errors.append((fit.size.value - 1 / 1.03) / fit.size.sigma)
        turns.append(fit.flange_rotation)
        images.append(fit.target)
    # The rms of 60 normalised errors scatters by 0.09; levels that are estimated themselves widen it a little.
    assert 0.75 < np.sqrt(np.mean(np.square(errors))) < 1.35
    assert abs(np.mean(errors)) < 4 / np.sqrt(60)
    # Tilts of the images are no turns of the flange.
    assert np.median(images) == pytest.approx(TILTS * scene.sigma_px, rel=0.2)
    assert np.median(np.rad2deg(turns)) < 2 * scene.sigma_deg


def test_an_uncertain_camera_makes_the_size_uncertain_and_the_target_poses_follow_it() -> None:
    scene = hand_eye_scene("good", views=6)
    camera = calibrate_intrinsics(scene.observations).camera
    data = from_observations(scene.robot_poses, scene.observations, camera)
    share = camera_share(camera, data, np.arange(6))
    assert camera.covariance is not None
    assert share is not None
    values, axes = np.linalg.eigh(camera.covariance)
    root = axes[:, values > 0] * np.sqrt(values[values > 0])
    for k in (-1, -3):
        shifted = Camera(camera.model, camera.image_size, camera.values + 0.01 * root[:, k])
        moved = se3.local(data.B, target_poses(shifted, scene.observations.views).T_camera_target) / 0.01
        # First order in the residuals: 0.1 px of the board's 300.
        np.testing.assert_allclose(moved, share[:, :, k], atol=2e-2 * np.abs(share[:, :, k]).max())
    setup, X = get_setup("eye-in-hand"), scene.X
    held = target_size(setup, data, X, used=data.use)
    uncertain = target_size(setup, data, X, used=data.use, camera=camera)
    assert held is not None
    assert uncertain is not None
    assert uncertain.size.sigma > held.size.sigma


@pytest.fixture(scope="module")
def circles(shared_data: Callable[[str], Path]) -> tuple[tuple, Observations, RobotPoses]:
    """Notations of the poses, observations and poses of 15 pictures of a sheet printed at some enlargement."""
    folder = shared_data("handeye_rct_circles_eih")
    observations = detect([str(folder / "images")], target="circles:10x10:25.4mm:bigdot")
    complete = notations(read_poses(str(folder / "poses" / "*.yaml")))
    ids = [v.id for v in observations.views]
    order = [complete[0].ids.index(Path(i).stem) for i in ids]
    complete = tuple(r.take(order, ids) for r in complete)
    return complete, observations, complete[0].poses


def test_calibration_and_doctor_state_one_size(circles: tuple[tuple, Observations, RobotPoses]) -> None:
    """The sheet's paper, 11 x 17 inches in the rectified pictures, says 24.8 mm: 0.976 of the 25.4 mm configured."""
    complete, observations, poses = circles
    result = calibrate_hand_eye(poses, observations, setup="eye-in-hand")
    kept = calibrate_keeping(observations)
    found = diagnose_views(complete, replace(observations, views=kept.views), kept.result.camera)
    stated, said = result.target_scale, found.named("target-size")[0].measured
    assert stated is not None
    assert said is not None
    assert said.value == pytest.approx(stated.value, abs=0.2 * stated.sigma)
    assert said.sigma == pytest.approx(stated.sigma, rel=0.1)
    assert stated.value == pytest.approx(0.976, abs=0.003)
    assert "at that size the loop closes to" in result.check("target-size").message
    # Tilts by lens and sheet are no wrong poses.
    assert not found.named("bad-pose")


def test_the_stated_sigma_is_the_jackknifes(circles: tuple[tuple, Observations, RobotPoses]) -> None:
    _, observations, poses = circles
    kept = calibrate_keeping(observations)
    camera = kept.result.camera
    data = from_observations(poses, replace(observations, views=kept.views), camera)
    setup, X = get_setup("eye-in-hand"), calibrate_hand_eye(poses, data.B, setup="eye-in-hand").transforms[0].matrix
    whole = target_size(setup, data, X, used=data.use, camera=camera)
    assert whole is not None
    n = len(data)
    without = [target_size(setup, data, X, used=np.arange(n) != k, camera=camera) for k in range(n)]
    values = np.array([fit.size.value for fit in without if fit is not None])
    jackknife = np.sqrt((n - 1) / n * np.sum((values - values.mean()) ** 2))
    # A jackknife of 15 views is itself uncertain by a fifth and more.
    assert 0.5 < jackknife / whole.size.sigma < 1.5
