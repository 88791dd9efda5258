"""Consensus on the loop: two fifths wrong, nothing wrong, the same answer every time."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.calibrate.cell.starts.robust import relative_angles, robust_fit
from calibrant.geometry import se3, so3
from calibrant.simulate.scenes import hand_eye_scene


@pytest.mark.parametrize("seed", range(4))
def test_two_fifths_of_wrong_pairs_are_found_out(seed: int) -> None:
    scene = hand_eye_scene("good", seed=seed, views=20)
    wrong = np.random.default_rng(seed).choice(20, 8, replace=False)
    A = scene.robot_poses.T_base_gripper.copy()
    A[wrong] = A[np.roll(wrong, 1)]
    found = robust_fit(A, scene.measured_T_camera_target)
    np.testing.assert_array_equal(np.flatnonzero(found.outlier), np.sort(wrong))
    # Twelve good views leave about 0.1 mm; 1 mm is far from what any wrong view would do (100 mm).
    assert np.linalg.norm(found.X[:3, 3] - scene.X[:3, 3]) < 1e-3


@pytest.mark.statistics
def test_clean_views_are_hardly_ever_called_outliers() -> None:
    alarms = sum(
        bool(robust_fit(s.robot_poses.T_base_gripper, s.measured_T_camera_target).outlier.any())
        for s in (
            hand_eye_scene(name, seed=k, views=n) for name in ("good", "noisy") for n in (5, 15) for k in range(10)
        )
    )
    assert alarms <= 1  # OUTLIER_P is one in a thousand sets


def test_the_same_data_give_the_same_answer() -> None:
    scene = hand_eye_scene("one-flip", views=30)
    first, second = (robust_fit(scene.robot_poses.T_base_gripper, scene.measured_T_camera_target) for _ in range(2))
    np.testing.assert_array_equal(first.X, second.X)
    np.testing.assert_array_equal(first.p_value, second.p_value)


def test_uncertain_views_may_deviate_more() -> None:
    scene = hand_eye_scene("good", views=15)
    B = scene.measured_T_camera_target.copy()
    B[3] = se3.retract(B[3], [0, 0, 0, 0.003, 0, 0])
    A = scene.robot_poses.T_base_gripper
    assert robust_fit(A, B).outlier[3]
    certainty = np.ones(15)
    certainty[3] = 10.0
    assert not robust_fit(A, B, certainty=certainty).outlier[3]


def test_relative_angles_are_those_of_the_logarithm() -> None:
    R = so3.random(np.random.default_rng(0), 5)
    T = se3.make(R, np.zeros((5, 3)))
    expected = np.array([[so3.angle(a.T @ b) for b in R] for a in R])
    np.testing.assert_allclose(relative_angles(T), expected, atol=1e-7)
