"""Two cameras of different kinds in one problem: one factor a model, poses shared."""

from __future__ import annotations

import numpy as np
from tests.calibrate.lens_views import GRID, SIZE, board_poses

from calibrant.calibrate.reprojection.factor import ReprojectionFactor, StackedViews
from calibrant.calibrate.reprojection.links import Link
from calibrant.cameras import Camera
from calibrant.geometry import se3, so3
from calibrant.optimize.levenberg_marquardt import solve
from calibrant.optimize.manifolds import SE3, Variable, vector
from calibrant.optimize.problem import Problem

PIXELS = {"cx": 640.0, "cy": 512.0}
BROWN = Camera.create("brown", {**PIXELS, "fx": 900.0, "fy": 905.0, "k1": -0.2}, image_size=SIZE)
FISHEYE = Camera.create("kannala_brandt", {**PIXELS, "fx": 400.0, "fy": 402.0, "k1": -0.02}, image_size=SIZE)


def views(camera: Camera, T: np.ndarray) -> StackedViews:
    p = se3.apply(np.repeat(T, len(GRID), axis=0), np.tile(GRID, (len(T), 1)))
    offsets = len(GRID) * np.arange(len(T) + 1)
    return StackedViews(np.tile(GRID, (len(T), 1)), camera.project(p), np.ones(len(p)), offsets)


def test_a_brown_and_a_fisheye_camera_share_a_rig() -> None:
    """Both cameras' parameters, the boards' poses and the transform between the cameras, from disturbed values."""
    T = board_poses(12, reach_deg=15, distance=(0.4, 0.7))
    T_fisheye_brown = se3.make(so3.exp([0.1, -0.2, 0.05]), [-0.1, 0.02, 0.01])
    moments = np.arange(len(T))
    first = ReprojectionFactor(
        "brown", model=BROWN.model, camera="brown", links=[Link("T", moments)], views=views(BROWN, T)
    )
    second = ReprojectionFactor(
        "fisheye",
        model=FISHEYE.model,
        camera="fisheye",
        links=[Link("between", np.zeros(len(T), dtype=np.int64)), Link("T", moments)],
        views=views(FISHEYE, T_fisheye_brown @ T),
    )
    rng = np.random.default_rng(61)
    problem = Problem(
        (
            Variable("T", SE3(), se3.retract(T, rng.normal(0, 0.01, (len(T), 6)))),
            Variable("between", SE3(), se3.retract(T_fisheye_brown[None], rng.normal(0, 0.02, (1, 6)))),
            vector("brown", BROWN.values * 1.01, BROWN.model.parameter_names),
            vector("fisheye", FISHEYE.values * 1.01, FISHEYE.model.parameter_names),
        ),
        (first, second),
    )
    solution = solve(problem)
    assert solution.converged
    np.testing.assert_allclose(solution.value("between")[0], T_fisheye_brown, atol=1e-7)
    np.testing.assert_allclose(solution.value("brown")[0][:5], BROWN.values[:5], rtol=1e-5)
    np.testing.assert_allclose(solution.value("fisheye")[0][:5], FISHEYE.values[:5], rtol=1e-5)
