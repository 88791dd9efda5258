"""Every shape of problem that calibrations build has its optimum where SciPy's least_squares puts it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache

import numpy as np
import pytest
from scipy.optimize import least_squares

from calibrant.calibrate.cell.problem.camera_role import prior_camera
from calibrant.calibrate.cell.problem.groups import measured_groups, pixel_group, robot_groups
from calibrant.calibrate.cell.problem.problem import cell_of_one, cell_problem
from calibrant.calibrate.cell.rig import fit_rig
from calibrant.calibrate.intrinsics.one_model import calibrate_keeping
from calibrant.calibrate.intrinsics.target_shape import Flat, shape_of
from calibrant.calibrate.kinematics.identify import calibrate_kinematics
from calibrant.calibrate.kinematics.model import RobotModel
from calibrant.calibrate.kinematics.problem import model_problem
from calibrant.calibrate.reprojection.factor import stack
from calibrant.calibrate.solvers.setup import get_setup
from calibrant.cameras import Camera
from calibrant.data import Observations, View
from calibrant.geometry import se3, so3
from calibrant.optimize import Problem, Solution, solve
from calibrant.optimize.problem import Values
from calibrant.robots.arms import arm
from calibrant.simulate.robot_errors import SimulatedArm, measure, simulate_arm
from calibrant.simulate.scenes import grid, hand_eye_scene, intrinsics_scene, look_at_board, standard_camera


def intrinsics(seed: int) -> Solution:
    return calibrate_keeping(intrinsics_scene(6, seed=seed, columns=7, rows=5, square=0.04).observations).solution


def shaped(kind: str) -> Callable[[int], Solution]:
    def build(seed: int) -> Solution:
        scene = intrinsics_scene(7, seed=seed, columns=5, rows=4, square=0.06)
        kept = calibrate_keeping(scene.observations, fix=("k3",))
        flat = Flat(kept.solution, kept.views, stack(kept.views), kept.result.camera.model)
        return shape_of(kind)(flat).solution

    return build


def rig(seed: int) -> Solution:
    rng, camera, points = np.random.default_rng(seed), standard_camera(), grid(5, 4, 0.05)
    T_b_a = se3.make(so3.exp([0.02, 0.1, -0.03]), [-0.1, 0.01, 0.02])
    views = []
    for i, T in enumerate(look_at_board(camera, points, 5, rng=rng, distance=(0.6, 0.9), tilt_deg=40)):
        for name, M in (("a", T), ("b", T_b_a @ T)):
            uv = camera.project(se3.apply(M, points)) + 0.1 * rng.normal(size=(len(points), 2))
            views.append(View(f"{name}{i}", points, uv, np.arange(len(points)), camera=name, moment=str(i)))
    observations = Observations(tuple(views), {"a": camera.image_size, "b": camera.image_size})
    return fit_rig(observations, fix=("k3",)).noise.solution


def images(seed: int) -> Solution:
    setup = get_setup(("eye-in-hand", "eye-to-hand")[seed % 2])
    scene = hand_eye_scene("good", setup=setup.name, seed=seed, views=5)
    known = scene.camera
    camera = Camera(known.model, known.image_size, known.values, np.diag((1e-3 * np.abs(known.values) + 1e-4) ** 2))
    rotation, translation = robot_groups("robot")
    sigmas = {pixel_group("camera"): 0.1, rotation: 2e-4, translation: 5e-5}
    cell = cell_of_one(setup, scene.robot_poses.T_base_gripper, scene.observations.views, prior_camera(camera))
    return solve(cell_problem(cell, cell.placed(scene.X, scene.Z), sigmas, free_sizes=("target",)))


def pairs(seed: int) -> Solution:
    setup = get_setup(("eye-in-hand", "eye-to-hand")[seed % 2])
    scene = hand_eye_scene("noisy", setup=setup.name, seed=seed, views=6)
    rotation, translation = robot_groups("robot")
    sigmas = {measured_groups("camera")[0]: 1e-3, translation: 1e-3, rotation: 0.5e-3}
    cell = cell_of_one(setup, scene.robot_poses.T_base_gripper, scene.measured_T_camera_target)
    return solve(cell_problem(cell, cell.placed(scene.X, scene.Z), sigmas, free_sizes=("target",)))


def kinematics(seed: int) -> Solution:
    model, free, simulated = worn_arm()
    rng = np.random.default_rng(seed)
    measurements = measure(simulated, simulated.draw_joints(rng, 8), rng, sigma_mm=0.05, sigma_deg=0.01)
    return solve(model_problem(model, measurements, free))


@cache
def worn_arm() -> tuple[RobotModel, np.ndarray, SimulatedArm]:
    """The arm as drawn, the parameters that twenty measurements determine, and the arm as it is."""
    rng = np.random.default_rng(100)
    simulated = simulate_arm(arm("ur5e"), rng, sigma_mm=0.5, sigma_deg=0.1)
    measurements = measure(simulated, simulated.draw_joints(rng, 20), rng, sigma_mm=0.05, sigma_deg=0.01)
    found = calibrate_kinematics(measurements, simulated.nominal)
    return found.nominal, np.array([p.sigma is not None for p in found.parameters]), simulated


SHAPES: dict[str, Callable[[int], Solution]] = {
    "intrinsics": intrinsics,
    "paraboloid": shaped("paraboloid"),
    "free points": shaped("free"),
    "rig": rig,
    "hand-eye images": images,
    "pose pairs": pairs,
    "kinematics": kinematics,
}


def moved(problem: Problem, delta: np.ndarray) -> Values:
    """The start moved by one vector of all free tangents."""
    ends = np.cumsum([0, *(v.count * v.free_dim for v in problem.variables)])
    return tuple(
        value if not v.free_dim else v.manifold.retract(value, delta[a:b].reshape(v.count, v.free_dim))
        for v, value, a, b in zip(problem.variables, problem.start, ends[:-1], ends[1:])
    )


def whitened(problem: Problem, values: Values, sigmas: dict[str, float]) -> np.ndarray:
    parts = []
    for k, factor in enumerate(problem.factors):
        r = factor.residuals(*problem.gather(k, values))
        parts.append((r * (factor.weight / problem.sigma(factor, sigmas))[:, None]).ravel())
    return np.concatenate(parts)


QUICK = ("intrinsics", "paraboloid", "pose pairs", "kinematics")
"""Shapes whose first problem SciPy solves in a second or two; of the others it is a long test."""


def cases() -> Iterator[object]:
    """Every shape with its first problem, and with nineteen more."""
    for shape in SHAPES:
        yield pytest.param(shape, range(1), id=f"{shape}-first", marks=() if shape in QUICK else pytest.mark.long)
        yield pytest.param(shape, range(1, 20), id=f"{shape}-rest", marks=pytest.mark.long)


@pytest.mark.parametrize(("shape", "seeds"), list(cases()))
def test_cost_equals_scipys(shape: str, seeds: range) -> None:
    for seed in seeds:
        ours = SHAPES[shape](seed)
        assert ours.converged
        problem, sigmas = ours.problem, dict(ours.sigmas)

        # SciPy walks in the chart at our start: another parameterisation, the same minimum.
        def residuals(x: np.ndarray, problem: Problem = problem, sigmas: dict[str, float] = sigmas) -> np.ndarray:
            return whitened(problem, moved(problem, x), sigmas)

        x, cost = np.zeros(problem.free_count), np.inf
        # Its differences stop it a little early: from there once more, until the cost is still.
        for _ in range(5):
            theirs = least_squares(residuals, x, x_scale="jac", xtol=1e-15, ftol=1e-15, gtol=1e-15, max_nfev=100)
            x, before, cost = theirs.x, cost, theirs.cost
            if before - cost < 1e-10 * cost:
                break
        assert ours.cost == pytest.approx(cost, rel=1e-8)
