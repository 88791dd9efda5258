"""Errors of an arm's own geometry: seen where there are any, with their size, and not seen where there are none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import calibrant as cb
from calibrant.arrays import Array
from calibrant.calibrate.cell.calibrate import CellFit, fit_cell
from calibrant.calibrate.cell.certainty.accuracy import geometry_field
from calibrant.calibrate.cell.certainty.checks import geometry_check
from calibrant.calibrate.cell.certainty.geometry import RADIANS, REACH, TYPICAL, geometry_errors
from calibrant.calibrate.cell.certainty.pose_errors import PoseErrors, pose_errors
from calibrant.calibrate.cell.problem.groups import robot_groups
from calibrant.calibrate.cell.problem.layout import ONLY_ROBOT, Pictures, TargetPoses, poses_variable, variable
from calibrant.data.details import ArmError, ArmErrors
from calibrant.geometry import se3, so3
from calibrant.reports.parts.numbers import sigma_text
from calibrant.simulate.scenes import hand_eye_scene
from calibrant.simulate.truth import chi_square

NOISE = np.array([np.deg2rad(0.005)] * 3 + [5e-5] * 3)


def _cell(seed: int, metres: float, n: int = 16) -> tuple[tuple[cb.RobotPoses, Pictures], Array]:
    """Poses of an arm that is off by a field of this size, with the target poses seen, and the camera's true place."""
    scene, rng = hand_eye_scene("exact", views=n, seed=seed), np.random.default_rng(seed)
    E = geometry_field(scene.T_base_gripper, reach=REACH, radians=RADIANS)
    off = metres * (E @ rng.normal(size=E.shape[2])) + NOISE * rng.normal(size=(n, 6))
    said = np.array(scene.T_base_gripper)
    said[:, :3, :3] = so3.exp(off[:, :3]) @ said[:, :3, :3]
    said[:, :3, 3] += off[:, 3:]
    ids = tuple(str(i) for i in range(n))
    seen = Pictures("camera", "eye-in-hand", TargetPoses(ids, scene.T_camera_target))
    return (cb.RobotPoses(ids, said), seen), scene.X


def _fit(seed: int, metres: float) -> tuple[CellFit, Array]:
    (poses, seen), X = _cell(seed, metres)
    return fit_cell(poses, [seen]), X


def _errors(fit: CellFit) -> PoseErrors:
    found = pose_errors(fit.noise.solution, poses_variable(ONLY_ROBOT), robot_groups(ONLY_ROBOT))
    assert found is not None
    return found


def test_the_size_is_that_of_the_arm() -> None:
    found = geometry_errors(_errors(_fit(1, 1e-3)[0]))
    assert found is not None
    assert found.chance > 0.9
    # Most of a field is taken by the unknowns: its size is known to a factor.
    assert 0.3e-3 < found.metres < 3e-3
    assert not found.assumed


def test_an_arm_without_errors_has_none_and_a_bound_that_its_noise_sets() -> None:
    found = geometry_errors(_errors(_fit(1, 0.0)[0]))
    assert found is not None
    assert found.chance < 0.5
    assert found.metres < 5e-5
    assert 2e-5 < found.unseen < 3e-4


def test_in_other_units_of_time_and_noise_the_answer_is_the_same() -> None:
    errors = _errors(_fit(2, 5e-4)[0])
    # All noise twice as large, and what was said off by twice as much: everything is twice as large.
    scaled = replace(errors, gradient=errors.gradient / 2, information=errors.information / 4, pull=errors.pull / 4)
    scaled = replace(scaled, covariance=4 * errors.covariance)
    one, two = geometry_errors(errors), geometry_errors(scaled)
    assert one is not None
    assert two is not None
    assert two.chance == pytest.approx(one.chance)
    assert two.metres == pytest.approx(2 * one.metres)
    np.testing.assert_allclose(two.covariance, 4 * one.covariance, rtol=1e-6, atol=1e-9 * np.abs(one.covariance).max())


def test_what_could_be_moves_as_errors_of_poses_do() -> None:
    errors = _errors(_fit(3, 0.0)[0])
    found = geometry_errors(errors)
    assert found is not None
    moved = found.unseen * errors.moved(geometry_field(errors.T_base_gripper, reach=REACH, radians=RADIANS))
    np.testing.assert_allclose(found.could_add, moved @ moved.T, atol=1e-9 * np.abs(found.could_add).max())


def test_poses_that_tell_nothing_have_a_size_that_is_assumed() -> None:
    errors = _errors(_fit(1, 0.0)[0])
    coarse = replace(errors, gradient=errors.gradient / 10, information=errors.information / 100)
    coarse = replace(coarse, pull=errors.pull / 100, covariance=100 * errors.covariance)
    found = geometry_errors(coarse)
    assert found is not None
    assert found.assumed
    assert found.unseen == TYPICAL


def test_the_result_says_the_size() -> None:
    (poses, seen), _ = _cell(1, 0.0)
    assert cb.calibrate_cell(poses, [seen], robot_accuracy="0.1mm").detail(ArmErrors) is None
    result = cb.calibrate_cell(poses, [seen])
    errors = result.detail(ArmErrors)
    assert errors is not None
    said = errors.robots[ONLY_ROBOT]
    assert result.check("robot-geometry").value == pytest.approx(said.camera_mm)
    assert f"{said.camera_mm:.2g} mm" in result.check("robot-geometry").message
    words = " ".join(result.summary().split())
    assert f"geometry errs by without showing it: {sigma_text(said.camera_mm)} mm (" in words


def test_the_words_name_what_is_held_what_is_assumed_and_what_helps() -> None:
    plain = geometry_check(ArmError(0.02, 0.1, 0.2, False), seen=False, identified=False).message
    assert "0.1 mm at the flange (95 %)" in plain
    assert "holds" not in plain
    assert "--identify" in plain
    seen = geometry_check(ArmError(0.5, 0.65, 0.2, True), seen=True, identified=True).message
    assert "off by 0.5 mm, which sigma holds" in seen
    assert "assumed" in seen
    assert "--identify" not in seen


@pytest.mark.statistics
def test_sigma_holds_smooth_errors_and_is_as_it_was_without() -> None:
    off: dict[float, list[float]] = {1e-3: [], 0.0: []}
    for metres, errors in off.items():
        for seed in range(30):
            fit, X = _fit(seed, metres)
            solution, name = fit.noise.solution, variable(fit.cell.layout.unknown[0])
            errors.append(chi_square(se3.local(X, solution.value(name)[0]), solution.covariance(name)) / 6)
    # Thirty means of six squares: 1 +- 0.11 where sigma is true.
    assert np.mean(off[1e-3]) < 1.5
    assert 0.6 < np.mean(off[0.0]) < 1.2
