"""Boards that are not flat: the shape is found, the camera no longer pays for it, and flat boards stay flat."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibrant.calibrate.intrinsics.calibrate import calibrate_intrinsics
from calibrant.data import CalibrationResult, Observations
from calibrant.data.details import BentTarget, FreeTarget
from calibrant.data.result_file import read_result, write_result
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3
from calibrant.simulate.scenes import grid, intrinsics_scene, look_at_board, observe, standard_camera

CAMERA, POINTS = standard_camera(), grid(9, 7, 0.03)
ACROSS = 2 * POINTS[:, :2] / POINTS[:, :2].max(axis=0) - 1
BEND_MM = np.array([0.6, -0.4])
TWIST_MM = 0.3


def bent(seed: int, *, sigma: float = 0.05, views: int = 25, shape: np.ndarray | None = None) -> Observations:
    """Views of a deformed board, reported with its nominal points as a detector would."""
    rng = np.random.default_rng(seed)
    z = ((1 - ACROSS**2) @ BEND_MM + TWIST_MM * ACROSS.prod(axis=1)) * 1e-3
    true = POINTS + np.stack([0 * z, 0 * z, z], axis=1) if shape is None else shape
    T = look_at_board(CAMERA, POINTS, views, rng=rng)
    seen = observe(CAMERA, true, T, sigma_px=sigma, rng=rng)
    return replace(seen, views=tuple(replace(v, points=POINTS[v.point_ids]) for v in seen.views))


def worst(result: CalibrationResult) -> float:
    """Largest error of fx, fy, cx, cy, pixels."""
    p, q = result.camera.parameters, CAMERA.parameters
    return max(abs(p[n] - q[n]) for n in ("fx", "fy", "cx", "cy"))


def test_paraboloid_is_found() -> None:
    result = calibrate_intrinsics(bent(0), target_shape="paraboloid")
    shape = result.detail(BentTarget)
    assert shape is not None
    found, sigma = np.array(shape.bend_mm), np.array(shape.bend_sigma_mm)
    assert np.all(np.abs(found - BEND_MM) < 4 * sigma)
    assert np.all(sigma < 0.02)
    assert abs(shape.twist_mm - TWIST_MM) < 4 * shape.twist_sigma_mm
    assert shape.twist_sigma_mm < 0.02
    assert result.check("residual-structure").status == "ok"
    assert [c.name for c in result.checks if c.name.startswith("board-flat")] == []
    assert result.sigma_px == pytest.approx(0.05, rel=0.06)
    assert result.options["target_shape"] == "paraboloid"


@pytest.mark.parametrize("shape", ["paraboloid", "free"])
def test_the_camera_no_longer_pays(shape: str) -> None:
    observations = bent(1)
    flat, shaped = calibrate_intrinsics(observations), calibrate_intrinsics(observations, target_shape=shape)
    assert worst(shaped) < 0.5 * worst(flat)
    scores = [(shaped.camera.parameters[n] - CAMERA.parameters[n]) / shaped.camera.sigma[n] for n in CAMERA.parameters]
    assert np.sqrt(np.mean(np.square(scores))) < 2.0


def test_free_points_are_found_up_to_the_gauge() -> None:
    rng = np.random.default_rng(5)
    deviation = 3e-4 * rng.normal(size=POINTS.shape)
    result = calibrate_intrinsics(bent(2, sigma=0.02, views=40, shape=POINTS + deviation), target_shape="free")
    shape = result.detail(FreeTarget)
    assert shape is not None
    found = np.array([shape.deviation_mm[str(i)] for i in range(len(POINTS))])
    # What a similarity can do to the board is not part of its shape: take it off the truth as well.
    true = 1e3 * deviation - _similarity_part(1e3 * deviation)
    assert np.sqrt(np.mean((found - true) ** 2)) < 0.02
    assert shape.out_of_plane_rms_mm == pytest.approx(0.3, rel=0.15)
    assert result.sigma_px == pytest.approx(0.02, rel=0.05)


def _similarity_part(d: np.ndarray) -> np.ndarray:
    """The least-squares translation, rotation and scale in a field of small displacements."""
    c = POINTS - POINTS.mean(axis=0)
    fields = [np.tile(e, (len(c), 1)) for e in np.eye(3)] + [np.cross(e, c) for e in np.eye(3)] + [c]
    A = np.stack([f.ravel() for f in fields], axis=1)
    return (A @ np.linalg.lstsq(A, d.ravel(), rcond=None)[0]).reshape(d.shape)


def test_poses_belong_to_the_nominal_board() -> None:
    """The poses that a shaped fit reports project the aligned shape where the points were seen."""
    observations = bent(3)
    result = calibrate_intrinsics(observations, target_shape="free")
    shape = result.detail(FreeTarget)
    assert shape is not None
    d = np.array([shape.deviation_mm[str(i)] for i in range(len(POINTS))]) * 1e-3
    for view, of in zip(observations.views[:3], result.views):
        uv = result.camera.project(se3.apply(of.T_camera_target, (POINTS + d)[view.point_ids]))
        assert np.sqrt(np.mean((uv - view.uv) ** 2)) == pytest.approx(0.05, rel=0.3)


def test_a_flat_board_stays_flat(tmp_path: object) -> None:
    observations = intrinsics_scene(20, seed=2).observations
    result = calibrate_intrinsics(observations, target_shape="paraboloid")
    shape = result.detail(BentTarget)
    assert shape is not None
    assert np.all(np.abs(shape.bend_mm) < 4 * np.array(shape.bend_sigma_mm))
    path = write_result(result, tmp_path / "camera.json")  # type: ignore[operator]
    assert read_result(path).detail(BentTarget) == shape


def test_bad_input() -> None:
    observations = intrinsics_scene(5, seed=2).observations
    with pytest.raises(InputError, match="unknown target shape 'sphere'; known: flat, paraboloid, free"):
        calibrate_intrinsics(observations, target_shape="sphere")
    rare = replace(observations.views[0], point_ids=observations.views[0].point_ids + 1000)
    spoiled = replace(observations, views=(rare, *observations.views[1:]))
    with pytest.raises(RefusedError, match="is seen in 1 views"):
        calibrate_intrinsics(spoiled, target_shape="free")


@pytest.mark.parametrize("shape", ["paraboloid", "free"])
def test_the_cure_quiets_what_asked_for_it(shape: str) -> None:
    """Points and residuals are judged on the shape found: a plane left out what belongs to a bent board."""
    rng = np.random.default_rng(3)
    z = 2e-3 * (1 - ACROSS[:, 0] ** 2)
    true = POINTS + np.stack([0 * z, 0 * z, z], axis=1)
    T = look_at_board(CAMERA, POINTS, 25, rng=rng)
    seen = observe(CAMERA, true, T, sigma_px=0.05, rng=rng)
    observations = replace(seen, views=tuple(replace(v, points=POINTS[v.point_ids]) for v in seen.views))
    flat, shaped = (calibrate_intrinsics(observations, target_shape=s) for s in ("flat", shape))
    assert sum(v.points_left_out for v in flat.views) > 10
    assert sum(v.points_left_out for v in shaped.views) <= 2
    asked = {c.name for c in shaped.checks if c.status != "ok"}
    assert not asked & {"residual-structure", "outliers", "one-camera"}
    found = [c.value for c in shaped.checks if c.name == "residual-structure"]
    assert found[0] is not None
    assert found[0] < 0.1
    assert shaped.sigma_px == pytest.approx(0.05, rel=0.06)
