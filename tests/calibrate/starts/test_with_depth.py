"""Targets with depth: three-point poses, poses of rays, and calibration from them with and without a start value."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from calibrant.calibrate.intrinsics.calibrate import calibrate_intrinsics
from calibrant.calibrate.pose.target_poses import target_poses
from calibrant.calibrate.starts.with_depth import is_flat, poses_of_rays, three_point_poses
from calibrant.cameras import Camera
from calibrant.data import Observations
from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.simulate.scenes import look_at_board, observe, standard_camera

Array = NDArray[np.float64]
FISHEYE = Camera.create(
    "kannala_brandt", {"fx": 320.0, "fy": 321.0, "cx": 639.0, "cy": 511.0, "k1": 0.05, "k2": -0.01},
    image_size=(1280, 1024),
)  # fmt: skip


def block(n: int = 40, *, depth: float = 0.1, seed: int = 0) -> Array:
    """Points of a solid target, 0.2 m wide."""
    return np.random.default_rng(seed).uniform((0, 0, -depth / 2), (0.2, 0.15, depth / 2), size=(n, 3))


def views(camera: Camera, points: Array, n: int, *, sigma_px: float, seed: int = 1) -> tuple[Array, Observations]:
    rng = np.random.default_rng(seed)
    T = look_at_board(camera, points, n, rng=rng, distance=(0.35, 0.7))
    return T, observe(camera, points, T, sigma_px=sigma_px, rng=rng)


def distance(a: Array, b: Array) -> float:
    return float(np.abs(se3.local(a, b)).max())


def test_three_points_have_the_true_pose_among_theirs() -> None:
    rng = np.random.default_rng(2)
    for _ in range(50):
        T = se3.make(so3.random(rng, 1)[0], [*rng.uniform(-0.3, 0.3, 2), rng.uniform(1, 3)])
        points = rng.uniform(-0.5, 0.5, (3, 3))
        seen = se3.apply(T, points)
        poses = three_point_poses(points, seen / np.linalg.norm(seen, axis=1, keepdims=True))
        # A double root of the quartic loses half the digits.
        assert min(distance(T, p) for p in poses) < 1e-6


def test_three_points_on_a_line_have_no_pose() -> None:
    points = np.array([[0, 0, 0], [1, 1, 1], [2, 2, 2.0]])
    assert three_point_poses(points, np.eye(3)) == []


@pytest.mark.parametrize("count", [4, 5, 6, 40])
@pytest.mark.parametrize("depth", [1e-3, 0.1])
@pytest.mark.parametrize("camera", [standard_camera(), FISHEYE], ids=["brown", "kannala_brandt"])
def test_poses_are_exact_without_noise(camera: Camera, depth: float, count: int) -> None:
    points = block(count, depth=depth)
    T, seen = views(camera, points, 5, sigma_px=0.0)
    assert not is_flat(points)
    offsets = np.arange(6) * count
    rays = camera.unproject(np.concatenate([v.uv for v in seen.views]))
    found, good = poses_of_rays(np.tile(points, (5, 1)), rays, offsets)
    assert good.all()
    # The inverse of the lens is exact to 1e-9 px; four points and little depth multiply that.
    assert distance(T, found) < 1e-5
    np.testing.assert_allclose(target_poses(camera, seen.views).T_camera_target, T, atol=1e-8)


def test_too_few_or_collinear_points_have_no_pose() -> None:
    line = np.outer(np.arange(6.0), [1, 2, 3])
    points = np.concatenate([line, block(3)])
    _, good = poses_of_rays(points, points + np.array([0, 0, 5.0]), np.array([0, 6, 9]))
    assert not good.any()


@pytest.mark.parametrize("model", ["pinhole", "brown", "kannala_brandt"])
def test_a_camera_from_a_target_with_depth(model: str) -> None:
    """Without a start value: the DLT gives one; noise-free views give the camera back."""
    truth = {"pinhole": Camera.create("pinhole", {"fx": 900, "fy": 905, "cx": 700, "cy": 480}, image_size=(1280, 1024)),
             "brown": standard_camera(),
             "kannala_brandt": FISHEYE}[model]  # fmt: skip
    _, seen = views(truth, block(60), 4, sigma_px=0.0)
    result = calibrate_intrinsics(seen, model=model)
    np.testing.assert_allclose(result.camera.values, truth.values, rtol=1e-6, atol=1e-6)


def test_one_view_of_a_target_with_depth_calibrates_a_pinhole() -> None:
    truth = Camera.create("pinhole", {"fx": 900, "fy": 905, "cx": 700, "cy": 480}, image_size=(1280, 1024))
    _, seen = views(truth, block(60, depth=0.15), 1, sigma_px=0.02)
    result = calibrate_intrinsics(seen, model="pinhole")
    sigma = np.array([result.camera.sigma[n] for n in ("fx", "fy", "cx", "cy")])
    assert np.all(np.abs(result.camera.values - truth.values) < 4 * sigma)


def test_a_start_value_is_asked_for_and_used() -> None:
    truth = standard_camera()
    points = block(5)
    _, seen = views(truth, points, 6, sigma_px=0.0)
    with pytest.raises(InputError, match=r"needs a start value of the camera.*--initial camera\.json"):
        calibrate_intrinsics(seen, model="pinhole")
    near = {n: v * 1.03 for n, v in truth.parameters.items()}
    start = Camera.create("brown", near, image_size=truth.image_size)
    result = calibrate_intrinsics(seen, model="brown", initial=start, fix=("k1", "k2", "p1", "p2", "k3"))
    assert result.camera.parameters["k1"] == near["k1"]
    assert abs(result.camera.parameters["fx"] / truth.parameters["fx"] - 1) < 0.05
