"""Scenes hold what their names say, and their truth fits together."""

from __future__ import annotations

import time

import numpy as np
import pytest

from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.simulate.scenes import (
    HAND_EYE_SCENES,
    HandEyeScene,
    Setup,
    grid,
    hand_eye_scene,
    intrinsics_scene,
    look_at_board,
    standard_camera,
    target_poses,
)


def A_of(scene: HandEyeScene, T_base_gripper: np.ndarray) -> np.ndarray:
    return T_base_gripper if scene.setup == "eye-in-hand" else se3.inverse(T_base_gripper)


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
@pytest.mark.parametrize("name", HAND_EYE_SCENES)
def test_the_truth_closes_the_loop(name: str, setup: Setup) -> None:
    scene = hand_eye_scene(name, setup=setup, seed=3)
    A = A_of(scene, scene.T_base_gripper)
    # Products of three transforms of order 1: rounding alone.
    assert np.abs(A @ scene.X @ scene.T_camera_target - scene.Z).max() < 1e-12
    again = target_poses(setup, scene.X, scene.Z, scene.T_base_gripper)
    assert np.abs(again - scene.T_camera_target).max() < 1e-12
    assert len(scene.robot_poses) == len(scene.observations.views) == len(scene.T_base_gripper)


def test_exact_observations_are_projections() -> None:
    scene = hand_eye_scene("exact", seed=1)
    for view, T in zip(scene.observations.views, scene.T_camera_target):
        assert np.abs(scene.camera.project(se3.apply(T, view.points)) - view.uv).max() < 1e-9
    assert np.abs(scene.robot_poses.T_base_gripper - scene.T_base_gripper).max() < 1e-12


def test_noise_has_the_size_it_says() -> None:
    scene = hand_eye_scene("noisy", seed=5, views=300)
    pixels = np.concatenate(
        [
            view.uv - scene.camera.project(se3.apply(T, view.points))
            for view, T in zip(scene.observations.views, scene.T_camera_target)
        ]
    )
    assert pixels.std() == pytest.approx(scene.sigma_px, rel=0.02)  # 37 800 values: 0.4 %
    delta = se3.local(scene.T_base_gripper, scene.robot_poses.T_base_gripper)
    assert np.rad2deg(delta[:, :3].std()) == pytest.approx(scene.sigma_deg, rel=0.1)  # 900 values: 2.4 %
    assert 1e3 * delta[:, 3:].std() == pytest.approx(scene.sigma_mm, rel=0.1)


def test_degenerate_motions_are_degenerate() -> None:
    turning = hand_eye_scene("parallel-axes").T_base_gripper[:, :3, :3]
    axes = so3.log(turning[1:] @ turning[0].T)
    assert np.linalg.matrix_rank(axes, tol=1e-9) == 1
    sliding = hand_eye_scene("pure-translation").T_base_gripper
    assert np.abs(so3.log(sliding[1:, :3, :3] @ sliding[0, :3, :3].T)).max() < 1e-12
    assert np.linalg.matrix_rank(sliding[1:, :3, 3] - sliding[0, :3, 3], tol=1e-3) == 3
    assert len(hand_eye_scene("two-poses").robot_poses) == 2


def test_faults_are_the_faults_named() -> None:
    good = hand_eye_scene("good", seed=2)
    shifted = hand_eye_scene("shifted-pairs", seed=2)
    assert np.array_equal(shifted.robot_poses.T_base_gripper[0], good.robot_poses.T_base_gripper[1])
    inverted = hand_eye_scene("inverted-poses", seed=2)
    assert np.allclose(inverted.robot_poses.T_base_gripper @ good.robot_poses.T_base_gripper, np.eye(4), atol=1e-12)
    flip = hand_eye_scene("one-flip", seed=2)
    changed = [not np.array_equal(a.points, b.points) for a, b in zip(good.observations.views, flip.observations.views)]
    assert sum(changed) == 1
    k = changed.index(True)
    flipped = flip.observations.views[k]
    uv = flip.camera.project(se3.apply(flip.measured_T_camera_target[k], flipped.points))
    assert np.abs(uv - flipped.uv).max() < 3  # the flipped pose explains the flipped numbers, to the pose's noise
    assert np.array_equal(flip.points[flipped.point_ids], flipped.points)


def test_the_peers_scene_is_in_view_and_made_quickly() -> None:
    start = time.perf_counter()
    scene = intrinsics_scene(3000)
    assert time.perf_counter() - start < 5  # 0.35 s on an idle machine
    assert len(scene.observations.views) == 3000
    uv = np.concatenate([v.uv for v in scene.observations.views])
    assert np.all((uv > 0) & (uv < [1279, 1023]))
    assert {len(v) for v in scene.observations.views} == {88}
    distance = scene.T_camera_target[:, 2, 3]
    assert distance.min() > 0.1
    assert distance.max() < 1.1


def test_seeds_differ_and_repeat() -> None:
    a, b, c = (hand_eye_scene("good", seed=s).observations.views[0].uv for s in (0, 0, 1))
    assert np.array_equal(a, b)
    assert not np.allclose(a, c)


def test_unknown_names_are_refused_with_the_known_ones() -> None:
    with pytest.raises(InputError, match="parallel-axes"):
        hand_eye_scene("perfect")
    with pytest.raises(InputError, match="eye-to-hand"):
        hand_eye_scene("good", setup="eye-on-base")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="does not fit"):
        look_at_board(standard_camera(), grid(50, 50, 0.03), 2, rng=np.random.default_rng(0))
