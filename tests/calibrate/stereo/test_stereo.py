"""Stereo: the rig's digits, exact on exact data, epipolar errors that are distances, sides that are told apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

import calibrant as cb
from calibrant.calibrate.cell.rig import fit_rig
from calibrant.calibrate.stereo.depth import point_certainty
from calibrant.calibrate.stereo.edges import neighbours
from calibrant.calibrate.stereo.pairs import epipolar_errors, fundamental, seen_by_both
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, Observations
from calibrant.data.details import EpipolarErrors, StereoGeometry, TriangulatedEdges
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3, so3
from calibrant.simulate.scenes import grid, standard_camera
from calibrant.simulate.stereo import StereoScene, stereo_scene


@pytest.fixture(scope="module")
def scene() -> StereoScene:
    return stereo_scene(3)


@pytest.fixture(scope="module")
def result(scene: StereoScene) -> CalibrationResult:
    return cb.calibrate_stereo(scene.observations)


def test_the_digits_are_those_of_the_rig(scene: StereoScene, result: CalibrationResult) -> None:
    rig = cb.calibrate_rig(scene.observations)
    assert (result.kind, rig.kind) == ("stereo", "rig")
    for mine, theirs in zip(result.transforms, rig.transforms, strict=True):
        np.testing.assert_array_equal(mine.matrix, theirs.matrix)
        np.testing.assert_array_equal(mine.covariance, theirs.covariance)
    for name, camera in rig.cameras.items():
        np.testing.assert_array_equal(result.cameras[name].values, camera.values)
        np.testing.assert_array_equal(result.cameras[name].covariance, camera.covariance)


def test_exact_points_give_the_exact_pair() -> None:
    scene = stereo_scene(1, sigma_px=(0.0, 0.0))
    found = cb.calibrate_stereo(scene.observations)
    np.testing.assert_allclose(found.transform("left", "right").matrix, scene.T_left_right, atol=1e-7)
    for side, camera in scene.cameras.items():
        np.testing.assert_allclose(found.cameras[side].values, camera.values, atol=1e-3, rtol=1e-6)
    assert found.rms_px == pytest.approx(0, abs=1e-6)
    assert found.figures["epipolar RMS"].value == pytest.approx(0, abs=1e-5)
    assert found.figures["edge RMS"].value == pytest.approx(0, abs=1e-4)
    baseline = 1e3 * float(np.linalg.norm(scene.T_left_right[:3, 3]))
    assert found.figures["baseline"].value == pytest.approx(baseline, abs=1e-4)


def test_opencvs_words_for_the_pair(result: CalibrationResult) -> None:
    """X_right = R X_left + t; E and F vanish on what both see."""
    pair = result.detail(StereoGeometry)
    assert pair is not None
    T = se3.inverse(result.transform("left", "right").matrix)
    np.testing.assert_allclose(pair.R, T[:3, :3], atol=1e-15)
    np.testing.assert_allclose(pair.t_m, T[:3, 3], atol=1e-15)
    p = np.array([[0.05, -0.02, 0.7], [-0.1, 0.08, 1.3]])
    a, b = p / p[:, 2:], se3.apply(T, p) / se3.apply(T, p)[:, 2:]
    np.testing.assert_allclose(np.einsum("ni,ij,nj->n", b, np.array(pair.E), a), 0, atol=1e-15)
    u, v = a @ result.cameras["left"].K.T, b @ result.cameras["right"].K.T
    np.testing.assert_allclose(np.einsum("ni,ij,nj->n", v, np.array(pair.F), u), 0, atol=1e-12)


def test_an_epipolar_error_is_a_distance_in_undistorted_pixels(scene: StereoScene) -> None:
    """A pinhole pair of parallel axes: lines are rows, so that a shift of rows is the error, in both images."""
    K = {"fx": 500.0, "fy": 500.0, "cx": 320.0, "cy": 240.0}
    eye = Camera.create("pinhole", K, image_size=(640, 480))
    T = se3.make(np.eye(3), [0.1, 0, 0])
    points = se3.apply(se3.make(np.eye(3), [0, 0, 0.8]), grid(4, 3, 0.05))
    views = [
        cb.View(side, points, eye.project(se3.apply(M, points)) + np.array([0, row]), np.arange(12), side, moment="0")
        for side, M, row in (("left", np.eye(4), 0.0), ("right", se3.inverse(T), 0.7))
    ]
    pairs = seen_by_both(views[:1], views[1:])
    found = epipolar_errors(pairs, eye, eye, T, sigma_px=(0.3, 0.4))
    assert found is not None
    np.testing.assert_allclose(found.pairs["0"].left_px, 0.7, atol=1e-9)
    np.testing.assert_allclose(found.pairs["0"].right_px, 0.7, atol=1e-9)
    assert (found.rms_px, found.min_px, found.max_px) == pytest.approx((0.7, 0.7, 0.7))
    assert found.expected_px == pytest.approx(0.5)
    assert fundamental(eye, eye, T)[1, 2] == pytest.approx(-fundamental(eye, eye, T)[2, 1])


def test_what_noise_makes_of_epipolar_errors_with_a_small_and_a_large_image_and_a_wide_lens() -> None:
    """A camera of a fifth of the other's resolution, turned and bent: rms of errors of true points with noise."""
    large = Camera.create("pinhole", {"fx": 1500.0, "fy": 1500.0, "cx": 640.0, "cy": 480.0}, image_size=(1280, 960))
    lens = {"fx": 300.0, "fy": 300.0, "cx": 160.0, "cy": 120.0, "k1": -0.3, "k2": 0.0, "p1": 0.0, "p2": 0.0, "k3": 0.0}
    small = Camera.create("brown", lens, image_size=(320, 240))
    T = se3.make(so3.exp([0.05, 0.2, -0.1]), [0.1, 0.01, 0.02])
    points = se3.apply(se3.make(so3.exp([0.3, -0.4, 0.1]), [-0.15, -0.1, 0.8]), grid(40, 30, 0.008))
    rng, sigma = np.random.default_rng(1), (0.05, 0.04)
    views = [
        cb.View(side, points, uv + s * rng.normal(size=uv.shape), np.arange(len(uv)), side, moment="0")
        for side, s, uv in zip(
            ("left", "right"), sigma, (large.project(points), small.project(se3.apply(se3.inverse(T), points)))
        )
    ]
    found = epipolar_errors(seen_by_both(views[:1], views[1:]), large, small, T, sigma_px=sigma)
    assert found is not None
    assert found.rms_px == pytest.approx(found.expected_px, rel=0.05)
    assert found.expected_px > 2 * np.hypot(*sigma)


