"""Grids of circles: true centres, cut-off grids, what cannot be told, and a real set with a big dot."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from calibrant.calibrate.intrinsics.calibrate import calibrate_intrinsics
from calibrant.cameras.camera import Camera
from calibrant.detection import detect
from calibrant.detection.circles import detector as module
from calibrant.detection.circles.detector import CirclesDetector
from calibrant.detection.detection import Detection
from calibrant.geometry import se3, so3
from calibrant.simulate.render import Look, render
from calibrant.targets.circles import Circles

CAMERA = Camera.create("pinhole", {"fx": 600.0, "fy": 600.0, "cx": 319.5, "cy": 239.5}, image_size=(640, 480))
LOOK = Look(blur_px=0.7, noise_grey=2.0, uneven_light=0.2, vignetting=0.1, clutter=20)


def photograph(
    target: Circles, *, tilt_deg: float = 0.0, turn_deg: float = 0.0, shift: tuple[float, float] = (0.0, 0.0)
) -> tuple[np.ndarray, np.ndarray]:
    """An image of the grid, tilted about the picture's diagonal, and its true pixels (n, 2). shift: metres."""
    middle = target.points.mean(axis=0)
    R = so3.exp(np.deg2rad(tilt_deg) * np.array([0.6, 0.8, 0])) @ so3.exp(np.array([0, 0, np.deg2rad(turn_deg)]))
    distance = 600.0 * np.ptp(target.points, axis=0).max() / 330.0
    T = se3.make(R, np.array([*shift, distance]) - R @ middle)
    image = render(target.artwork(), CAMERA, T, rng=np.random.default_rng(3), look=LOOK)
    return image, CAMERA.project(se3.apply(T, target.points))


def rms_px(found: Detection, truth: np.ndarray) -> float:
    """Per axis."""
    return float(np.sqrt(((found.uv - truth[found.point_ids]) ** 2).mean()))


def test_an_ellipse_s_centre_is_not_the_circle_s(monkeypatch: pytest.MonkeyPatch) -> None:
    target = Circles(7, 7, 0.02, bigdot=True)
    image, truth = photograph(target, tilt_deg=50)
    found = CirclesDetector().detect(image, target)
    # 0.7 px of blur and 2 grey levels of noise leave some hundredths of a pixel on dots of 20 px.
    assert rms_px(found, truth) < 0.015
    monkeypatch.setattr(module, "true_centres", lambda steps, uv, shape, sigma: (uv, sigma))
    uncorrected = CirclesDetector().detect(image, target)
    assert rms_px(uncorrected, truth) > 3 * rms_px(found, truth)


@pytest.mark.statistics
def test_sigma_tells_the_error() -> None:
    target = Circles(9, 7, 0.02)
    chi2 = []
    for tilt in (10, 25, 40):
        image, truth = photograph(target, tilt_deg=tilt)
        found = CirclesDetector().detect(image, target)
        assert found.sigma_px is not None
        chi2.append(((found.uv - truth[found.point_ids]) ** 2 / found.sigma_px[:, None] ** 2).mean())
    # 1 when sigma is right; 380 values scatter by 0.07, and a lens's blur is not quite the model's.
    assert 0.7 < np.mean(chi2) < 1.6


def near(
    camera: Camera, seed: int, tilt_deg: float, target: Circles, distance: float = 0.6
) -> tuple[Detection, np.ndarray]:
    """A grid that nearly fills, or leaves, the picture of a lens that bends it; and the truth."""
    rng = np.random.default_rng(seed)
    R = so3.exp(np.deg2rad(tilt_deg) * np.array([0.6, 0.8, 0])) @ so3.exp(np.array([0, 0, rng.uniform(-3, 3)]))
    size = np.ptp(target.points, axis=0).max()
    shift = np.append(rng.uniform(-0.1, 0.1, 2), distance) * size
    T = se3.make(R, shift - R @ target.points.mean(axis=0))
    image = render(target.artwork(), camera, T, rng=rng, look=LOOK)
    return CirclesDetector().detect(image, target), camera.project(se3.apply(T, target.points))


@pytest.mark.long
def test_where_the_map_does_not_follow_the_lens_sigma_says_so() -> None:
    # Polynomials through the dots of a grid near a fisheye put some centres 0.5 px off, at a sigma of 0.007.
    terms = {"fx": 380.0, "fy": 380.0, "cx": 640.0, "cy": 480.0, "k1": -0.01, "k2": 0.003, "k3": 0.0, "k4": 0.0}
    camera = Camera.create("kannala_brandt", terms, image_size=(1280, 960))
    target, worst, seen = Circles(10, 10, 0.0254, bigdot=True), [], 0
    for seed in range(3):
        found, truth = near(camera, seed, 25.0, target)
        if found.found:
            assert found.sigma_px is not None
            seen += 1
            worst.append((np.linalg.norm(found.uv - truth[found.point_ids], axis=1) / found.sigma_px).max())
    assert seen >= 2
    assert max(worst) < 6.0


