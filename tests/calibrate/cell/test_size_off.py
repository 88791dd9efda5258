"""A board of another size than given: sigma holds what it moves, and beyond a tenth there is no calibration."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibrant.calibrate.cell.hand_eye import calibrate_hand_eye
from calibrant.data import CalibrationResult, RobotPoses
from calibrant.errors import RefusedError
from calibrant.simulate.scenes import HandEyeScene, hand_eye_scene
from calibrant.simulate.truth import normalised


def calibrated(scene: HandEyeScene, given: float) -> CalibrationResult:
    """The scene's views with the board said to be `given` times as large as it is."""
    views = tuple(replace(v, points=v.points * given, moment=v.id) for v in scene.observations.views)
    poses = RobotPoses(tuple(v.id for v in views), scene.robot_poses.T_base_gripper)
    return calibrate_hand_eye(poses, replace(scene.observations, views=views), setup=scene.setup)


@pytest.mark.parametrize("given", [0.99, 1.05])
@pytest.mark.parametrize("seed", [0, 3])
def test_sigma_holds_what_it_moves(given: float, seed: int) -> None:
    """Where a per cent moves the camera by 7 mm, with 0.2 mm of noise: the error is within its sigma."""
    scene = hand_eye_scene("good", views=15, seed=seed)
    result = calibrated(scene, given)
    estimate = result.transforms[0]
    assert 1e3 * np.linalg.norm(estimate.matrix[:3, 3] - scene.X[:3, 3]) > 4
    assert normalised(estimate, scene.X) / 6 < 2.8  # chi-square with 6 degrees of freedom, P = 0.01
    assert result.verdict == "warn"
    assert np.all(np.asarray(estimate.sigma_translation_mm) < 40)


def test_beyond_a_tenth_there_is_none() -> None:
    with pytest.raises(RefusedError, match=r"the target is 0\.83.*--target-scale free"):
        calibrated(hand_eye_scene("good", views=15), 1.2)
