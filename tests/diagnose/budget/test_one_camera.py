"""The error budget: its sum is the calibration's own covariance, its parts are what each source does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from calibrant.calibrate.cell.hand_eye import calibrate_hand_eye
from calibrant.calibrate.solvers.setup import get_setup
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult
from calibrant.diagnose.budget.cell import INTRINSICS, LEVELS, LOOP_SOURCES, TARGET, error_budget
from calibrant.diagnose.budget.views import PIXELS, ROBOT_ROTATION, ROBOT_TRANSLATION, NoiseLevels, view_information
from calibrant.errors import InputError
from calibrant.geometry import se3
from calibrant.simulate.scenes import Setup, hand_eye_scene

Array = NDArray[np.float64]


def uncertain(camera: Camera) -> Camera:
    """The camera with a covariance of the size that a calibration leaves."""
    sigma = np.array([0.5, 0.5, 0.4, 0.4, 1e-3, 3e-3, 5e-5, 5e-5, 3e-3])
    return replace(camera, covariance=np.diag(sigma**2))


def calibrated(setup: Setup, camera: str) -> CalibrationResult:
    scene = hand_eye_scene("good", setup=setup)
    known = {"given": uncertain(scene.camera), "held": scene.camera, "free": None}[camera]
    return calibrate_hand_eye(scene.robot_poses, scene.observations, setup=setup, camera=known)


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
@pytest.mark.parametrize("camera", ["given", "held", "free"])
def test_the_sum_is_the_covariance_of_the_joint_fit(setup: Setup, camera: str) -> None:
    result = calibrated(setup, camera)
    budget = error_budget(result, target_sigma=0.0)
    # The file holds poses and residuals to the last digit; weights of left-out points may differ in the fourth.
    for k, estimate in enumerate(result.transforms):
        own = budget.covariance[6 * k : 6 * k + 6, 6 * k : 6 * k + 6]
        assert estimate.covariance is not None
        assert_levels_explain(own, estimate.covariance)
    if camera != "held":
        np.testing.assert_allclose(budget.covariance[12:, 12:], result.camera.covariance, rtol=1e-9, atol=1e-30)
    else:
        assert np.all(budget.sources[INTRINSICS] == 0)
        assert "not counted" in budget.notes[0]


def assert_levels_explain(known_levels: np.ndarray, stated: np.ndarray) -> None:
    """The stated covariance also holds what the noise levels are uncertain by: the same for all directions in the
    budget, a few percent apart in the calibration."""
    ratios = np.linalg.eigvals(np.linalg.solve(known_levels, stated)).real
    assert ratios.min() > 0.75
    assert ratios.max() < 4 / 3


def test_pose_pairs_have_a_budget_too() -> None:
    scene = hand_eye_scene("good", setup="eye-to-hand")
    result = calibrate_hand_eye(scene.robot_poses, scene.measured_T_camera_target, setup="eye-to-hand")
    budget = error_budget(result, target_sigma=0.0)
    covariance = result.transforms[0].covariance
    assert covariance is not None
    assert_levels_explain(budget.covariance[:6, :6], covariance)
    assert set(budget.sources) == {*LOOP_SOURCES.values(), TARGET, LEVELS}


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_uncertain_levels_make_up_what_the_stated_covariance_has_more(setup: Setup) -> None:
    result = calibrated(setup, "given")
    budget = error_budget(result, target_sigma=0.0)
    share = budget.sources[LEVELS]
    stated = result.transforms[0].covariance
    assert stated is not None
    ratio = np.trace(np.linalg.solve(budget.covariance[:6, :6], stated)) / 6
    # Without it the ratio is 1.05 to 1.1.
    assert ratio == pytest.approx(1, abs=0.03)
    # 15 poses: 90 numbers for 12 unknowns and two levels of the robot, 2 / 40 to 2 / 5 more.
    noise = budget.sources[PIXELS] + budget.sources[ROBOT_ROTATION] + budget.sources[ROBOT_TRANSLATION]
    assert 0.02 < np.trace(np.linalg.solve(noise[:6, :6], share[:6, :6])) / 6 < 0.4
    old = replace(result, transforms=tuple(replace(t, covariance=None) for t in result.transforms))
    assert LEVELS not in error_budget(old).sources


def test_each_noise_source_scales_with_its_own_level_alone() -> None:
    # d C / d log sigma_k^2 = C S_k C: the share of a source is what its variance adds, to first order.
    scene = hand_eye_scene("good")
    levels = NoiseLevels(0.1, 2e-4, 5e-5)

    def covariance(noise: NoiseLevels) -> Array:
        views = view_information(
            get_setup("eye-in-hand"),
            scene.observations.views,
            scene.T_base_gripper,
            scene.camera,
            scene.X,
            scene.Z,
            noise,
        )
        H = np.sum([S.sum(axis=0) for S in views.values()], axis=0)
        return np.linalg.inv(H[:12, :12])

    views = view_information(
        get_setup("eye-in-hand"), scene.observations.views, scene.T_base_gripper, scene.camera, scene.X, scene.Z, levels
    )
    C, step = covariance(levels), 1e-3
    for source, field in (
        (PIXELS, "pixel"),
        (ROBOT_ROTATION, "robot_rotation"),
        (ROBOT_TRANSLATION, "robot_translation"),
    ):
        share = C @ views[source].sum(axis=0)[:12, :12] @ C
        up, down = (covariance(replace(levels, **{field: getattr(levels, field) * np.exp(s)})) for s in (step, -step))
        difference = (up - down) / (4 * step)  # sigma^2 changes by exp(2 s)
        np.testing.assert_allclose(share, difference, atol=1e-4 * np.abs(difference).max())


def test_a_wrong_target_size_moves_the_camera_as_the_budget_says() -> None:
    scene = hand_eye_scene("exact", setup="eye-to-hand")
    error = 1e-3
    views = tuple(replace(v, points=v.points * (1 + error)) for v in scene.observations.views)
    wrong = calibrate_hand_eye(
        scene.robot_poses, replace(scene.observations, views=views), setup="eye-to-hand", camera=scene.camera
    )
    moved = se3.local(scene.X, wrong.transforms[0].matrix)
    share = error_budget(wrong, target_sigma=error).sources[TARGET][:6, :6]
    # The points are too large by the error, so the estimate moves by the shift for +error: outer(shift, shift).
    np.testing.assert_allclose(np.sqrt(np.diag(share))[3:], np.abs(moved[3:]), rtol=0.02, atol=2e-6)


def test_other_results_are_refused_by_name() -> None:
    with pytest.raises(InputError, match="of kind 'intrinsics'"):
        error_budget(CalibrationResult("intrinsics", "ok"))
    result = calibrated("eye-in-hand", "held")
    with pytest.raises(InputError, match="neither observations nor target poses"):
        error_budget(replace(result, observations=None))
