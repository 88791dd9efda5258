"""Target poses: exact without noise, their uncertainty true with noise, both solutions where two fit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from calibrant.calibrate.pose.both_solutions import view_poses
from calibrant.calibrate.pose.estimate import SECOND, estimate_poses
from calibrant.cameras import Camera
from calibrant.data import Observations, View
from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.simulate.scenes import grid, look_at_board, observe, standard_camera
from calibrant.simulate.truth import chi_square, normalised

Array = NDArray[np.float64]
FISHEYE = Camera.create(
    "kannala_brandt", {"fx": 320.0, "fy": 321.0, "cx": 639.0, "cy": 511.0, "k1": 0.05, "k2": -0.01},
    image_size=(1280, 1024),
)  # fmt: skip
BOARD = grid(9, 6, 0.025)


def seen(camera: Camera, points: Array, T: Array, *, sigma_px: float, seed: int = 3) -> Observations:
    return observe(
        camera, points, np.atleast_3d(T).reshape(-1, 4, 4), sigma_px=sigma_px, rng=np.random.default_rng(seed)
    )


def facing(depth: float, tilt: float) -> Array:
    """A small target near the axis, `depth` metres away and tilted by `tilt` radians."""
    return se3.make(so3.exp([tilt, 0.0, 0.0]), [0.02, -0.01, depth])


@pytest.mark.parametrize("camera", [standard_camera(), FISHEYE], ids=["brown", "kannala_brandt"])
def test_exact_without_noise(camera: Camera) -> None:
    T = look_at_board(camera, BOARD, 5, rng=np.random.default_rng(0))
    result = estimate_poses(camera, seen(camera, BOARD, T, sigma_px=0.0))
    found = np.array([t.matrix for t in result.transforms])
    np.testing.assert_allclose(found, T, atol=1e-9)  # the inverse of the lens is exact to 1e-9 px
    assert [t.child for t in result.transforms] == [f"target@{i}" for i in range(5)]
    assert result.check("second-solution").status == "ok"


def test_a_target_behind_a_wide_lens() -> None:
    """Rays more than 90 degrees from the axis have no pixel on a plane ahead, and a pose all the same."""
    camera = replace(FISHEYE, values=FISHEYE.values * [0.7, 0.7, 1, 1, 0, 0, 1, 1])
    T = se3.make(so3.exp([0, np.deg2rad(100), 0]), [0.8, -0.05, -0.05])
    points = grid(5, 4, 0.03)
    uv = camera.project(se3.apply(T, points))
    view = View("side", points, uv, np.arange(20))
    poses = view_poses(camera, [view])
    np.testing.assert_allclose(poses.views[0].best.T_camera_target, T, atol=1e-8)


@pytest.mark.statistics
def test_the_covariance_holds_for_pixels_and_camera() -> None:
    """Normalised squared errors of 6 values average 6; camera parameters drawn from the covariance they state."""
    truth, rng = standard_camera(), np.random.default_rng(1)
    sigma = np.array([2.0, 2.0, 3.0, 3.0, 1e-3, 2e-3, 1e-4, 1e-4, 1e-3])
    trials = 150
    T = look_at_board(truth, BOARD, trials, rng=rng)
    squares, noise_only = [], []
    for k in range(trials):
        believed = replace(truth, values=truth.values + sigma * rng.standard_normal(9), covariance=np.diag(sigma**2))
        view = seen(truth, BOARD, T[k], sigma_px=0.1, seed=k).views[0]
        pose = view_poses(believed, [view], sigma_px=0.1).views[0].best
        error = se3.local(pose.T_camera_target, T[k])
        squares.append(chi_square(error, pose.covariance))
        assert pose.of_camera is not None
        noise_only.append(chi_square(error, pose.covariance - pose.of_camera))
    # The mean of 150 chi-squares with 6 degrees scatters by sqrt(12 / 150) = 0.28; four times that is allowed.
    assert np.mean(squares) == pytest.approx(6.0, abs=1.2)
    assert np.mean(noise_only) > 20  # and it is the camera's share that makes it true


def test_the_noise_is_estimated_where_nobody_states_it() -> None:
    camera = standard_camera()
    T = look_at_board(camera, BOARD, 6, rng=np.random.default_rng(2))
    observations = seen(camera, BOARD, T, sigma_px=0.2)
    assert estimate_poses(camera, observations).sigma_px == pytest.approx(0.2, rel=0.1)  # 1 / sqrt(2 * 612) is 3 %
    stated = tuple(replace(v, sigma_px=np.full(len(v), 0.2)) for v in observations.views)
    assert estimate_poses(camera, replace(observations, views=stated)).sigma_px == pytest.approx(0.2, rel=0.1)


@pytest.mark.statistics
def test_the_second_solution_is_as_probable_as_it_says() -> None:
    """Small tilted squares far away: of views told with probability p, a share p is right."""
    camera, points, rng = standard_camera(), grid(3, 3, 0.02), np.random.default_rng(4)
    said, right = [], []
    for k in range(250):
        axis = np.append(rng.standard_normal(2), 0.0)
        tilt = rng.uniform(0.2, 0.6) * axis / np.linalg.norm(axis)
        T = se3.make(so3.exp(tilt) @ so3.exp([0, 0, rng.uniform(-3, 3)]), [0.01, 0.02, rng.uniform(0.8, 1.6)])
        pose = view_poses(camera, seen(camera, points, T, sigma_px=0.3, seed=k).views, sigma_px=0.3).views[0]
        if pose.other is None:
            continue
        ours, theirs = (so3.angle(s.T_camera_target[:3, :3] @ T[:3, :3].T) for s in (pose.best, pose.other))
        said.append(pose.best.probability)
        right.append(ours < theirs)
    p, hit = np.array(said), np.array(right)
    assert len(p) > 150
    for low, high in ((0.5, 0.8), (0.8, 1.01)):
        inside = (p >= low) & (p < high)
        assert inside.sum() > 30
        # 3 sigma of a share of this many views.
        assert hit[inside].mean() == pytest.approx(p[inside].mean(), abs=3 * np.sqrt(0.25 / inside.sum()))


def test_both_solutions_are_given_where_they_cannot_be_told_apart() -> None:
    camera, points = standard_camera(), grid(2, 2, 0.03)
    truth = facing(1.5, 0.4)
    result = estimate_poses(camera, seen(camera, points, truth, sigma_px=0.3, seed=1), sigma_px=0.3)
    assert [t.child for t in result.transforms] == ["target", "target" + SECOND]
    assert result.verdict == "warn"
    assert "odds" in result.check("second-solution").message
    sure = estimate_poses(camera, seen(camera, points, truth, sigma_px=0.3, seed=1), sigma_px=0.3, confidence=0.501)
    assert [t.child for t in sure.transforms] == ["target"]
    assert "below 20 : 1" in sure.check("second-solution").message
    assert "0.png" in result.check("second-solution").message or "0:" in result.check("second-solution").message
    angles = [so3.angle(t.matrix[:3, :3] @ truth[:3, :3].T) for t in result.transforms]
    assert min(angles) < 0.25
    assert max(angles) > 0.4
    near = estimate_poses(camera, seen(camera, points, facing(0.15, 0.4), sigma_px=0.3, seed=1), sigma_px=0.3)
    assert [t.child for t in near.transforms] == ["target"]
    assert near.check("second-solution").value > 0.99  # type: ignore[operator]


def test_depth_is_the_weakest_direction() -> None:
    camera = standard_camera()
    pose = view_poses(camera, seen(camera, BOARD, facing(1.0, 0.3), sigma_px=0.1).views).views[0]
    assert pose.weakest.to_sight_deg < 10
    assert pose.weakest.axis_to_sight_deg > 70
    assert pose.weakest.sigma_mm > 1e3 * np.sqrt(np.diag(pose.best.covariance)[3])


def test_a_gross_error_is_left_out() -> None:
    camera = standard_camera()
    T = look_at_board(camera, BOARD, 1, rng=np.random.default_rng(5))
    view = seen(camera, BOARD, T, sigma_px=0.1).views[0]
    uv = view.uv.copy()
    uv[7] += [9.0, -6.0]
    observations = replace(seen(camera, BOARD, T, sigma_px=0.1), views=(replace(view, uv=uv),))
    result = estimate_poses(camera, observations)
    assert result.views[0].points_left_out == 1
    assert normalised(result.transforms[0], T[0]) < 22.5  # chi-square of 6, 0.999


def test_mixed_up_points_fit_no_pose() -> None:
    camera = standard_camera()
    T = look_at_board(camera, BOARD, 1, rng=np.random.default_rng(6))
    found = seen(camera, BOARD, T, sigma_px=0.1)
    uv = np.random.default_rng(0).permutation(found.views[0].uv)
    result = estimate_poses(camera, replace(found, views=(replace(found.views[0], uv=uv),)))
    assert result.verdict == "refused"
    assert "no pose fits" in result.check("reprojection").message


def test_residuals_beyond_the_noise_that_was_given_are_said() -> None:
    camera = standard_camera()
    found = seen(camera, BOARD, look_at_board(camera, BOARD, 3, rng=np.random.default_rng(6)), sigma_px=0.3)
    assert estimate_poses(camera, found, sigma_px=0.3).check("noise").status == "ok"
    said = estimate_poses(camera, found, sigma_px=0.1).check("noise")
    assert said.status == "warn"
    assert "times what it leaves" in said.message
    # A camera that is uncertain by more may have made them.
    doubted = replace(camera, covariance=np.diag(np.square([5.0, 5, 5, 5, 0.1, 0.1, 0, 0, 0.1])))
    assert estimate_poses(doubted, found, sigma_px=0.1).check("noise").status == "ok"


def test_points_as_near_to_their_neighbours_places_fit_no_pose() -> None:
    camera = standard_camera()
    T = look_at_board(camera, BOARD, 1, rng=np.random.default_rng(6))
    found = seen(camera, BOARD, T, sigma_px=0.0)
    view = found.views[0]
    apart = np.linalg.norm(view.uv[1] - view.uv[0])
    uv = view.uv + 0.5 * apart * np.random.default_rng(1).standard_normal((54, 2))
    result = estimate_poses(camera, replace(found, views=(replace(view, uv=uv),)))
    assert result.verdict == "refused"
    assert "neighbour" in result.check("reprojection").message


def test_few_spare_values_and_an_uncertain_camera_are_said() -> None:
    camera = standard_camera()
    result = estimate_poses(camera, seen(camera, grid(2, 2, 0.1), facing(0.5, 0.5), sigma_px=0.1))
    assert "2 values to spare" in result.check("noise").message
    assert "states no uncertainty" in result.check("camera").message


def test_bad_input_is_named() -> None:
    camera = standard_camera()
    T = facing(0.5, 0.3)
    found = seen(camera, BOARD, T, sigma_px=0.1)
    few = replace(found, views=(found.views[0].subset(np.arange(54) < 3),))
    with pytest.raises(InputError, match="no view has 4 points or more: 0 has 3"):
        estimate_poses(camera, few)
    line = BOARD[:9]
    with pytest.raises(InputError, match="on a line"):
        estimate_poses(camera, seen(camera, line, T, sigma_px=0.0))
    with pytest.raises(InputError, match="for images of 1280x1024"):
        estimate_poses(camera, replace(found, image_sizes={"camera": (640, 480)}))
    with pytest.raises(InputError, match="a probability between"):
        estimate_poses(camera, found, confidence=99.0)
    with pytest.raises(InputError, match="above 0"):
        estimate_poses(camera, found, sigma_px=-1.0)
    flat = Camera.create("orthographic", {"fx": 1e4, "fy": 1e4, "cx": 640, "cy": 512}, image_size=(1280, 1024))
    with pytest.raises(InputError, match="sees no distance"):
        estimate_poses(flat, found)