@pytest.mark.parametrize("seed", range(3))
def test_a_piece_of_a_grid_is_not_numbered_as_another(seed: int) -> None:
    # Far dots of a grid seen at a tilt, found by a small window, fitted a grid cut off by the picture's edge.
    terms = {"fx": 1000.0, "fy": 1000.0, "cx": 640.0, "cy": 480.0, "k1": -0.3, "k2": 0.1, "p1": 0.0, "p2": 0.0}
    camera, target = Camera.create("brown", terms | {"k3": 0.0}, image_size=(1280, 960)), Circles(9, 7, 0.03)
    found, truth = near(camera, seed, 30.0, target, distance=1.05)
    if found.found:
        ways = (truth, truth[::-1])
        assert min(np.abs(found.uv - way[found.point_ids]).max() for way in ways) < 1.0


@pytest.mark.parametrize(
    "target", [Circles(10, 7, 0.02, bigdot=True), Circles(4, 11, 0.02, asymmetric=True), Circles(9, 6, 0.02)]
)
def test_a_grid_cut_off_by_the_picture_is_numbered_as_a_whole_one(target: Circles) -> None:
    image, truth = photograph(target, tilt_deg=20)
    # Columns on the right leave the picture; the origin on the left stays.
    cut = image[:, : int(truth[:, 0].max() - 40)]
    found = CirclesDetector().detect(np.ascontiguousarray(cut), target)
    assert found.found, found.reason
    assert 0.5 * len(truth) < len(found.uv) < len(truth)
    assert rms_px(found, truth) < 0.03


@pytest.mark.parametrize("turn_deg", [0, 90, 180, 270])
def test_the_big_dot_is_the_origin_however_the_grid_is_turned(turn_deg: float) -> None:
    target = Circles(6, 6, 0.02, bigdot=True)
    image, truth = photograph(target, tilt_deg=15, turn_deg=turn_deg)
    found = CirclesDetector().detect(image, target)
    assert len(found.uv) == 36
    assert rms_px(found, truth) < 0.03


def test_without_its_origin_a_grid_that_is_cut_off_is_not_guessed() -> None:
    target = Circles(6, 6, 0.02)
    image, truth = photograph(target)
    hidden = image.copy()
    # Paper over the last column and row: nothing tells on which side they are missing.
    low = truth.reshape(6, 6, 2)[5, 5] - 0.5 * (truth[1] - truth[0])[0]
    hidden[:, int(low[0]) :] = 200
    found = CirclesDetector().detect(hidden, target)
    assert not found.found
    assert "6x5" in (found.looks_like or "") or "which dot is which" in (found.reason or "")


def test_another_size_is_named() -> None:
    image, _ = photograph(Circles(8, 6, 0.02))
    found = CirclesDetector().detect(image, Circles(9, 6, 0.02))
    assert not found.found
    assert found.looks_like == "8x6 circles"


@pytest.mark.parametrize(
    ("shown", "asked"),
    [
        (Circles(4, 11, 0.02, asymmetric=True), Circles(4, 11, 0.02)),
        (Circles(4, 11, 0.02, asymmetric=True), Circles(11, 4, 0.02)),
        (Circles(5, 8, 0.02, asymmetric=True), Circles(5, 8, 0.02)),
        (Circles(4, 11, 0.02, asymmetric=True), Circles(5, 9, 0.02, asymmetric=True)),
        (Circles(9, 6, 0.02), Circles(9, 6, 0.02, asymmetric=True)),
    ],
    ids=lambda target: target.spec,
)
@pytest.mark.parametrize("turn_deg", [0, 200])
def test_shifted_rows_are_told_from_straight_ones(shown: Circles, asked: Circles, turn_deg: float) -> None:
    image, _ = photograph(shown, tilt_deg=turn_deg / 8, turn_deg=turn_deg)
    found = CirclesDetector().detect(image, asked)
    assert found.looks_like == shown.spec
    assert found.another
    assert f"looks like {shown.spec}" in (found.reason or "")


def test_light_dots_in_shifted_rows_are_named_as_such() -> None:
    shown = Circles(4, 11, 0.02, asymmetric=True, inverted=True)
    image, _ = photograph(shown)
    assert CirclesDetector().detect(image, Circles(4, 11, 0.02)).looks_like == shown.spec


def test_a_negative_is_found_out() -> None:
    image, truth = photograph(Circles(7, 5, 0.02, inverted=True))
    found = CirclesDetector().detect(image, Circles(7, 5, 0.02))
    assert rms_px(found, truth) < 0.03
    assert any(":inverted" in note for note in found.notes)


def test_a_real_set_with_a_big_dot(shared_data: Callable[[str], Path]) -> None:
    found = detect(shared_data("handeye_rct_circles_eih") / "images", target="circles:10x10:25.4mm:bigdot")
    assert len(found.views) == 15
    assert all(len(view) >= 95 for view in found.views)
    # The published blob detector's centres gave 0.2004 px on the same images.
    assert calibrate_intrinsics(found, model="brown").rms_px <= 0.2