def test_the_noise_of_both_images_makes_the_epipolar_errors(result: CalibrationResult) -> None:
    found = result.detail(EpipolarErrors)
    assert found is not None
    # Lines of like scale: the distance has the noise of both; the right image is 0.8 times the left's scale.
    assert found.rms_px == pytest.approx(found.expected_px, rel=0.15)
    assert result.check("epipolar").status == "ok"
    assert 0 <= found.min_px < found.rms_px < found.max_px


def test_a_points_certainty_against_differences(scene: StereoScene) -> None:
    """One sigma of one parameter at a time: the triangulated point moves by what the covariance says."""
    left, right = scene.cameras.values()
    T = scene.T_left_right
    p = np.array([[0.05, 0.03, 0.8]])
    uv = left.project(p), right.project(se3.apply(se3.inverse(T), p))
    lens = [1e-3] * 4 + [1e-4, 1e-3, 1e-5, 1e-5, 1e-2]
    steps = np.array([1e-6] * 6 + [*lens, *lens])

    def at(k: int, sign: float) -> np.ndarray:
        d = np.zeros(24)
        d[k] = sign * steps[k]
        a, b = replace(left, values=left.values + d[6:15]), replace(right, values=right.values + d[15:])
        T_right = se3.inverse(se3.retract(T, d[:6]))

        def residuals(x: np.ndarray) -> np.ndarray:
            return np.concatenate([a.project(x) - uv[0][0], b.project(se3.apply(T_right, x)) - uv[1][0]])

        return least_squares(residuals, p[0], xtol=1e-15, ftol=1e-15, gtol=1e-15, x_scale=1e-3).x

    for k in range(24):
        moved = 0.5 * (at(k, 1) - at(k, -1))
        C = np.zeros((24, 24))
        C[k, k] = steps[k] ** 2
        found = point_certainty(
            (left, right), np.stack([np.eye(4), T]), p, covariance=C, sigma_px=(0.1, 0.1)
        ).calibration[0]
        np.testing.assert_allclose(found, np.outer(moved, moved), rtol=1e-3, atol=1e-3 * np.trace(found))


def test_edges_are_nearest_neighbours() -> None:
    assert len(neighbours(grid(9, 6, 0.025))) == 9 * 5 + 8 * 6
    assert len(neighbours(grid(1, 1, 0.025))) == 0


def test_swapped_sides_are_said(scene: StereoScene) -> None:
    """Named the other way round, the baseline points to the left."""
    other = {"left": "right", "right": "left"}
    views = tuple(replace(v, camera=other[v.camera]) for v in scene.observations.views)
    sizes = {other[name]: size for name, size in scene.observations.image_sizes.items()}
    swapped = Observations(views, {name: sizes[name] for name in ("left", "right")})
    check = cb.calibrate_stereo(swapped).check("sides")
    assert check.status == "warn"
    assert "swapped" in check.message
    assert cb.calibrate_stereo(scene.observations).check("sides").status == "ok"


def test_a_board_that_one_camera_misses_counts_for_the_other(scene: StereoScene) -> None:
    views = tuple(v for v in scene.observations.views if not (v.camera == "right" and v.moment in ("03", "07")))
    found = cb.calibrate_stereo(replace(scene.observations, views=views))
    message = found.check("pairs").message
    assert "12 pairs used" in message
    assert "left alone saw the board in left03, left07" in message
    assert sum(v.used for v in found.views) == len(views)


