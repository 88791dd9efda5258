"""Views that move while their rows are read: motions and camera estimated together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import calibrant as cb
from calibrant.arrays import Array
from calibrant.calibrate.intrinsics.one_model import calibrate_keeping
from calibrant.calibrate.intrinsics.rolling_factor import MotionPrior, RollingFactor
from calibrant.calibrate.reprojection.factor import stack
from calibrant.calibrate.review.residuals import fitted_poses, view_residuals
from calibrant.calibrate.review.target_points import in_motion, readout_time
from calibrant.data import Observations
from calibrant.data.details import RollingShutter
from calibrant.errors import InputError
from calibrant.geometry import se3
from calibrant.simulate.scenes import IMAGE_SIZE, IntrinsicsScene, intrinsics_scene

HEIGHT = IMAGE_SIZE[1]


def moving(px: float, *, sigma: float, seed: int, views: int = 20) -> tuple[IntrinsicsScene, Observations, Array]:
    """A scene whose target moves by px (one sigma an axis) over the readout, as it is seen, and the motions (m, 6)."""
    scene, rng = intrinsics_scene(views, seed=seed, sigma_px=0.0), np.random.default_rng(seed + 100)
    seen, motions = [], []
    for T, view in zip(scene.T_camera_target, scene.observations.views):
        per_px = 1 / scene.camera.parameters["fx"]
        distance = np.linalg.norm(T[:3, 3])
        x = px * per_px * np.concatenate([0.5 * rng.normal(size=3), distance * rng.normal(size=3)])
        uv, centre = view.uv, view.points.mean(axis=0, keepdims=True)
        for _ in range(60):  # a point is seen in the row where it is when that row is read
            p = in_motion(view.points, centre, x[None], readout_time(uv[:, 1], HEIGHT))
            uv = scene.camera.project(se3.apply(T, p))
        seen.append(replace(view, uv=uv + sigma * rng.normal(size=uv.shape)))
        motions.append(x)
    return scene, replace(scene.observations, views=tuple(seen)), np.array(motions)


def seen_motion(scene: IntrinsicsScene, data: Observations, x: Array) -> Array:
    """How far the middles of the boards move in the image (m, 2), px."""
    out = []
    for T, view, motion in zip(scene.T_camera_target, data.views, x):
        middle = se3.apply(T, view.points.mean(axis=0))
        J = scene.camera.model.project_with_jacobians(scene.camera.values, middle)[1]
        out.append(J @ T[:3, :3] @ motion[3:])
    return np.array(out)


def test_jacobians_against_differences() -> None:
    scene, data, x = moving(8.0, sigma=0.0, seed=1, views=3)
    views = stack(data.views)
    centres = np.stack([v.points.mean(axis=0) for v in data.views])
    factor = RollingFactor("reprojection", model=scene.camera.model, views=views, centres=centres, height=HEIGHT)
    T, theta = scene.T_camera_target, scene.camera.values[None]
    x = x + np.random.default_rng(2).normal(size=x.shape) * [0.3, 0.3, 0.3, 0.01, 0.01, 0.01]
    _, jacobians = factor.linearize(T, theta, x)
    for slot, J in enumerate(jacobians):
        for k in range(J.shape[2]):
            step = np.eye(J.shape[2])[k] * 1e-6
            ends = []
            for sign in (1, -1):
                values = [T, theta, x]
                values[slot] = se3.retract(T, sign * step) if slot == 0 else values[slot] + sign * step
                ends.append(factor.residuals(*values))
            difference = (ends[0] - ends[1]) / 2e-6
            np.testing.assert_allclose(J[:, :, k], difference, atol=1e-6 * max(1.0, np.abs(difference).max()))


def test_a_priors_rows_are_its_scales() -> None:
    scales, x = np.array([2.0, 3.0]), np.arange(12.0).reshape(2, 6)
    for name, half in (("turn", x[:, :3]), ("shift", x[:, 3:])):
        r, (J,) = MotionPrior(name, scales).linearize(x)
        np.testing.assert_array_equal(r, scales[:, None] * half)
        np.testing.assert_array_equal((J @ x[:, :, None])[:, :, 0], r)


def test_exact_motions_give_the_exact_camera() -> None:
    scene, data, x = moving(3.0, sigma=0.0, seed=1)
    result = cb.calibrate_intrinsics(data, shutter="rolling")
    np.testing.assert_allclose(result.camera.values, scene.camera.values, atol=3e-4)
    found = result.detail(RollingShutter)
    assert found is not None
    # Corners tell a motion ten times worse than themselves, and noise below 1e-4 px is not told from none.
    np.testing.assert_allclose([v.px for v in found.views.values()], seen_motion(scene, data, x), atol=1e-2)
    assert result.check("outliers").status == "ok"


def test_motions_are_said_and_leave_no_shear() -> None:
    scene, data, x = moving(3.0, sigma=0.1, seed=3)
    result = cb.calibrate_intrinsics(data, shutter="rolling")
    assert result.sigma_px == pytest.approx(0.1, rel=0.1)
    assert result.check("rolling-shutter").value == pytest.approx(3 * np.sqrt(2), rel=0.3)
    assert "each by itself" not in result.check("shutter").message
    seen = np.concatenate([v.residuals for v in view_residuals(result, fitted_poses(result))])
    assert np.sqrt(np.mean(np.sum(seen**2, axis=1))) == pytest.approx(result.rms_px or 0.0, rel=1e-9)
    off = result.camera.values - scene.camera.values
    still = calibrate_keeping(data).result.camera.values - scene.camera.values
    assert np.linalg.norm(off[:4]) < np.linalg.norm(still[:4])
    found = result.detail(RollingShutter)
    assert found is not None
    true = seen_motion(scene, data, x)
    z = [(np.array(v.px) - t) / v.sigma_px for v, t in zip(found.views.values(), true)]
    assert 0.3 < np.mean(np.square(z)) < 1.7  # chi-square of 40, which share the camera's error


def test_views_at_rest_lose_nothing() -> None:
    data = intrinsics_scene(20, seed=5).observations
    rolling, still = (cb.calibrate_intrinsics(data, shutter=s) for s in ("rolling", "global"))
    assert rolling.check("rolling-shutter").message == "no view is seen to move while it is read"
    ratio = np.array([rolling.camera.sigma[n] / still.camera.sigma[n] for n in ("fx", "fy", "cx", "cy")])
    np.testing.assert_allclose(ratio, 1.0, atol=0.1)


def test_motion_one_way_is_warned_of() -> None:
    data = intrinsics_scene(20, seed=6).observations
    shift = np.array([5.0, 0.0])
    views = tuple(replace(v, uv=v.uv + readout_time(v.uv[:, 1:], HEIGHT) * shift) for v in data.views)
    check = cb.calibrate_intrinsics(replace(data, views=views), shutter="rolling").check("rolling-shutter")
    assert check.status == "warn"
    assert "one way" in check.message


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"shutter": "slit"}, "known: global, rolling"),
        ({"shutter": "rolling", "model": "auto"}, "one model"),
        ({"shutter": "rolling", "target_shape": "free"}, "hides a board's shape"),
    ],
)
def test_what_cannot_be_asked_together(options: dict[str, str], words: str) -> None:
    with pytest.raises(InputError, match=words):
        cb.calibrate_intrinsics(intrinsics_scene(6).observations, **options)


@pytest.mark.statistics
@pytest.mark.parametrize("px", [0.5, 3.0])
def test_sigma_of_the_lens_holds_the_motions(px: float) -> None:
    errors = []
    for seed in range(20):
        scene, data, _ = moving(px, sigma=0.1, seed=seed)
        camera = calibrate_keeping(data, shutter="rolling").result.camera
        e = camera.values - scene.camera.values
        errors.append(e @ np.linalg.solve(camera.covariance, e) / len(e))
    assert 0.7 < np.mean(errors) < 1.4  # 180 degrees of freedom: 1 ± 0.1, and what the level is uncertain by
