"""Boxes of a few pixels, and boxes that the picture's edge cuts: as certain as stated, or refused in words."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy.stats import chi2
from tests.perceive.boxes_on_a_table import Thing, camera_at, d435, exact_depth, looking_down, photograph

from calibrant.cameras import Camera
from calibrant.errors import RefusedError
from calibrant.geometry import se3, so3
from calibrant.perceive.colour.ranges import ColourRange
from calibrant.perceive.colour.segments import find_segments
from calibrant.perceive.object_pose.locate import locate, mixture
from calibrant.perceive.object_pose.outline_edges import sampling_bias
from calibrant.perceive.object_pose.poses import ObjectPose
from calibrant.perceive.object_pose.seen import Scene
from calibrant.perceive.object_pose.shapes import box
from calibrant.perceive.registered_depth.noise import OFFSET_PX, DepthNoise
from calibrant.perceive.registered_depth.register import DepthRig
from calibrant.perceive.registered_depth.steps import rounding_error

RED = ColourRange.parse("h:340-20 s:40-100 v:10-100")
CUBOID = np.array([0.054, 0.037, 0.005])
CUBE = np.array([0.04] * 3)
BASELINE_M = 0.095


def located(camera: Camera, T: np.ndarray, thing: Thing, seed: int, *, samples: int = 1) -> ObjectPose:
    """By a picture of `samples` x `samples` samples a pixel, and the depth of a D455."""
    rng = np.random.default_rng(seed)
    image = photograph(camera, T, [thing], rng, blur=0.7, samples=samples)
    f_b = camera.parameters["fx"] * BASELINE_M
    z = d435(exact_depth(camera, T, [thing]), rng, f_b=f_b, offset_px=rng.normal(0, OFFSET_PX))
    noise = DepthNoise.stereo(focal_px=camera.parameters["fx"], baseline_m=BASELINE_M)
    scene = Scene.of(image, z, DepthRig.aligned(camera), noise=noise, staircase=1 / samples)
    return locate(scene, find_segments(image, RED)[0], box(thing.sides))


def squared(pose: ObjectPose, truth: np.ndarray) -> float:
    e = pose.error(truth)
    return float(e @ np.linalg.solve(pose.covariance, e))


@pytest.mark.statistics
@pytest.mark.parametrize(("sides", "tilt"), [(CUBE, 10.0), (CUBE, 45.0), (CUBOID, 5.0)])
def test_boxes_of_a_hundred_pixels_are_as_far_off_as_stated(sides: np.ndarray, tilt: float) -> None:
    camera = camera_at(385.0)
    squares = []
    for seed in range(30):
        rng = np.random.default_rng(200 + seed)
        T = looking_down(1.3, tilt, rng.uniform(0, 360))
        place = [*rng.uniform(-0.2, 0.2, 2), sides[2] / 2]
        thing = Thing(se3.make(so3.exp([0, 0, rng.uniform(0, 2 * np.pi)]), place), sides)
        squares.append(squared(located(camera, T, thing, seed), T @ thing.T_table_box))
    # 30 trials: 95 % inside are 28.5 with sigma 1.2.
    assert np.sum(np.array(squares) < chi2.ppf(0.95, 6)) >= 25
    assert 0.35 < np.mean(squares) / 6 < 1.6


@pytest.mark.parametrize("degrees", [0.0, 1.2, 6.0, 26.6])
@pytest.mark.parametrize("length", [9.0, 40.0])
def test_what_the_grid_makes_a_side_err_by_is_that_of_a_staircase(degrees: float, length: float) -> None:
    angle = np.deg2rad(degrees)
    count = max(round(length * np.cos(angle)), 1)
    phases = (np.arange(2000) + 0.5) / 2000
    y = np.tan(angle) * np.arange(count) + phases[:, None]
    off = np.cos(angle) * np.mean(np.floor(y) + 0.5 - y, axis=1)
    stated = sampling_bias(np.array([[np.sin(angle), np.cos(angle)]]), np.array([length]), 1.0)
    # The count of columns is rounded here, and the sum cut at its eleventh term: 3 % of the largest.
    assert stated[0] == pytest.approx(float(off.std()), abs=0.02)
    assert sampling_bias(np.array([[0.0, 1.0]]), np.array([length]), 0.0)[0] == 0.0


def test_rounding_that_noise_has_averaged_out_is_none() -> None:
    """A sigma of 1e-160 is a weight that no number holds: eigenvalues of what follows did not converge."""
    left = [rounding_error(1.0, s) for s in np.linspace(0.0, 8.0, 81)]
    assert all(s == 0.0 or s >= 1e-6 for s in left)
    assert left[0] > 0.28
    assert left[-1] == 0.0


def cut(x: float, y: float) -> tuple[Camera, np.ndarray, Thing]:
    thing = Thing(se3.make(so3.exp([0, 0, 0.5]), [x, y, 0.02]), CUBE)
    return camera_at(308.0, (320, 240)), looking_down(0.36), thing


@pytest.mark.parametrize(("x", "y"), [(-0.195, -0.13), (0.2, 0.13)])
def test_a_corner_of_a_cube_in_the_pictures_corner_is_refused(x: float, y: float) -> None:
    """The best fit lay outside the picture, 0.8 m away, and was believed."""
    camera, T, thing = cut(x, y)
    with pytest.raises(RefusedError, match="does not fit what is seen"):
        located(camera, T, thing, 0, samples=4)


def test_a_cube_of_which_most_is_in_the_picture_is_where_it_is() -> None:
    camera, T, thing = cut(0.175, 0.0)
    pose = located(camera, T, thing, 0, samples=4)
    assert any("edge cuts" in n for n in pose.notes)
    assert squared(pose, T @ thing.T_table_box) < chi2.ppf(0.999, 6)


def test_another_pose_that_fits_as_well_is_spanned_and_told() -> None:
    known = SimpleNamespace(covariance=lambda name: np.diag([1e-4] * 3 + [1e-6] * 3))
    T = se3.make(np.eye(3), [0, 0, 1.0])
    best = SimpleNamespace(T=T, chi2=3.0, solution=known)
    turn = np.deg2rad(15)
    other = SimpleNamespace(T=T @ se3.make(so3.exp([0, 0, turn]), [0, 0, 0]), chi2=3.0)
    notes: list[str] = []
    spread = mixture(cast("Any", best), [cast("Any", other)], box(CUBOID), notes)
    # Half of the weight is 15 degrees away.
    assert spread[2, 2] == pytest.approx(1e-4 + turn**2 / 2)
    assert spread[3, 3] == pytest.approx(1e-6)
    assert "turned by 15°" in notes[0]
    far = SimpleNamespace(T=other.T, chi2=80.0)
    assert mixture(cast("Any", best), [cast("Any", far)], box(CUBOID), []) == pytest.approx(known.covariance(""))
    same = SimpleNamespace(T=T @ se3.make(so3.exp([0, 0, np.pi]), [0, 0, 0]), chi2=3.0)
    assert mixture(cast("Any", best), [cast("Any", same)], box(CUBOID), []) == pytest.approx(known.covariance(""))
