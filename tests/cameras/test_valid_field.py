"""Where each kind of model ends, against limits worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.cameras import Camera, camera_model
from calibrant.errors import InputError

SIZE = (1280, 1024)
PIXELS = {"fx": 400.0, "fy": 400.0, "cx": 640.0, "cy": 512.0}


def at(angle_deg: float) -> np.ndarray:
    a = np.deg2rad(angle_deg)
    return np.array([np.sin(a), 0.0, np.cos(a)])


@pytest.mark.parametrize(
    ("model", "terms", "limit_deg"),
    [
        ("pinhole", {}, 90.0),
        ("brown", {"k1": -0.3}, np.rad2deg(np.arctan(1 / np.sqrt(0.9)))),  # 1 + 3 k1 r2 = 0
        ("kannala_brandt", {"k1": -0.1}, np.rad2deg(1 / np.sqrt(0.3))),  # 1 + 3 k1 theta^2 = 0
        ("unified", {"xi": 0.8}, np.rad2deg(np.arccos(-0.8))),  # z = -xi
        ("unified", {"xi": 1.6}, np.rad2deg(np.arccos(-1 / 1.6))),  # z = -1 / xi
        ("extended_unified", {"alpha": 0.5, "beta": 1.0}, 180.0),
        ("extended_unified", {"alpha": 0.6, "beta": 1.0}, np.rad2deg(np.arccos(-0.4 / 0.6))),
        ("double_sphere", {"xi": 0.0, "alpha": 0.6}, np.rad2deg(np.arccos(-0.4 / 0.6))),  # the unified model again
        ("division", {"l1": -0.25}, 180.0),
        ("division", {"l1": 0.25}, 45.0),  # s = 1 / l1 = 4, w = 2, tan = 2 / 2
        ("splined:10x10:150deg", {}, 75.0),
    ],
)
def test_the_field_ends_where_the_map_does(model: str, terms: dict[str, float], limit_deg: float) -> None:
    camera = Camera.create(model, {**PIXELS, **terms}, image_size=SIZE)
    inside, outside = at(limit_deg - 0.5), at(limit_deg + 0.5)
    assert camera.model.valid(camera.values, inside)
    ray = camera.unproject(camera.project(inside))
    np.testing.assert_allclose(ray, inside, atol=1e-9)
    if limit_deg < 180:
        assert not camera.model.valid(camera.values, outside)


def test_stereographic_is_one_model_under_four_names() -> None:
    """u = f 2 tan(theta / 2): xi = 1, alpha = 1/2, and the division model with l1 = -1/4."""
    p = np.random.default_rng(41).normal(size=(200, 3))
    stereographic = 400 * 2 * p[:, :2] / (np.linalg.norm(p, axis=1) + p[:, 2])[:, None] + [640, 512]
    same = [
        ("unified", {"xi": 1.0, "fx": 800.0, "fy": 800.0}),
        ("extended_unified", {"alpha": 0.5, "beta": 1.0}),
        ("double_sphere", {"alpha": 0.5}),
        ("division", {"l1": -0.25}),
    ]
    for model, terms in same:
        camera = Camera.create(model, {**PIXELS, **terms}, image_size=SIZE)
        np.testing.assert_allclose(camera.project(p), stereographic, rtol=1e-10, err_msg=model)


def test_inverse_brown_undistorts_by_the_formula() -> None:
    """RealSense's deprojection, worked out for one pixel: x' = 0.1, y' = -0.2, r2 = 0.05."""
    terms = {"k1": 0.2, "k2": 0.0, "p1": 0.01, "p2": 0.02, "k3": 0.0}
    camera = Camera.create("inverse_brown", {**PIXELS, **terms}, image_size=SIZE)
    ray = camera.unproject([640 + 40.0, 512 - 80.0])
    x = 0.1 * 1.01 + 2 * 0.01 * 0.1 * -0.2 + 0.02 * (0.05 + 2 * 0.01)
    y = -0.2 * 1.01 + 0.01 * (0.05 + 2 * 0.04) + 2 * 0.02 * 0.1 * -0.2
    np.testing.assert_allclose(ray[:2] / ray[2], [x, y], atol=1e-14)


def test_two_branches_of_a_polynomial_are_not_confused() -> None:
    """k1 = -0.5, k2 = 0.1 folds at r = 0.93 and rises again beyond 1.5: pixels past the fold have no ray."""
    camera = Camera.create("brown", {**PIXELS, "k1": -0.5, "k2": 0.1}, image_size=SIZE)
    r = np.linspace(0.01, 4, 2000)
    distorted = r * (1 - 0.5 * r**2 + 0.1 * r**4)
    peak = distorted[r < 1.2].max()
    assert distorted.max() > 2 * peak
    rays = camera.unproject(np.stack([640 + 400 * np.linspace(0, 2 * peak, 101), np.full(101, 512.0)], axis=1))
    assert np.all(np.isfinite(rays[:50]))
    assert np.all(np.isnan(rays[52:]))
    assert np.all(rays[:50, 0] / rays[:50, 2] < 0.94)


@pytest.mark.parametrize("spec", ["splined:3x9:120deg", "splined:9x9:0deg", "splined:9x9", "splined:axb:100deg"])
def test_unusable_grids_are_refused(spec: str) -> None:
    with pytest.raises(InputError, match="splined model"):
        camera_model(spec)


def test_a_parallel_ray_starts_at_its_pixel() -> None:
    camera = camera_model("orthographic")
    values = np.array([2000.0, 2000.0, 640.0, 512.0])
    np.testing.assert_allclose(camera.ray_origins(values, [840.0, 312.0]), [0.1, -0.1, 0.0], atol=1e-15)
    np.testing.assert_allclose(camera.unproject(values, [840.0, 312.0]), [0, 0, 1])
