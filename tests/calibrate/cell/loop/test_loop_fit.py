"""The loop's least squares: exact without noise, its rows against differences, scale and two places."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from calibrant.calibrate.cell.loop import fit as loop_fit
from calibrant.calibrate.cell.loop.fit import Model, fit_loop, plain_model
from calibrant.geometry import se3
from calibrant.simulate.scenes import HandEyeScene, hand_eye_scene

Array = NDArray[np.float64]


def pairs(scene: HandEyeScene) -> tuple[Array, Array]:
    T = scene.robot_poses.T_base_gripper
    return (T if scene.setup == "eye-in-hand" else se3.inverse(T)), scene.measured_T_camera_target


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_noise_free_loops_close_to_rounding(setup: str) -> None:
    scene = hand_eye_scene("exact", setup=setup)  # type: ignore[arg-type]
    start = se3.retract(scene.X, [0.05, -0.1, 0.08, 0.02, 0.01, -0.03])
    fit = fit_loop(*pairs(scene), start)
    # Gauss-Newton stops within 1e-7 of the smallest noise it knows, 1e-7 rad and m.
    np.testing.assert_allclose(fit.X[0], scene.X, atol=1e-10)
    np.testing.assert_allclose(fit.Z[0], scene.Z, atol=1e-10)


def test_rows_are_the_derivatives_of_the_deviations() -> None:
    scene = hand_eye_scene("good", views=6)
    A, B = pairs(scene)
    model = Model(np.array([0, 0, 0, 1, 1, 1]), np.array([0, 0, 1, 1, 0, 0]), free_scale=True)
    X, Z = np.stack([scene.X, scene.X]), np.stack([scene.Z, scene.Z])
    _, rows = loop_fit.linearised(A, B, X, Z, 1.0, model)
    step = 1e-6
    for k in range(model.unknowns):
        delta = np.zeros(model.unknowns)
        delta[k] = step
        plus, _ = loop_fit.linearised(A, B, *loop_fit.moved(X, Z, 1.0, delta, model), model)
        minus, _ = loop_fit.linearised(A, B, *loop_fit.moved(X, Z, 1.0, -delta, model), model)
        # The rows leave out the Jacobian of the logarithm, I + O(deviation): 3e-4 rad here.
        np.testing.assert_allclose((plus - minus) / (2 * step), rows[:, :, k], atol=2e-3)


@pytest.mark.statistics
def test_the_scale_is_found_with_its_sigma() -> None:
    errors = []
    for seed in range(40):
        A, B = pairs(hand_eye_scene("good", seed=seed))
        B = B.copy()
        B[:, :3, 3] *= 1.05
        scene_X = hand_eye_scene("good", seed=seed).X
        fit = fit_loop(A, B, scene_X, model=plain_model(len(A), free_scale=True))
        errors.append((fit.scale - 1 / 1.05) / fit.sigma_scale)
    # 40 normalised errors: their rms is 1 +- 0.11; the noise is not quite the model's, so 3 sigma and some.
    assert 0.6 < np.sqrt(np.mean(np.square(errors))) < 1.5


def test_two_places_of_the_target_are_told_apart() -> None:
    scene = hand_eye_scene("exact", views=12)
    A, B = pairs(scene)
    moved = se3.retract(scene.Z, [0.0, 0.02, 0.0, 0.01, 0.0, 0.005])
    part = np.repeat([0, 1], 6)
    B = B.copy()
    B[6:] = B[6:] @ se3.inverse(scene.Z) @ moved
    fit = fit_loop(A, B, scene.X, model=Model(np.zeros(12, dtype=np.intp), part))
    np.testing.assert_allclose(fit.Z, np.stack([scene.Z, moved]), atol=1e-10)


@pytest.mark.statistics
def test_the_statistic_of_clean_views_is_about_one() -> None:
    values = []
    for seed in range(20):
        scene = hand_eye_scene("good", seed=seed, views=20)
        values.append(fit_loop(*pairs(scene), scene.X).statistic)
    # Each is about F(6, 108): mean 1.02; 400 of them average to within 0.05, the noise being not quite isotropic.
    assert 0.8 < np.mean(values) < 1.3
