"""Depth of rendered planes, spheres and boxes: errors as large as stated, both ways around, and bad input by name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.perceive.stereo.made import made_eyes, pixels_of, seen_points, small_eyes
from tests.perceive.stereo.rendered import depth_along, photograph, scene

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3, so3
from calibrant.perceive.stereo import disparity
from calibrant.perceive.stereo.depth import DepthMap, depth_map, depth_points
from calibrant.perceive.stereo.eyes import Eyes
from calibrant.perceive.stereo.rectification import Projection, rectification

VERTICAL = se3.make(so3.exp([0.05, 0.01, -0.01]), [0.003, 0.12, 0.004])
EXACT = small_eyes()


def _pictures(eyes: Eyes, distance: float, *, noise: float = 2.0, seed: int = 1) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    grain = distance * 5 / 265
    pairs = zip(eyes.cameras, eyes.T_first_camera)
    return [photograph(scene(distance), c, T, grain=grain, rng=rng, noise=noise) for c, T in pairs]


def _errors(found: DepthMap, distance: float) -> tuple[Array, Array]:
    """z - true z and sigma of all known points, metres."""
    maps = found.pair.maps[0]
    camera = found.pair.eyes.cameras[0]
    true = depth_along(scene(distance), camera, np.eye(4), np.stack([maps.map_u, maps.map_v], axis=-1))
    known = found.known & np.isfinite(true[..., 2])
    return (found.points - true)[..., 2][known], found.sigma_z[known]


@pytest.mark.long
@pytest.mark.parametrize("distance", [0.5, 1.0, 2.0])
@pytest.mark.parametrize(("noise", "least"), [(1.0, 0.65), (3.0, 0.8)])
def test_depth_errors_follow_the_stated_sigma(distance: float, noise: float, least: float) -> None:
    """With little noise interpolation's own errors are left, which are quicker than noise; creases err as well."""
    found = depth_map(rectification(EXACT), _pictures(EXACT, distance, noise=noise))
    off, sigma = _errors(found, distance)
    assert found.known.mean() > 0.4
    assert least < np.mean((off / sigma) ** 2) < 1.25
    assert np.median(np.abs(off)) < 0.002 * distance**2 / 0.5  # z^2 / (f B) is 31 mm a pixel at 1 m
    assert np.mean(np.abs(off) > 5 * sigma) < 0.01


def test_slanted_faces_and_their_edges_are_measured_as_walls_are() -> None:
    """Disparities that slope by a third of a pixel a pixel are a surface, not a jump; where two faces meet, sigma knows
    of the bend."""
    found = depth_map(rectification(EXACT), _pictures(EXACT, 1.0))
    maps = found.pair.maps[0]
    true = depth_along(scene(1.0), EXACT.cameras[0], np.eye(4), np.stack([maps.map_u, maps.map_v], axis=-1))[..., 2]
    box = np.zeros(true.shape, dtype=bool)
    box[100:195, 40:155] = true[100:195, 40:155] < 1.0
    assert found.known[box].mean() > 0.8
    z = ((found.points[..., 2] - true) / found.sigma_z)[box & found.known]
    assert 0.4 < np.mean(z**2) < 1.25
    assert np.mean(np.abs(z) > 5) < 0.001


@pytest.mark.parametrize("angle", [0.0, np.pi / 4, np.pi / 2])
def test_what_a_crease_is_blunted_by_is_what_the_refinements_equations_say(angle: float) -> None:
    """A roof of disparities on random gradients, refined without noise: what is left is the crease's alone."""
    ratios = []
    for seed in range(4):
        g = np.gradient(np.random.default_rng(seed).normal(size=(160, 240)), axis=1)
        y, x = np.mgrid[:160, :240] - np.array([80, 120])[:, None, None]
        roof, known = 0.01 * np.abs(x * np.cos(angle) + y * np.sin(angle)), np.ones(g.shape, dtype=bool)
        mean, n = disparity._sum(g), disparity.WINDOW**2
        gg, d = disparity._sum(g * g) - mean**2 / n, disparity._smooth(roof, known)
        for _ in range(disparity._ITERATIONS):
            base = disparity._smooth(d, known)
            r = g * (roof - base)
            d = base + (disparity._sum(g * r) - mean * disparity._sum(r) / n) / gg
        inner = np.s_[25:-25, 25:-25]
        ratios.append(np.sum((d - roof)[inner] ** 2) / np.sum(disparity._left_out(d, known)[inner] ** 2))
    assert np.mean(ratios) == pytest.approx(disparity.CREASE, rel=0.15)


@pytest.mark.long
@pytest.mark.parametrize(("T", "projection"), [(VERTICAL, "pinhole"), (EXACT.T_first_camera[1], "cylinder")])
def test_cameras_above_each_other_and_cylinders_measure_too(T: Array, projection: Projection) -> None:
    eyes = small_eyes(T=T)
    found = depth_map(rectification(eyes, projection=projection), _pictures(eyes, 1.0))
    off, sigma = _errors(found, 1.0)
    assert found.known.mean() > 0.4
    assert 0.7 < np.mean((off / sigma) ** 2) < 1.4
    cloud = found.cloud(_pictures(eyes, 1.0)[0])
    assert set(cloud.values) == {"sigma_z", "sigma_matches", "sigma_calibration", "confidence"}
    assert cloud.frame == "left"


