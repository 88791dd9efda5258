from __future__ import annotations

import numpy as np
import pytest
from tests.calibrate.lens_views import SIZE, board_poses, observe

from calibrant.calibrate.intrinsics.calibrate import calibrate_intrinsics
from calibrant.calibrate.pose.target_poses import target_poses
from calibrant.calibrate.reprojection.factor import stack
from calibrant.calibrate.starts import any_lens as camera_start
from calibrant.cameras import MODELS, Camera, camera_model
from calibrant.data import Observations
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3, so3

PIXELS = {"fx": 900.0, "fy": 905.0, "cx": 645.0, "cy": 507.0}
LENSES: dict[str, tuple[dict[str, float], float]] = {
    "pinhole": ({}, 20),
    "pinhole_skew": ({"skew": 2.0}, 20),
    "brown": ({"k1": -0.28, "k2": 0.09, "p1": 8e-4, "p2": -1e-3, "k3": -0.012}, 20),
    "inverse_brown": ({"k1": 0.2, "k2": 0.05, "p1": 8e-4, "p2": -1e-3, "k3": 0.01}, 20),
    "division": ({"fx": 450, "fy": 452, "l1": -0.25, "l2": -0.01, "l3": -0.003}, 60),
    "kannala_brandt": ({"fx": 400, "fy": 402, "k1": -0.03, "k2": 0.004, "k3": -0.001, "k4": 2e-4}, 75),
    "unified": ({"fx": 900, "fy": 905, "skew": 0.4, "xi": 1.2, "k1": -0.1, "k2": 0.03, "p1": 4e-4, "p2": -3e-4}, 75),
    "extended_unified": ({"fx": 400, "fy": 402, "alpha": 0.6, "beta": 1.1}, 75),
    "double_sphere": ({"fx": 320, "fy": 322, "xi": -0.2, "alpha": 0.58}, 75),
}
"""Terms, and how far from the axis the boards go, degrees."""


def lens(name: str) -> Camera:
    return Camera.create(name, {**PIXELS, **LENSES[name][0]}, image_size=SIZE)


@pytest.mark.parametrize("name", LENSES)
def test_every_model_calibrates_from_nothing(name: str) -> None:
    """Without noise the truth comes back: parameters where the views determine them singly, pixels in any case."""
    truth = lens(name)
    seen = observe(truth.model, truth.values, board_poses(24, reach_deg=LENSES[name][1], distance=(0.3, 0.7)), sigma=0)
    result = calibrate_intrinsics(seen, model=name)
    assert result.rms_px is not None
    assert result.rms_px < 1e-6
    uv = np.concatenate([v.uv for v in seen.views])
    np.testing.assert_allclose(result.camera.unproject(uv), truth.unproject(uv), atol=1e-7)
    for parameter in ("cx", "cy"):
        assert abs(result.camera.parameters[parameter] - truth.parameters[parameter]) < 1e-3


@pytest.mark.parametrize(("half_deg", "focal"), [(30, 1200.0), (50, 700.0), (75, 500.0), (100, 400.0)])
def test_the_start_finds_any_field_of_view(half_deg: float, focal: float) -> None:
    """An equidistant lens, 60 to 200 degrees: the closed form's rays are right to three degrees with 0.3 px of noise.

    The axis is 16 px from the image's centre, which alone turns rays by up to two."""
    model = MODELS["kannala_brandt"]
    values = np.array([focal, focal, 650.0, 500.0, 0, 0, 0, 0])
    seen = observe(model, values, board_poses(20, reach_deg=half_deg - 10, distance=(0.3, 0.6)), sigma=0.3)
    views = stack(seen.views)
    start = camera_start.radial_start(views.points[:, :2], views.uv, views.offsets, SIZE)
    truth, found = model.unproject(values, views.uv), start.rays(views.uv)
    found = found / np.linalg.norm(found, axis=1, keepdims=True)
    assert np.rad2deg(np.quantile(np.arccos(np.clip(np.sum(truth * found, axis=1), -1, 1)), 0.95)) < 3
    assert abs(start.focal - focal) < 0.05 * focal


def test_the_start_is_exact_on_a_lens_of_its_own_kind() -> None:
    """Centred, square pixels, psi = 1 - s/4: profile and poses to rounding."""
    model = MODELS["division"]
    unit = np.hypot(*SIZE) / 2
    values = np.array([500.0, 500.0, 639.5, 511.5, -0.25, 0.0, 0.0])
    T = board_poses(15, reach_deg=60, distance=(0.3, 0.6))
    seen = observe(model, values, T, sigma=0)
    views = stack(seen.views)
    start = camera_start.radial_start(views.points[:, :2], views.uv, views.offsets, SIZE)
    np.testing.assert_allclose(start.profile, [500 / unit, -0.25 * unit / 500, 0], atol=1e-7)
    p = se3.apply(start.T_camera_plane[np.repeat(np.arange(len(seen.views)), np.diff(views.offsets))], views.points)
    np.testing.assert_allclose(model.project(values, p), views.uv, atol=1e-4)


