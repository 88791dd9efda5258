"""Uncertainty in the workspace: parsing, geometry, and that errors are as large as predicted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import chi2

from calibrant.calibrate.cell.hand_eye import calibrate_hand_eye
from calibrant.calibrate.cell.problem.camera_role import prior_camera
from calibrant.calibrate.cell.problem.groups import lens_variable, pixel_group, robot_groups
from calibrant.calibrate.cell.problem.problem import cell_of_one, cell_problem
from calibrant.calibrate.solvers.setup import get_setup
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult
from calibrant.diagnose.budget.cell import error_budget
from calibrant.diagnose.budget.volume import Volume, parse_coordinate, parse_fraction, parse_volume
from calibrant.diagnose.budget.workspace import (
    asked_workspace,
    point_jacobian,
    radius_mm,
    sigma_mm,
    with_workspace,
    workspace_check,
    workspace_uncertainty,
)
from calibrant.errors import InputError
from calibrant.geometry import se3
from calibrant.optimize.levenberg_marquardt import solve
from calibrant.simulate.noise import noisy_poses
from calibrant.simulate.scenes import hand_eye_scene, observe
from calibrant.simulate.truth import chi_square

Array = NDArray[np.float64]
VOLUME = "400mm:700mm,-200mm:100mm,0mm:100mm"
SIGMA = np.array([0.5, 0.5, 0.4, 0.4, 1e-3, 3e-3, 5e-5, 5e-5, 3e-3])


@pytest.fixture(scope="module")
def eye_to_hand() -> CalibrationResult:
    scene = hand_eye_scene("good", setup="eye-to-hand")
    camera = replace(scene.camera, covariance=np.diag(SIGMA**2))
    return calibrate_hand_eye(scene.robot_poses, scene.observations, setup="eye-to-hand", camera=camera)


@pytest.fixture(scope="module")
def eye_in_hand() -> CalibrationResult:
    scene = hand_eye_scene("good")
    return calibrate_hand_eye(scene.robot_poses, scene.observations, setup="eye-in-hand", camera=scene.camera)


def test_volumes_are_read_with_their_units() -> None:
    volume = parse_volume("300mm:0.7m,-20cm:200mm, 0mm:100mm")
    assert volume == Volume((0.3, -0.2, 0.0), (0.7, 0.2, 0.1))
    assert parse_volume(volume.text) == volume
    np.testing.assert_allclose(volume.centre, [0.5, 0.0, 0.05])
    assert volume.grid((3, 4, 5)).shape == (3, 4, 5, 3)
    assert Volume((0, 0, 0.1), (1, 1, 0.1)).grid((3, 4, 5)).shape == (3, 4, 1, 3)
    assert parse_coordinate("-1in", what="x") == pytest.approx(-0.0254)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("300mm:700mm,0mm:1mm", "three ranges"),
        ("300:700mm,0mm:1mm,0mm:1mm", "no unit"),
        ("0:700mm,0mm:1mm,0mm:1mm", "no unit"),
        ("0ft:700mm,0mm:1mm,0mm:1mm", "unknown unit"),
        ("700mm:300mm,0mm:1mm,0mm:1mm", "lower end comes first"),
        ("a:b,0mm:1mm,0mm:1mm", "not a length"),
    ],
)
def test_unreadable_volumes_are_refused_by_name(text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        parse_volume(text)


def test_percent() -> None:
    assert parse_fraction("0.05%", what="x") == pytest.approx(5e-4)
    for text in ("0.05", "-1%", "100%", "nan%", "much"):
        with pytest.raises(InputError, match="percent"):
            parse_fraction(text, what="x")


def test_radius_holds_95_percent_of_the_errors() -> None:
    rng = np.random.default_rng(0)
    for scales in ([1, 1, 1], [1, 0.5, 0.1], [1, 0, 0]):
        C = np.diag(np.array(scales, dtype=float) ** 2) * 1e-6
        errors = rng.standard_normal((200_000, 3)) * scales
        share = np.mean(np.linalg.norm(errors, axis=1) < radius_mm(C))
        # The two moments are exact, the quantile is not: published errors of the approximation are below 1 %.
        assert share == pytest.approx(0.95, abs=0.01)
        assert sigma_mm(C) == pytest.approx(1.0)


def test_jacobian_of_a_seen_point_against_differences(eye_to_hand: CalibrationResult) -> None:
    budget = error_budget(eye_to_hand)
    assert budget.camera is not None
    camera, p = budget.camera, np.array([[0.1, -0.05, 0.9]])
    T_base_parent = se3.exp([0.2, -0.4, 0.3, 0.1, 0.2, 0.3])
    J = point_jacobian(budget.X, camera, p, T_base_parent)[0]
    uv = camera.project(p)

    def point(delta: Array) -> Array:
        changed = Camera(camera.model, camera.image_size, camera.values + delta[12:])
        ray = changed.unproject(uv)
        return se3.apply(T_base_parent @ se3.retract(budget.X, delta[:6]), ray / ray[:, 2:] * p[0, 2])[0]

    for i in range(12 + len(camera.values)):
        # Steps of a thousandth of a sigma for the camera, of a micrometre for the mounting.
        step = np.zeros(12 + len(camera.values))
        step[i] = 1e-6 if i < 12 else 1e-3 * SIGMA[i - 12]
        difference = (point(step) - point(-step)) / (2 * step[i])
        np.testing.assert_allclose(J[:, i], difference, rtol=1e-4, atol=1e-7 * max(1, np.abs(difference).max()))


@pytest.mark.statistics
def test_errors_are_as_large_as_predicted() -> None:
    # A point seen by a camera whose intrinsics came with errors that the mounting has to absorb.
    scene = hand_eye_scene("exact", setup="eye-to-hand")
    setup, rng = get_setup("eye-to-hand"), np.random.default_rng(3)
    rotation, translation = robot_groups("robot")
    sigmas = {pixel_group("camera"): 0.2, rotation: 3e-4, translation: 1e-4}
    lens = lens_variable("camera")
    point = np.array([0.6, -0.1, 0.05])
    uv = scene.camera.project(se3.apply(se3.inverse(scene.X), point))
    depth = se3.apply(se3.inverse(scene.X), point)[2]
    normalised = []
    for _ in range(40):
        seen = observe(scene.camera, scene.points, scene.T_camera_target, sigma_px=0.2, rng=rng)
        robot = noisy_poses(scene.T_base_gripper, sigma_mm=0.1, sigma_deg=np.rad2deg(3e-4), rng=rng)
        camera = replace(
            scene.camera, values=scene.camera.values + SIGMA * rng.standard_normal(9), covariance=np.diag(SIGMA**2)
        )
        cell = cell_of_one(setup, robot, seen.views, prior_camera(camera))
        fit = solve(cell_problem(cell, cell.placed(scene.X, scene.Z), sigmas))
        X, covariance = fit.value("T_base_camera")[0], fit.covariance(lens)
        found = Camera(camera.model, camera.image_size, fit.value(lens)[0], covariance)
        ray = found.unproject(uv)
        error = se3.apply(X, ray / ray[2] * depth) - point
        joint = fit.joint_covariance([("T_base_camera", 0), ("T_gripper_target", 0), (lens, 0)])
        J = point_jacobian(X, found, ray / ray[2] * depth, np.eye(4))
        normalised.append(chi_square(error, J @ joint @ J.T))
    # 3 degrees of freedom each: the sum is chi-square with 120; a 1 in 1000 two-sided bound.
    low, high = chi2.ppf([0.0005, 0.9995], 3 * len(normalised))
    assert low < np.sum(normalised) < high


def test_map_and_numbers_agree(eye_to_hand: CalibrationResult) -> None:
    found = workspace_uncertainty(eye_to_hand, parse_volume(VOLUME), steps=(3, 3, 3))
    assert found.sigma_mm.shape == (3, 3, 3)
    assert found.worst.sigma_mm == pytest.approx(found.sigma_mm.flat[np.argmax(found.radius_mm)])
    assert found.centre.sigma_mm == pytest.approx(found.sigma_mm[1, 1, 1], rel=1e-9)
    assert found.sigma_mm.min() <= found.mean_mm <= found.sigma_mm.max()
    assert sum(found.worst.shares.values()) == pytest.approx(1.0)
    assert found.worst.radius_mm > found.worst.sigma_mm
    # The camera's own figure is the file's.
    covariance = eye_to_hand.transforms[0].covariance
    assert covariance is not None
    alone = workspace_uncertainty(eye_to_hand, parse_volume(VOLUME), target_sigma=0.0, steps=(2, 2, 2))
    assert alone.camera_mm == pytest.approx(sigma_mm(covariance[3:, 3:]), rel=1e-2)
    assert alone.worst.sigma_mm < found.worst.sigma_mm


def test_eye_in_hand_looks_from_its_own_poses(eye_in_hand: CalibrationResult) -> None:
    near = workspace_uncertainty(eye_in_hand, parse_volume(VOLUME), steps=(3, 3, 2))
    far = workspace_uncertainty(eye_in_hand, Volume((-0.9, -0.5, 0.0), (-0.8, -0.4, 0.1)), steps=(2, 2, 2))
    assert near.visible.mean() > 0.5
    assert not far.visible.any()
    # Where no pose of the calibration looks, the camera is brought there: the same figure everywhere.
    assert np.ptp(far.sigma_mm) < 1e-9
    assert "seen from no pose" in workspace_check(far).message


def test_tolerance_passes_and_fails(eye_to_hand: CalibrationResult) -> None:
    good = with_workspace(eye_to_hand, VOLUME, tolerance="20mm")
    assert good.check("workspace").status == "ok"
    assert good.verdict == eye_to_hand.verdict
    bad = with_workspace(eye_to_hand, VOLUME, tolerance="0.05mm", target_sigma="0.1%")
    assert bad.verdict == "refused"
    assert "NOT within the tolerance of 0.05 mm" in bad.check("workspace").message
    assert "target" in bad.check("workspace").message
    again = asked_workspace(bad)
    assert list(again) == ["camera"]
    assert again["camera"].worst.radius_mm == pytest.approx(bad.check("workspace").value)
    assert asked_workspace(eye_to_hand) == {}


def test_a_workspace_behind_the_camera_is_refused(eye_to_hand: CalibrationResult) -> None:
    with pytest.raises(InputError, match="behind the camera"):
        workspace_uncertainty(eye_to_hand, Volume((0.4, -0.1, 2.0), (0.5, 0.1, 2.1)), steps=(2, 2, 2))
