"""Hand-eye calibration as a whole: exact without noise, honest with it, and of faulty data."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibrant.calibrate.cell.hand_eye import calibrate_hand_eye
from calibrant.data import CalibrationResult, RobotPoses
from calibrant.errors import InputError
from calibrant.simulate.scenes import HandEyeScene, Setup, hand_eye_scene
from calibrant.simulate.truth import normalised

SETUPS: list[Setup] = ["eye-in-hand", "eye-to-hand"]


@pytest.fixture(scope="module")
def good() -> HandEyeScene:
    return hand_eye_scene("good", views=12)


@pytest.fixture(scope="module")
def result(good: HandEyeScene) -> CalibrationResult:
    return calibrate_hand_eye(good.robot_poses, good.observations, setup=good.setup)


def normalised_errors(result: CalibrationResult, scene: HandEyeScene) -> list[float]:
    """d^T C^-1 d of X and of Z, each chi-square with 6 degrees of freedom."""
    errors = []
    for estimate, truth in zip(result.transforms, (scene.X, scene.Z)):
        errors.append(normalised(estimate, truth))
    return errors


@pytest.mark.parametrize("setup", SETUPS)
def test_exact_without_noise(setup: Setup) -> None:
    scene = hand_eye_scene("exact", setup=setup, views=5)
    for target in (scene.observations, scene.measured_T_camera_target):
        found = calibrate_hand_eye(scene.robot_poses, target, setup=setup)
        # The fit ends within its floors of noise, 1e-6 rad and 1e-7 m, of the truth.
        assert np.abs(found.transforms[0].matrix - scene.X).max() < 1e-6
        assert np.abs(found.transforms[1].matrix - scene.Z).max() < 1e-6


@pytest.mark.statistics
def test_noise_and_covariance_tell_the_truth() -> None:
    errors, levels = [], []
    for seed, setup in enumerate(SETUPS * 2):
        scene = hand_eye_scene("good", setup=setup, seed=seed, views=9)
        found = calibrate_hand_eye(scene.robot_poses, scene.observations, setup=setup, camera=scene.camera)
        errors += normalised_errors(found, scene)
        assert found.sigma_robot is not None
        assert found.sigma_px is not None
        levels.append([found.sigma_px, found.sigma_robot.mm, found.sigma_robot.deg])
    # X and Z of one cell are correlated: at worst 4 independent chi-squares of 6, whose mean has a sigma of 1.7.
    assert 1 < np.mean(errors) < 6 + 5 * 1.7
    # Noise levels from some 20 degrees of freedom each, four times: 8 % of one sigma.
    assert np.mean(levels, axis=0) == pytest.approx([0.1, 0.05, 0.01], rel=0.4)


def test_what_a_result_carries(good: HandEyeScene, result: CalibrationResult) -> None:
    assert [(t.parent, t.child) for t in result.transforms] == [("gripper", "camera"), ("base", "target")]
    assert {"tsai", "park", "horaud", "andreff", "daniilidis", "shah", "li", "joint"} <= set(result.methods)
    assert result.held_out is not None
    assert result.held_out.mm is not None
    assert 0.01 < result.held_out.mm < 1
    assert result.target_scale is not None
    assert abs(result.target_scale.value - 1) < 5 * result.target_scale.sigma
    assert result.check("views").message.startswith("12 of 12 poses used")
    assert "±" in result.check("target-size").message
    assert result.robot_poses is good.robot_poses


def test_one_board_turned_by_180_degrees_is_left_out(good: HandEyeScene) -> None:
    scene = hand_eye_scene("one-flip")
    found = calibrate_hand_eye(scene.robot_poses, scene.observations, setup="eye-in-hand")
    assert [v.id for v in found.views if not v.used] == ["7"]
    assert "180 deg from where the others do" in (found.views[7].reason or "")
    # Below chi-square of 6 degrees at P = 1e-3.
    assert max(normalised_errors(found, scene)) < 22.5


def test_one_wrong_robot_pose_is_left_out(good: HandEyeScene) -> None:
    T = good.robot_poses.T_base_gripper.copy()
    T[4, :3, 3] += [0.004, 0, 0]
    found = calibrate_hand_eye(RobotPoses.from_matrices(T), good.observations, setup="eye-in-hand", camera=good.camera)
    assert [v.id for v in found.views if not v.used] == ["4"]


@pytest.mark.parametrize("given", [True, False])
def test_photos_that_do_not_serve_are_listed_with_the_reason(good: HandEyeScene, given: bool) -> None:
    views = list(good.observations.views)
    row = np.arange(63)
    views[3] = views[3].subset(row < 3)
    views[5] = views[5].subset(row < 8)
    uv = views[6].uv.copy()
    uv[[1, 2]] += [20.0, 5.0]
    views[6] = replace(views[6], uv=uv)
    views[8] = replace(views[8], uv=views[8].uv[np.random.default_rng(0).permutation(63)])
    seen = replace(good.observations, views=tuple(views))
    camera = good.camera if given else None
    found = calibrate_hand_eye(good.robot_poses, seen, setup="eye-in-hand", camera=camera)
    by_id = {v.id: v for v in found.views}
    assert set(by_id) == {str(i) for i in range(12)}
    assert {i for i, v in by_id.items() if not v.used} == {"3", "5", "8"}
    assert "3 points" in (by_id["3"].reason or "")
    assert "lie on a line" in (by_id["5"].reason or "")
    assert "the board was misread" in (by_id["8"].reason or "")
    assert by_id["6"].points_left_out == 2
    assert found.check("views").message.startswith("9 of 12 poses used")
    assert max(normalised_errors(found, good)) < 22.5


def test_a_board_of_another_size_is_noticed(good: HandEyeScene) -> None:
    larger = replace(
        good.observations, views=tuple(replace(v, points=1.03 * v.points) for v in good.observations.views)
    )
    found = calibrate_hand_eye(good.robot_poses, larger, setup="eye-in-hand", camera=good.camera)
    assert found.check("target-size").status == "warn"
    assert found.target_scale is not None
    assert found.target_scale.value == pytest.approx(1 / 1.03, abs=5 * found.target_scale.sigma)


def test_unusable_input_is_named(good: HandEyeScene) -> None:
    with pytest.raises(InputError, match="unknown setup 'static'; choose eye-in-hand or eye-to-hand"):
        calibrate_hand_eye(good.robot_poses, good.observations, setup="static")
    with pytest.raises(InputError, match="12 robot poses but 5 target poses"):
        calibrate_hand_eye(good.robot_poses, good.T_camera_target[:5], setup="eye-in-hand")
    with pytest.raises(InputError, match="5 robot poses without names but 12 views"):
        calibrate_hand_eye(good.robot_poses.T_base_gripper[:5], good.observations, setup="eye-in-hand")
    other = RobotPoses.from_matrices(good.robot_poses.T_base_gripper, ids=[f"p{i}" for i in range(12)])
    with pytest.raises(InputError, match="no robot pose for 12 of 12 views, the first is '0'"):
        calibrate_hand_eye(other, good.observations, setup="eye-in-hand")
    mirrored = good.robot_poses.T_base_gripper.copy()
    mirrored[2, :3, 0] *= -1
    with pytest.raises(InputError, match=r"T_base_gripper\[2\]"):
        calibrate_hand_eye(mirrored, good.observations, setup="eye-in-hand")
