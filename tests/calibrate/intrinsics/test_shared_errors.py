"""Sigma of a camera whose points err alike: as large as the errors are, and unchanged where they do not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import calibrant as cb
from calibrant.arrays import Array
from calibrant.calibrate.intrinsics.one_model import calibrate_keeping
from calibrant.data.details import SharedErrors
from calibrant.geometry import se3
from calibrant.simulate.scenes import IntrinsicsScene, intrinsics_scene
from calibrant.simulate.truth import chi_square

FOUR = ("fx", "fy", "cx", "cy")


def _alike(scene: IntrinsicsScene, rng: np.random.Generator) -> cb.Observations:
    """The scene's pixels with a shift and a linear distortion of each view's own, 2 and 1.5 times the noise."""
    views = []
    for view in scene.observations.views:
        u = view.uv - view.uv.mean(axis=0)
        own = u / np.abs(u).max() @ rng.normal(scale=1.5, size=(2, 2)) + rng.normal(scale=2.0, size=2)
        views.append(replace(view, uv=view.uv + scene.sigma_px * own))
    return replace(scene.observations, views=tuple(views))


def _dots(scene: IntrinsicsScene, rng: np.random.Generator) -> cb.Observations:
    """The scene with every point of the board printed 0.3 mm off, the same in all views."""
    printed = scene.points + np.c_[rng.normal(scale=3e-4, size=(len(scene.points), 2)), np.zeros(len(scene.points))]
    views = []
    for view, T in zip(scene.observations.views, scene.T_camera_target):
        shift = scene.camera.project(se3.apply(T, printed)) - scene.camera.project(se3.apply(T, scene.points))
        views.append(replace(view, uv=view.uv + shift))
    return replace(scene.observations, views=tuple(views))


def _errors(result: cb.CalibrationResult, truth: cb.Camera) -> tuple[Array, Array]:
    rows = [truth.model.index(name) for name in FOUR]
    covariance = result.camera.covariance
    assert covariance is not None
    return (result.camera.values - truth.values)[rows], covariance[np.ix_(rows, rows)]


def test_both_sigmas_are_stated_and_the_file_keeps_them(tmp_path: Path) -> None:
    scene = intrinsics_scene(seed=3)
    result = cb.calibrate_intrinsics(_alike(scene, np.random.default_rng(3)))
    shared = result.detail(SharedErrors)
    assert shared is not None
    assert shared.times > 1.5
    assert result.camera.sigma["fx"] > 1.3 * shared.independent_sigma["fx"]
    (check,) = (c for c in result.checks if c.name == "shared-errors")
    assert check.status == "ok"
    assert f"{shared.times:.1f} times" in check.message
    assert cb.read(result.write(tmp_path / "r.json")).detail(SharedErrors) == shared


def test_exact_points_have_no_errors_to_share() -> None:
    shared = cb.calibrate_intrinsics(intrinsics_scene(sigma_px=0.0).observations).detail(SharedErrors)
    assert shared is not None
    assert shared.times == pytest.approx(1, abs=0.2)


def test_what_is_held_has_no_sigma() -> None:
    scene = intrinsics_scene(seed=1)
    result = cb.calibrate_intrinsics(_alike(scene, np.random.default_rng(1)), fix=["k3"])
    assert result.camera.sigma["k3"] == 0


@pytest.mark.statistics
@pytest.mark.parametrize(("spoil", "most"), [(None, 1.2), (_alike, 1.3), (_dots, 1.3)])
def test_errors_are_as_large_as_stated(spoil: Callable[..., cb.Observations] | None, most: float) -> None:
    normalised, inside, growth = [], [], []
    for seed in range(100):
        scene = intrinsics_scene(views=16, seed=seed)
        found = scene.observations if spoil is None else spoil(scene, np.random.default_rng(seed))
        result = calibrate_keeping(found).result
        e, C = _errors(result, scene.camera)
        normalised.append(chi_square(e, C) / 4)
        inside.append(np.abs(e) < 1.96 * np.sqrt(np.diag(C)))
        shared = result.detail(SharedErrors)
        assert shared is not None
        growth.append(result.camera.sigma["fx"] / shared.independent_sigma["fx"])
    assert np.mean(normalised) < most
    assert np.mean(inside) >= 0.93
    if spoil is None:
        assert np.mean(growth) < 1.1


@pytest.mark.long
@pytest.mark.parametrize("side", ["left", "right"])
def test_random_halves_of_a_real_set_differ_as_stated(shared_data: Callable[[str], Path], side: str) -> None:
    folder = shared_data("opencv_stereo_9x6")
    whole = cb.intrinsics(sorted(folder.glob(f"{side}*.jpg")), target="chessboard:9x6:25mm")
    observations = whole.observations
    assert observations is not None
    rng, inside = np.random.default_rng(0), []
    for _ in range(100):
        order = rng.permutation(len(observations.views))
        a, b = (
            calibrate_keeping(replace(observations, views=tuple(observations.views[i] for i in half))).result.camera
            for half in np.array_split(order, 2)
        )
        apart = np.array([a.parameters[n] - b.parameters[n] for n in FOUR])
        inside.append(np.abs(apart) < 1.96 * np.hypot([a.sigma[n] for n in FOUR], [b.sigma[n] for n in FOUR]))
    assert np.mean(inside, axis=0)[0] >= 0.9
    assert np.mean(inside) >= 0.9
