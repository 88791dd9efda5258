"""The small problem: its Jacobian, its covariance, and what it makes of priors that are singular."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibrant.geometry import se3, so3
from calibrant.simulate.scenes import hand_eye_scene
from calibrant.verification.unchanged import model as problem
from calibrant.verification.unchanged.model import LENS, Known, Model, Photo, lens_change, solve, square_root


def scene_model(*, free: tuple[str, ...] = ("camera moved",), lens: bool = True) -> Model:
    scene = hand_eye_scene("good", views=3, seed=2)
    base = {"camera": scene.X, "target": scene.Z, "camera moved": se3.make(so3.exp([0.01, -0.02, 0.03]), [0.01, 0, 0])}
    photos = []
    for i, view in enumerate(scene.observations.views):
        base[f"robot {i}"] = scene.robot_poses.T_base_gripper[i]
        chain = (("camera moved", True), ("camera", True), (f"robot {i}", True), ("target", False))
        photos.append(Photo(view, chain, np.full(len(view), 0.1), now=i > 0))
    k = len(scene.camera.values)
    C = np.diag([1e-6] * 12 + [0.1] * 4 + [0.0] * (k - 4))
    known = [Known(("camera", "target", LENS), square_root(C))]
    known += [Known((f"robot {i}",), 1e-4 * np.eye(6)) for i in range(3)]
    return Model(scene.camera, tuple(photos), base, tuple(known), free, lens)


def test_the_jacobian_is_that_of_differences() -> None:
    model = scene_model()
    maps, latents = problem._maps(model)
    unknowns = maps[LENS].shape[1]
    start = (dict(model.base), np.zeros(3), np.zeros(latents))
    r, J = problem._linearised(model, maps, *start)
    for j in range(unknowns):
        step = np.zeros(unknowns)
        size = 1e-6 if j >= unknowns - 9 else 1e-3  # free transforms and the lens are in radians and metres
        step[j] = size
        ahead, _ = problem._linearised(model, maps, *problem._moved(model, maps, *start, step))
        behind, _ = problem._linearised(model, maps, *problem._moved(model, maps, *start, -step))
        slope = (ahead - behind) / (2 * size)
        assert np.abs(slope - J[:, j]).max() <= 1e-4 * np.abs(J[:, j]).max() + 1e-6
    assert len(r) == sum(2 * len(p.view) for p in model.photos)


def test_exact_photos_of_a_pushed_camera_give_the_push() -> None:
    scene = hand_eye_scene("exact", views=3, seed=1)
    D = se3.make(so3.exp(np.deg2rad([0.3, -0.2, 0.5])), [0.002, -0.001, 0.003])
    base = {"camera": scene.X, "target": scene.Z, "camera moved": np.eye(4)}
    photos = []
    for i, view in enumerate(scene.observations.views):
        uv = scene.camera.project(se3.apply(se3.inverse(D) @ scene.T_camera_target[i], view.points))
        base[f"robot {i}"] = scene.T_base_gripper[i]
        chain = (("camera moved", True), ("camera", True), (f"robot {i}", True), ("target", False))
        photos.append(Photo(replace(view, uv=uv), chain, np.full(len(view), 0.1)))
    fit = solve(Model(scene.camera, tuple(photos), base, free=("camera moved",)))
    assert fit.chi2 < 1e-8
    assert fit.place["camera moved"] == pytest.approx(D, abs=1e-9)


def test_a_root_is_one_also_where_a_parameter_was_held() -> None:
    rng = np.random.default_rng(0)
    A = rng.standard_normal((5, 5)) * [1, 1e-3, 1e3, 1, 1]
    C = A.T @ A
    C[3, :] = C[:, 3] = 0.0
    root = square_root(C)
    assert root.shape == (5, 4)
    assert root @ root.T == pytest.approx(C, rel=1e-9, abs=1e-12)


def test_a_change_of_the_lens_is_its_focal_lengths_and_principal_point() -> None:
    camera = hand_eye_scene("exact", views=3).camera
    J = lens_change(camera, camera.values)
    assert J[camera.model.index("fx"), 0] == camera.parameters["fx"]
    assert np.count_nonzero(J) == 4
