"""Poses by corners and depth, as results: true sigmas with errors that lens and scale share, one of two poses told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.perceive.boxes_on_a_table import d435

from calibrant.calibrate.pose.estimate import SECOND, estimate_poses
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, Observations, View
from calibrant.errors import RefusedError
from calibrant.geometry import se3, so3
from calibrant.perceive.board_depth.poses import with_depth
from calibrant.perceive.registered_depth.noise import DepthNoise
from calibrant.perceive.registered_depth.register import DepthRig
from calibrant.targets.registry import parse_target

SIGMA_PX = 0.2
POINTS = np.asarray(parse_target("chessboard:7x5:20mm").points, dtype=np.float64)
LENS_SIGMA = np.array([1.0, 1.0, 1.0, 1.0])
TRUE = Camera.create("pinhole", {"fx": 308.0, "fy": 308.0, "cx": 160.0, "cy": 121.0}, image_size=(320, 240))


def noise(scale_sigma: float) -> DepthNoise:
    return DepthNoise.stereo(focal_px=308.0, baseline_m=0.05, offset_px=0.0, scale_sigma=scale_sigma)


def pose_at(rng: np.random.Generator, distance: float, tilt: float) -> np.ndarray:
    R = so3.exp(rng.uniform(-tilt, tilt, 3) * [1, 1, 2])
    return se3.make(R, np.array([*rng.uniform(-0.03, 0.03, 2), distance]) - R @ POINTS.mean(axis=0))


def depth_at(T: np.ndarray, rng: np.random.Generator, *, scale: float = 0.0) -> np.ndarray:
    u, v = np.meshgrid(np.arange(320.0), np.arange(240.0))
    rays = TRUE.unproject(np.stack([u, v], -1))
    n = T[:3, 2]
    return d435((1 + scale) * (n @ T[:3, 3]) / (rays / rays[..., 2:] @ n), rng, f_b=15.4)


def seen(T: np.ndarray, rng: np.random.Generator, camera: Camera, name: str = "0", **options) -> CalibrationResult:
    uv = TRUE.project(se3.apply(T, POINTS)) + rng.normal(0, SIGMA_PX, (len(POINTS), 2))
    view = View(id=name, point_ids=np.arange(len(POINTS)), points=POINTS, uv=uv)
    observations = Observations((view,), {"camera": (320, 240)})
    return estimate_poses(camera, observations, sigma_px=SIGMA_PX, **options)


@pytest.mark.statistics
@pytest.mark.parametrize("scale_sigma", [0.002, 0.02])
def test_sigma_is_true_where_lens_and_scale_are_off(scale_sigma: float) -> None:
    """The lens' error moves corners and depths' rays alike, the scale's all depths; neither is averaged away.

    Mean chi-square of 60 trials within 4 of its sigmas, sqrt(2 d / 60).
    """
    trials, squares, along = 60, [], []
    for seed in range(trials):
        rng = np.random.default_rng(seed)
        T = pose_at(rng, 0.45, 0.4)
        off = TRUE.values + LENS_SIGMA * rng.normal(size=4)
        camera = Camera(TRUE.model, TRUE.image_size, off, np.diag(LENS_SIGMA**2))
        result = seen(T, rng, camera)
        depth = depth_at(T, rng, scale=scale_sigma * rng.normal())
        found = with_depth(result, {"0": depth}, DepthRig.aligned(camera), noise=noise(scale_sigma)).transforms[0]
        e = se3.local(found.matrix, T)
        squares.append(e @ np.linalg.solve(found.covariance, e))
        along.append(e[5] ** 2 / found.covariance[5, 5])
        assert found.covariance[5, 5] <= 1.05 * result.transforms[0].covariance[5, 5]
    assert np.mean(squares) == pytest.approx(6, abs=4 * np.sqrt(12 / trials))
    assert np.mean(along) == pytest.approx(1, abs=4 * np.sqrt(2 / trials))


def test_sigma_along_the_axis_shrinks_as_far_as_the_scale_is_known() -> None:
    rng = np.random.default_rng(3)
    T = pose_at(rng, 0.45, 0.3)
    result, depth = seen(T, rng, TRUE), depth_at(T, rng)
    before = result.transforms[0].sigma_translation_mm[2]
    after = {}
    for s in (1e-4, 2e-2):
        found = with_depth(result, {"0": depth}, DepthRig.aligned(TRUE), noise=noise(s))
        after[s] = found.transforms[0].sigma_translation_mm[2]
        assert found.check("depth").status == "ok"
        assert found.check("depth-agreement").status == "ok"
    assert after[1e-4] < 0.5 * before
    assert after[1e-4] < after[2e-2] <= before
    # Not below what the scale leaves of 0.4 m, whatever is averaged.
    assert after[1e-4] > 0.04


def test_depth_tells_which_of_two_poses_it_is() -> None:
    """A small board far away: its corners fit two poses, its depths one."""
    told = 0
    for seed in range(8):
        rng = np.random.default_rng(seed)
        T = pose_at(rng, 1.2, 0.35)
        result = seen(T, rng, TRUE, confidence=1 - 1e-12)
        if not any(t.child.endswith(SECOND) for t in result.transforms):
            continue
        found = with_depth(result, {"0": depth_at(T, rng)}, DepthRig.aligned(TRUE), noise=noise(0.02))
        if len(found.transforms) == 1:
            told += 1
            assert not found.check("second-solution").message.startswith("two poses")
            assert found.check("second-solution").status == "ok"
            e = se3.local(found.transforms[0].matrix, T)
            # 99.99 % of chi-square with six degrees of freedom.
            assert e @ np.linalg.solve(found.transforms[0].covariance, e) < 27.9
    assert told >= 2


def test_depth_of_another_photo_is_called_a_contradiction() -> None:
    rng = np.random.default_rng(5)
    T, other = pose_at(rng, 0.45, 0.3), pose_at(rng, 0.5, 0.3)
    found = with_depth(seen(T, rng, TRUE), {"0": depth_at(other, rng)}, DepthRig.aligned(TRUE), noise=noise(0.002))
    assert found.check("depth-agreement").status == "warn"
    assert found.verdict == "warn"


def test_a_view_without_depth_keeps_its_pose_and_none_is_refused() -> None:
    rng = np.random.default_rng(6)
    poses = [pose_at(rng, 0.45, 0.3) for _ in range(2)]
    views = [replace(seen(T, rng, TRUE).observations.views[0], id=str(i)) for i, T in enumerate(poses)]
    result = estimate_poses(TRUE, Observations(tuple(views), {"camera": (320, 240)}), sigma_px=SIGMA_PX)
    hole = np.full((240, 320), np.nan)
    hole[:5] = 0.5
    found = with_depth(result, {"0": depth_at(poses[0], rng), "1": hole}, DepthRig.aligned(TRUE), noise=noise(0.002))
    assert found.check("depth-missing").status == "warn"
    assert [t.child for t in found.transforms] == [t.child for t in result.transforms]
    np.testing.assert_array_equal(found.transforms[1].matrix, result.transforms[1].matrix)
    with pytest.raises(RefusedError, match="no board has depth"):
        with_depth(result, {"0": hole, "1": hole}, DepthRig.aligned(TRUE), noise=noise(0.002))