def test_the_depth_follows_the_calibration_as_its_derivative_says() -> None:
    """Every number of the calibration moved by itself, pixels held: the pixels' own rows, in their own pictures."""
    eyes = made_eyes()
    pair = rectification(eyes)
    X = seen_points(eyes, 6, np.random.default_rng(1))
    uv = pixels_of(eyes, X)
    left, right = (pair.pixels(i, uv[i]) for i in (0, 1))
    found, by_d, by_all = depth_points(pair, left, (left - right)[:, 0])
    np.testing.assert_allclose(found, X, atol=1e-9)
    step = 1e-4
    ends = [depth_points(pair, left, (left - right)[:, 0] + s * step)[0] for s in (1, -1)]
    np.testing.assert_allclose(by_d, (ends[0] - ends[1]) / (2 * step), rtol=1e-4, atol=1e-9)
    for k in range(len(eyes.covariance)):
        h = 1e-3 * np.sqrt(eyes.covariance[k, k])
        ends = [_on_row(_moved(eyes, k, s * h), pair.R_rectified_camera[1], pair.views[1].f, uv) for s in (1, -1)]
        J = (ends[0] - ends[1]) / (2 * h)
        np.testing.assert_allclose(by_all[:, :, k], J, rtol=1e-3, atol=1e-4 * np.abs(J).max() + 1e-10)


def _moved(eyes: Eyes, k: int, h: float) -> Eyes:
    delta = np.zeros(len(eyes.covariance))
    delta[k] = h
    T = np.stack([np.eye(4), se3.retract(eyes.T_first_camera[1], delta[:6])])
    cameras = tuple(
        Camera(c.model, c.image_size, c.values + delta[eyes.lens_columns(i)]) for i, c in enumerate(eyes.cameras)
    )
    return replace(eyes, T_first_camera=T, cameras=cameras)


def _on_row(eyes: Eyes, R_right: Array, f: float, uv: Array) -> Array:
    """The points of the left rays whose direction in the right camera has the match's own x / z, by bisection."""
    rays = eyes.cameras[0].unproject(uv[0])
    wanted = eyes.cameras[1].unproject(uv[1]) @ R_right.T
    wanted = f * wanted[:, 0] / wanted[:, 2]
    low, high = np.full(len(rays), 0.2), np.full(len(rays), 5.0)
    for _ in range(70):
        middle = (low + high) / 2
        p = se3.apply(se3.inverse(eyes.T_first_camera[1]), rays * middle[:, None]) @ R_right.T
        beyond = f * p[:, 0] / p[:, 2] > wanted
        low, high = np.where(beyond, low, middle), np.where(beyond, middle, high)
    return rays * low[:, None]


def test_any_callable_matches() -> None:
    """A matcher that knows the scene to half a pixel, in steps of one: the refinement does the rest."""
    pair = rectification(EXACT)
    images = _pictures(EXACT, 1.0)
    true = [
        depth_along(scene(1.0), c, T, np.stack([m.map_u, m.map_v], axis=-1)) @ R.T
        for c, T, m, R in zip(EXACT.cameras, EXACT.T_first_camera, pair.maps, pair.R_rectified_camera)
    ]
    steps = [np.rint(pair.views[0].f * pair.baseline / t[..., 2]) for t in true]
    calls = []

    def known(left: np.ndarray, right: np.ndarray) -> np.ndarray:
        calls.append(left.shape)
        return steps[0] if len(calls) == 1 else steps[1][:, ::-1]

    off, sigma = _errors(depth_map(pair, images, matcher=known), 1.0)
    assert len(calls) == 2
    assert 0.6 < np.mean((off / sigma) ** 2) < 1.4
    with pytest.raises(InputError, match="the matcher gave disparities"):
        depth_map(pair, images, matcher=lambda a, b: np.zeros((2, 2)))


def test_exchanged_sides_empty_clouds_and_wrong_sizes_are_named() -> None:
    images = _pictures(EXACT, 1.0)
    pair = rectification(EXACT)
    with pytest.raises(RefusedError, match="the sides are exchanged"):
        depth_map(pair, images[::-1])
    back = small_eyes(T=se3.inverse(EXACT.T_first_camera[1]))
    with pytest.raises(InputError, match="--cameras right,left"):
        depth_map(rectification(back), images)
    blank = [np.full((240, 320), 128, np.uint8)] * 2
    with pytest.raises(RefusedError, match="the cloud is empty"):
        depth_map(pair, blank).cloud(blank[0])
    with pytest.raises(InputError, match="the image is 160x120 px"):
        depth_map(pair, [images[0][:120, :160], images[1]])
    with pytest.raises(InputError, match="0 < near < far"):
        depth_map(pair, images, near=2.0, far=1.0)


@pytest.mark.long
def test_what_lies_outside_of_the_distances_asked_for_is_no_point() -> None:
    """Matchers search in steps of 16 pixels and reach farther than they are asked to."""
    images, pair = _pictures(EXACT, 1.0), rectification(EXACT)
    every = depth_map(pair, images).points[..., 2]
    # The box's nearest corner and the wall's farthest one.
    assert (np.nanmin(every), np.nanmax(every)) == (pytest.approx(0.75, abs=0.02), pytest.approx(1.38, abs=0.02))
    within = depth_map(pair, images, near=1.0, far=1.2)
    z = within.points[within.known][:, 2]
    assert len(z) > 0.5 * np.sum((every > 1.0) & (every < 1.2))
    assert z.min() >= 1.0
    assert z.max() <= 1.2
    assert np.array_equal(within.known, np.isfinite(within.sigma_z))
    assert np.array_equal(within.known, np.isfinite(within.disparity.d))
    assert not depth_map(pair, images, near=2.0, far=3.0).known.any()