def test_poses_from_rays_beyond_ninety_degrees() -> None:
    """A board seen from behind the image plane: exact rays give the exact pose."""
    T = se3.make(so3.exp([0.0, np.deg2rad(120), 0.0]), [0.4, 0.0, -0.3])[None]
    grid = np.stack([*np.meshgrid(np.arange(5) * 0.02, np.arange(4) * 0.02)], axis=-1).reshape(-1, 2)
    rays = se3.apply(np.repeat(T, len(grid), axis=0), np.concatenate([grid, np.zeros((len(grid), 1))], axis=1))
    found, good = camera_start.poses_of_rays(grid, rays, np.array([0, len(grid)]))
    assert good.all()
    np.testing.assert_allclose(found, T, atol=1e-10)


def test_telecentric_lenses_calibrate() -> None:
    """Magnification from tilted boards; depth and the principal point are held, since nothing shows them."""
    rng = np.random.default_rng(53)
    values = np.array([6000.0, 6030.0, 639.5, 511.5])
    lean = so3.exp(rng.uniform(-0.6, 0.6, (12, 3)))
    T = se3.make(lean, np.concatenate([rng.uniform(-0.01, 0.01, (12, 2)), np.ones((12, 1))], axis=1))
    seen = observe(MODELS["orthographic"], values, T @ np.diag([0.3, 0.3, 1.0, 1.0]), sigma=0.1)
    small = type(seen).from_points([v.points * 0.3 for v in seen.views], [v.uv for v in seen.views], image_size=SIZE)
    result = calibrate_intrinsics(small, model="orthographic")
    for name in ("fx", "fy"):
        assert abs(result.camera.parameters[name] - values[0 if name == "fx" else 1]) < 4 * result.camera.sigma[name]
    assert result.camera.sigma["cx"] == 0
    assert result.rms_px is not None
    assert abs(result.rms_px / (0.1 * np.sqrt(2)) - 1) < 0.1


def test_a_camera_of_another_model_can_be_the_start() -> None:
    truth = lens("kannala_brandt")
    seen = observe(truth.model, truth.values, board_poses(15, reach_deg=70, distance=(0.3, 0.7)), sigma=0.1)
    first = calibrate_intrinsics(seen, model="extended_unified").camera
    result = calibrate_intrinsics(seen, model="kannala_brandt", initial=first)
    assert result.rms_px is not None
    assert abs(result.rms_px / (0.1 * np.sqrt(2)) - 1) < 0.1


@pytest.mark.parametrize("name", ["pinhole", "brown", "tilted"])
def test_a_lens_too_wide_for_its_model_is_refused_in_words(name: str) -> None:
    truth = lens("double_sphere")
    seen = observe(truth.model, truth.values, board_poses(20, reach_deg=85, distance=(0.25, 0.5)), sigma=0.1)
    with pytest.raises(RefusedError, match=r"degrees from the axis|determine the camera|converged"):
        calibrate_intrinsics(seen, model=name)


def test_splined_alone_lays_a_grid_over_the_points() -> None:
    truth = lens("brown")
    seen = observe(truth.model, truth.values, board_poses(10, reach_deg=20, distance=(0.3, 0.7)), sigma=0.1)
    model = camera_start.model_for("splined", seen)
    assert model.name.startswith("splined:12x")
    rays = truth.unproject(np.concatenate([v.uv for v in seen.views]))
    assert np.all(model.sees(model.starting_values(900.0, np.array([639.5, 511.5])), rays))
    with pytest.raises(InputError, match="unknown camera model 'spline'"):
        camera_model("spline")


@pytest.mark.long
def test_splined_follows_a_lens_that_rational_cannot() -> None:
    """A fisheye of 140 degrees, decentred: at most half of rational's error on views that neither has seen."""
    terms = {"xi": 1.3, "k1": -0.25, "k2": 0.12, "p1": 4e-3, "p2": -3e-3, "fx": 1300.0, "fy": 1300.0}
    strong = Camera.create("unified", {**PIXELS, **terms}, image_size=SIZE)
    poses = board_poses(110, reach_deg=60, distance=(0.2, 0.4))
    seen = observe(strong.model, strong.values, poses[:80], sigma=0.05)
    unseen = observe(strong.model, strong.values, poses[80:], sigma=0.05, seed=55)
    splined, rational = (held_out(calibrate_intrinsics(seen, model=m).camera, unseen) for m in ("splined", "rational"))
    assert splined < 0.5 * rational


def held_out(camera: Camera, unseen: Observations) -> float:
    """RMS, pixels, with only the poses fitted."""
    return float(np.sqrt(np.mean(target_poses(camera, unseen.views).rms_px ** 2)))
