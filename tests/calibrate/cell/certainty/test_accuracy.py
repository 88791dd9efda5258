"""A robot's accuracy, told: read as typed, in sigma for any number of poses, true for arms with wrong links."""

from __future__ import annotations

import numpy as np
import pytest

import calibrant as cb
from calibrant.calibrate.cell.calibrate import fit_cell
from calibrant.calibrate.cell.certainty.accuracy import RobotAccuracy, accuracy_shares, robot_accuracy
from calibrant.calibrate.cell.certainty.pose_errors import pose_errors
from calibrant.calibrate.cell.problem.groups import robot_groups
from calibrant.calibrate.cell.problem.layout import ONLY_ROBOT, Pictures, TargetPoses, poses_variable
from calibrant.errors import InputError
from calibrant.geometry import se3
from calibrant.robots.arms import arm
from calibrant.robots.dh import DHChain
from calibrant.simulate.arm import choose_views
from calibrant.simulate.cell import make_cell, observe_cell
from calibrant.simulate.scenes import grid, hand_eye_scene, standard_camera, standard_mounting
from calibrant.simulate.truth import chi_square


def test_it_is_read_as_typed() -> None:
    assert robot_accuracy("0.3mm") == RobotAccuracy(0.0003)
    assert robot_accuracy(3e-4) == RobotAccuracy(0.0003)
    told = robot_accuracy("0.3mm, 0.02deg")
    assert told.radians == pytest.approx(np.deg2rad(0.02))
    assert robot_accuracy(told.text).text == told.text == "0.3mm,0.02deg"


@pytest.mark.parametrize(
    "text", ["0.3", "0mm", "-1mm", "0.3mm,0.02", "0.3mm,0.02rad", "0.3mm,", "good", 0.0, float("nan")]
)
def test_what_is_no_accuracy_is_refused(text: str | float) -> None:
    with pytest.raises(InputError, match="robot accuracy"):
        robot_accuracy(text)


@pytest.mark.long
def test_no_number_of_poses_averages_it() -> None:
    added = []
    for n in (20, 80):
        scene = hand_eye_scene("good", views=n, seed=1)
        seen = TargetPoses(scene.robot_poses.ids, scene.measured_T_camera_target)
        solution = fit_cell(scene.robot_poses, [Pictures("camera", "eye-in-hand", seen)]).noise.solution
        errors = pose_errors(solution, poses_variable(ONLY_ROBOT), robot_groups(ONLY_ROBOT))
        assert errors is not None
        shares = accuracy_shares(errors, RobotAccuracy(1e-3))
        np.testing.assert_allclose(accuracy_shares(errors, RobotAccuracy(2e-3)), 4 * shares, rtol=1e-9, atol=1e-20)
        added.append(np.sqrt(np.trace(shares[3:6, 3:6])))
    assert added[1] > 0.7 * added[0]
    assert 0.3e-3 < added[1] < 3e-3


def test_a_result_says_that_it_was_told_and_what_it_does() -> None:
    cell = make_cell(1, views=10)
    seen = observe_cell(cell, sigma_px=0.1)
    plain = cb.calibrate_hand_eye(cell.robot_poses, seen, setup="eye-in-hand")
    told = cb.calibrate_hand_eye(cell.robot_poses, seen, setup="eye-in-hand", robot_accuracy="1mm")
    np.testing.assert_array_equal(told.transforms[0].matrix, plain.transforms[0].matrix)
    assert told.options["robot_accuracy"] == "1mm"
    sigmas = [float(np.linalg.norm(np.asarray(r.transforms[0].sigma_translation_mm))) for r in (plain, told)]
    assert sigmas[1] > sigmas[0] + 0.2


def test_a_robot_that_is_not_there_is_named() -> None:
    cell = make_cell(1, views=10)
    pictures = [cb.Pictures("camera", "eye-in-hand", observe_cell(cell, sigma_px=0.1))]
    with pytest.raises(InputError, match="'left', which has no poses"):
        cb.calibrate_cell(cell.robot_poses, pictures, robot_accuracy={"left": "0.3mm"})


@pytest.mark.statistics
def test_sigma_is_true_for_arms_with_wrong_links_whose_accuracy_is_told() -> None:
    nominal, points, off = arm("ur5e"), grid(8, 6, 0.03), []
    assert isinstance(nominal, DHChain)
    X, Z = standard_mounting("eye-in-hand")
    for seed in range(30):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(10, 60))
        views = choose_views(nominal, standard_camera(), points, n, setup="eye-in-hand", X=X, Z=Z, rng=rng)
        scale = [1e-4 if p.unit == "m" else np.deg2rad(0.04) for p in nominal.parameters]
        true = nominal.moved(rng.normal(size=len(scale)) * scale).forward(views.q)
        far = float(np.sqrt(np.mean(np.sum((true - views.T_base_gripper)[:, :3, 3] ** 2, axis=1))))
        noise = rng.normal(size=(n, 6)) * np.array([1e-4] * 3 + [5e-5] * 3)
        B = se3.retract(se3.inverse(X) @ se3.inverse(true) @ Z, noise)
        result = cb.calibrate_hand_eye(views.T_base_gripper, B, setup="eye-in-hand", robot_accuracy=far)
        off.append(chi_square(se3.local(X, result.transforms[0].matrix), result.transforms[0].covariance) / 6)
    assert np.mean(off) < 1.5
    assert np.max(off) < 22.5 / 6