def test_three_cameras_are_a_rig(scene: StereoScene) -> None:
    sizes = {**scene.observations.image_sizes, "third": (640, 480)}
    with pytest.raises(InputError, match="takes two cameras, the observations have 3"):
        cb.calibrate_stereo(replace(scene.observations, image_sizes=sizes))


def test_edges_are_as_good_as_noise_lets_them(result: CalibrationResult) -> None:
    found = result.detail(TriangulatedEdges)
    assert found is not None
    assert found.length_mm == pytest.approx(25)
    # A tenth of a pixel at 0.7 m and 0.12 m apart is half a millimetre in depth, along the tilted edge less of it.
    assert 0.01 < found.rms_mm < 1.0
    assert abs(found.mean_mm) < found.rms_mm


def equal_scene(seed: int, *, sigma: float = 0.1) -> StereoScene:
    """Two cameras of one focal length, and all else different."""
    left = standard_camera()
    focal = {n: left.parameters[n] for n in ("fx", "fy")}
    right = Camera.create("brown", focal | {"cx": 500.2, "cy": 380.1, "k1": -0.11}, image_size=(1000, 780))
    return stereo_scene(seed, sigma_px=(sigma, sigma), cameras=(left, right))


@pytest.mark.long
def test_one_focal_length_for_both() -> None:
    exact = cb.calibrate_stereo(equal_scene(1, sigma=0.0).observations, same_focal=True)
    np.testing.assert_allclose(exact.transform("left", "right").matrix, equal_scene(1).T_left_right, atol=1e-7)
    scene = equal_scene(2)
    free, tied = (cb.calibrate_stereo(scene.observations, same_focal=same) for same in (False, True))
    left, right = tied.cameras.values()
    for n in ("fx", "fy"):
        assert left.parameters[n] == pytest.approx(right.parameters[n], rel=1e-13)
        assert left.sigma[n] == pytest.approx(right.sigma[n], rel=1e-6)
        assert abs(left.parameters[n] - scene.cameras["left"].parameters[n]) < 4 * left.sigma[n]
    assert tied.check("same-focal").status == "ok"
    assert tied.options["same_focal"] is True
    # One unknown: the two are as certain together as each.
    joint = tied.joint_covariance
    assert joint is not None
    assert joint.lenses is not None
    assert joint.lenses[0, 9] == pytest.approx(joint.lenses[0, 0], rel=1e-6)
    assert tied.rms_px == pytest.approx(free.rms_px, rel=0.01)
    # By the pixels' noise alone, what the other eye says of it makes it better known.
    fits = [fit_rig(scene.observations, same_focal=same).noise.solution for same in (False, True)]
    by_noise = [np.diag(replace(s, beside=None).covariance("lens of left"))[:2] for s in fits]
    assert np.all(by_noise[1] < by_noise[0])


def test_one_focal_length_with_the_aspect_held() -> None:
    tied = cb.calibrate_stereo(equal_scene(3).observations, same_focal=True, fix=("aspect",))
    left, right = (c.parameters for c in tied.cameras.values())
    assert (left["fx"], left["fy"]) == pytest.approx((right["fx"], right["fy"]), rel=1e-13)


def test_focal_lengths_that_are_not_the_same_are_said(scene: StereoScene) -> None:
    tied, free = (cb.calibrate_stereo(scene.observations, same_focal=same) for same in (True, False))
    check = tied.check("same-focal")
    assert check.status == "warn"
    assert "contradict one focal length" in check.message
    for side, camera in free.cameras.items():
        assert f"{camera.parameters['fx']:.4g}"[:3] in check.message.partition(f"px in {side}")[0][-20:]
    # The option bends the lenses, not what moved or whose clock is late.
    assert not any(c.name.startswith("lens-by") for c in tied.checks)


def test_one_focal_length_needs_both_free() -> None:
    scene = equal_scene(4)
    for given, words in (
        ({"cameras": {"left": scene.cameras["left"]}}, "give neither"),
        ({"fix": {"right": ("focal",)}, "initial": {"right": scene.cameras["right"]}}, "is held"),
        ({"fix": {"right": ("aspect",)}}, "held in one camera alone"),
    ):
        with pytest.raises(InputError, match=words):
            cb.calibrate_stereo(scene.observations, same_focal=True, **given)


def test_the_solver_stops_when_it_is_told() -> None:
    observations = stereo_scene(3).observations
    least, early = (cb.calibrate_stereo(observations, epsilon_px=e) for e in (0.0, 1e-9))
    assert early.options["epsilon_px"] == 1e-9
    assert early.check("termination").status == "ok"
    assert early.figures["baseline"].value == pytest.approx(least.figures["baseline"].value, abs=1e-3)
    coarse = cb.calibrate_stereo(observations, epsilon_px=0.01)
    assert coarse.check("termination").status == "warn"
    with pytest.raises(RefusedError, match="convergence"):
        cb.calibrate_stereo(observations, max_iterations=1)
    with pytest.raises(InputError, match="max_iterations is 1 or more"):
        cb.calibrate_stereo(observations, max_iterations=0)
