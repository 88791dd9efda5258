"""Steps without some poses: the same as of a problem that never had them."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.calibrate.cell.problem.camera_role import CameraRole
from calibrant.calibrate.cell.problem.fit_without import pose_shares
from calibrant.calibrate.cell.problem.groups import lens_variable, pixel_group, robot_groups
from calibrant.calibrate.cell.problem.layout import poses_variable
from calibrant.calibrate.cell.problem.problem import cell_of_one, cell_problem
from calibrant.calibrate.solvers.setup import get_setup
from calibrant.optimize import linear
from calibrant.optimize.noise import estimate_noise
from calibrant.optimize.problem import Problem
from calibrant.optimize.solution import Solution
from calibrant.simulate.scenes import Setup, hand_eye_scene

VIEWS = 12
POSES, LENS = poses_variable("robot"), lens_variable("camera")
LEFT_OUT = [(3,), (0, 5, 11)]
SHARE = 1e-6
"""Of the step: both ways take the same differences of sums, in another order."""


@pytest.mark.parametrize("out", LEFT_OUT)
@pytest.mark.parametrize("name", ["eye-in-hand", "eye-to-hand"])
def test_pose_pairs_as_a_problem_without_them(name: Setup, out: tuple[int, ...]) -> None:
    scene, setup = hand_eye_scene("good", views=VIEWS, seed=3, setup=name), get_setup(name)
    robot, B = scene.robot_poses.T_base_gripper, scene.measured_T_camera_target
    whole = cell_of_one(setup, robot, B)
    levels = whole.levels((1e-4, 1e-4))
    fit = estimate_noise(cell_problem(whole, whole.placed(scene.X, scene.Z), levels), floors=whole.floors()).solution
    keep = ~np.isin(np.arange(VIEWS), out)
    X, Z = fit.value(setup.camera_transform)[0], fit.value(setup.target_transform)[0]
    rest = cell_problem(whole.kept([keep]), whole.placed(X, Z), fit.sigmas)
    assert_same_step(fit, rest, keep, (setup.camera_transform, setup.target_transform))


@pytest.mark.parametrize("out", LEFT_OUT)
def test_images_as_a_problem_without_them(out: tuple[int, ...]) -> None:
    """With a camera of which some parameters are held and the others have a prior."""
    scene, setup = hand_eye_scene("good", views=VIEWS, seed=4), get_setup("eye-in-hand")
    names = scene.camera.model.parameter_names
    root = 1e-2 * np.eye(len(names))[1:]
    role = CameraRole(scene.camera, names[:1], root)
    robot, views = scene.robot_poses.T_base_gripper, scene.observations.views
    whole = cell_of_one(setup, robot, views, role)
    rotation, translation = robot_groups("robot")
    levels = {pixel_group("camera"): 0.1, rotation: 1e-4, translation: 1e-4}
    fit = estimate_noise(cell_problem(whole, whole.placed(scene.X, scene.Z), levels), floors=whole.floors()).solution
    keep = ~np.isin(np.arange(VIEWS), out)
    X, Z = fit.value(setup.camera_transform)[0], fit.value(setup.target_transform)[0]
    rest = cell_problem(whole.kept([keep]), whole.placed(X, Z), fit.sigmas)
    assert_same_step(fit, rest, keep, (setup.camera_transform, setup.target_transform, LENS))


def test_nothing_where_too_few_poses_are_left() -> None:
    """One pose determines neither transform: the step is refused, not made up."""
    scene, setup = hand_eye_scene("good", views=4, seed=3), get_setup("eye-in-hand")
    whole = cell_of_one(setup, scene.robot_poses.T_base_gripper, scene.measured_T_camera_target)
    problem = cell_problem(whole, whole.placed(scene.X, scene.Z), whole.levels((1e-4, 1e-4)))
    shares = pose_shares(estimate_noise(problem, floors=whole.floors()).solution, POSES)
    found = None if shares is None else shares.without(np.array([True, True, True, False]))
    assert found is None or found[1] > 5.0  # of rounding at best: far beyond what a step is trusted with


def assert_same_step(fit: Solution, rest: Problem, keep: np.ndarray, names: tuple[str, ...]) -> None:
    """The shared unknowns and the predicted decrease, against the equations of the problem without the poses."""
    start = list(rest.start)
    start[rest.variable_index(POSES)] = fit.value(POSES)[keep]
    if LENS in names:
        start[rest.variable_index(LENS)] = fit.value(LENS)
    step = linear.solve(rest.linearize(tuple(start), rest.sigmas), 0.0)
    assert step is not None
    expected = rest.retract(tuple(start), step)
    shares = pose_shares(fit, POSES)
    assert shares is not None
    found = shares.without(~keep)
    assert found is not None
    for name in names:
        before, new = fit.value(name), found[0][fit.problem.variable_index(name)]
        wanted = expected[rest.variable_index(name)]
        size = np.abs(wanted - before).max()
        assert size > 1e-8  # leaving poses out moves it: the comparison says something
        np.testing.assert_allclose(new, wanted, rtol=0, atol=SHARE * size)
    assert found[1] == pytest.approx(step.predicted, rel=SHARE)
