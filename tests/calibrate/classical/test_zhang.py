"""Zhang's closed form with several views and with one, and his linear radial terms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.calibrate.classical.classical_views import BOARD, CENTRE, SIZE, SOLID, camera, deviation, pose, seen

from calibrant.calibrate.classical import Degenerate, calibrate_zhang, calibrate_zhang_one_view, zhang_distortion
from calibrant.cameras import Camera
from calibrant.errors import InputError
from calibrant.geometry import se3, so3


def views(n: int, seed: int, lens: Camera, *, noise: float = 0.0) -> tuple[np.ndarray, list[np.ndarray]]:
    T = np.stack([pose(100 * seed + i, tilt=0.3 + 0.1 * i) for i in range(n)])
    return T, [seen(lens, t, BOARD, noise=noise, seed=i) for i, t in enumerate(T)]


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 10_000), skew=st.sampled_from(["zero", "free"]))
def test_exact_views_give_the_truth_to_1e9(seed: int, skew: str) -> None:
    truth = camera()
    T, uv = views(5, seed, truth)
    found = calibrate_zhang([BOARD] * 5, uv, image_size=SIZE, skew=skew)
    assert found.camera.model.name == ("pinhole" if skew == "zero" else "pinhole_skew")
    assert deviation(found.camera, truth, found.T_camera_target, T) < 1e-9


def test_skew_is_found() -> None:
    truth = Camera.create("pinhole_skew", {"fx": 900, "fy": 880, "cx": 630, "cy": 520, "skew": 8.0}, image_size=SIZE)
    T, uv = views(4, 1, truth)
    found = calibrate_zhang([BOARD] * 4, uv, image_size=SIZE, skew="free")
    assert deviation(found.camera, truth, found.T_camera_target, T) < 1e-9


def test_two_views_without_skew_and_one_with_a_known_centre_are_enough() -> None:
    truth = camera()
    T, uv = views(2, 2, truth)
    found = calibrate_zhang([BOARD] * 2, uv, image_size=SIZE)
    assert deviation(found.camera, truth, found.T_camera_target, T) < 1e-9
    one = calibrate_zhang_one_view(BOARD, uv[0], image_size=SIZE, centre=CENTRE)
    assert deviation(one.camera, truth, one.T_camera_target, T[:1]) < 1e-9


def test_a_plane_that_is_not_z_0_keeps_its_frame() -> None:
    truth = camera()
    T, _ = views(3, 3, truth)
    T_plane_world = se3.make(so3.exp([0.3, 0.8, -0.4]), [0.2, -0.1, 0.4])
    points = se3.apply(se3.inverse(T_plane_world), BOARD)
    uv = [seen(truth, t @ T_plane_world, points) for t in T]
    found = calibrate_zhang([points] * 3, uv, image_size=SIZE)
    np.testing.assert_allclose(found.T_camera_target, T @ T_plane_world, atol=1e-9)


@pytest.mark.parametrize(("skew", "least"), [("zero", 2), ("free", 3)])
def test_too_few_views_are_refused(skew: str, least: int) -> None:
    _, uv = views(least - 1, 4, camera())
    with pytest.raises(Degenerate, match=rf"too few views: .*needs {least} views, got {least - 1}"):
        calibrate_zhang([BOARD] * (least - 1), uv, image_size=SIZE, skew=skew)


@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_parallel_planes_are_refused(noise: float) -> None:
    turns = [so3.exp([0, 0, a]) for a in (0.0, 0.5, 1.0, 2.0)]
    tilt = so3.exp([0.5, 0.2, 0])
    T = [se3.make(tilt @ R, [0.02 * i, -0.03, 0.5 + 0.05 * i]) for i, R in enumerate(turns)]
    uv = [seen(camera(), t, BOARD, noise=noise, seed=i) for i, t in enumerate(T)]
    with pytest.raises(Degenerate, match=r"parallel planes: .*different directions|no positive focal length"):
        calibrate_zhang([BOARD] * 4, uv, image_size=SIZE)


def test_one_view_that_faces_the_camera_is_refused() -> None:
    with pytest.raises(Degenerate, match=r"fronto-parallel"):
        calibrate_zhang_one_view(BOARD, seen(camera(), pose(60, tilt=0.0), BOARD), image_size=SIZE, centre=CENTRE)


def test_points_of_a_view_on_a_line_but_one_are_refused() -> None:
    four = BOARD[[0, 1, 2, 30]]
    uv = [seen(camera(), pose(i), four) for i in range(3)]
    with pytest.raises(Degenerate, match=r"collinear points: view 0: .*lie on a line"):
        calibrate_zhang([four] * 3, uv, image_size=SIZE)


def test_planes_that_all_face_the_camera_are_refused() -> None:
    """The columns of B13 and B23 are then rounding alone, which must not count as data."""
    uv = [seen(camera(), pose(i, tilt=0.0), BOARD) for i in range(4)]
    with pytest.raises(Degenerate, match=r"parallel planes"):
        calibrate_zhang([BOARD] * 4, uv, image_size=SIZE)


def test_what_the_method_cannot_use_is_named() -> None:
    truth = camera()
    _, uv = views(3, 5, truth)
    with pytest.raises(Degenerate, match=r"points with depth: .*use the DLT"):
        calibrate_zhang([SOLID] * 3, [seen(truth, pose(i), SOLID) for i in range(3)], image_size=SIZE)
    with pytest.raises(Degenerate, match=r"too few points: a view's homography needs at least 4 points, got 3"):
        calibrate_zhang([BOARD[:3]] * 3, [u[:3] for u in uv], image_size=SIZE)
    with pytest.raises(Degenerate, match=r"collinear points"):
        calibrate_zhang([BOARD[:9]] * 3, [u[:9] for u in uv], image_size=SIZE)
    with pytest.raises(InputError, match=r"points has 3 views and uv has 2"):
        calibrate_zhang([BOARD] * 3, uv[:2], image_size=SIZE)
    with pytest.raises(InputError, match=r"skew is zero or free"):
        calibrate_zhang([BOARD] * 3, uv, image_size=SIZE, skew="some")  # type: ignore[arg-type]


def test_radial_terms_are_exact_once_the_camera_is() -> None:
    truth = Camera.create("brown", {**camera().parameters, "k1": -0.11, "k2": 0.07}, image_size=SIZE)
    T, uv = views(3, 6, truth)
    ideal = calibrate_zhang([BOARD] * 3, [seen(camera(), t, BOARD) for t in T], image_size=SIZE)
    found = zhang_distortion(ideal, [BOARD] * 3, uv)
    assert found.camera.parameters["k1"] == pytest.approx(-0.11, abs=1e-9)
    assert found.camera.parameters["k2"] == pytest.approx(0.07, abs=1e-9)
    free = calibrate_zhang([BOARD] * 3, uv, image_size=SIZE, skew="free")
    with pytest.raises(InputError, match=r"pinhole camera without skew"):
        zhang_distortion(free, [BOARD] * 3, uv)


def test_radial_terms_lower_the_error_of_a_camera_found_without_them() -> None:
    truth = camera("brown")
    _, uv = views(5, 7, truth, noise=0.1)
    plain = calibrate_zhang([BOARD] * 5, uv, image_size=SIZE)
    bent = zhang_distortion(plain, [BOARD] * 5, uv)
    before, after = (
        np.mean([np.sum((f.camera.project(se3.apply(T, BOARD)) - u) ** 2) for T, u in zip(f.T_camera_target, uv)])
        for f in (plain, bent)
    )
    assert after < 0.9 * before
