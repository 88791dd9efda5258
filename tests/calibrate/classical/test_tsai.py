"""Tsai's method in both forms: exact points give the truth, special rotations too, and each failure its name."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.calibrate.classical.classical_views import (
    ASPECT,
    BOARD,
    CENTRE,
    LENSES,
    SIZE,
    SOLID,
    camera,
    deviation,
    pose,
    seen,
)

from calibrant.calibrate.classical import (
    Degenerate,
    calibrate_fast_rac,
    calibrate_tsai,
    calibrate_tsai_coplanar,
    slide_k,
)
from calibrant.errors import InputError
from calibrant.geometry import se3, so3

KNOWN = {"image_size": SIZE, "centre": CENTRE}
SCALES = ["t_y", "t_x", "norm"]


@settings(max_examples=100, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    radial=st.sampled_from(sorted(LENSES)),
    scale=st.sampled_from(SCALES),
    tilt=st.floats(0.1, 1.0),
)
def test_exact_coplanar_points_give_the_truth_to_1e9(seed: int, radial: str, scale: str, tilt: float) -> None:
    truth, T = camera(radial), pose(seed, tilt=tilt)
    found = calibrate_tsai_coplanar(BOARD, seen(truth, T, BOARD), aspect=ASPECT, radial=radial, scale=scale, **KNOWN)
    assert deviation(found.camera, truth, found.T_camera_target[0], T) < 1e-9


@settings(max_examples=100, deadline=None)
@given(seed=st.integers(0, 10_000), radial=st.sampled_from(sorted(LENSES)), scale=st.sampled_from(SCALES))
def test_exact_points_with_depth_give_the_truth_and_the_aspect_to_1e9(seed: int, radial: str, scale: str) -> None:
    truth, T = camera(radial), pose(seed, tilt=seed / 10_000)
    found = calibrate_tsai(SOLID, seen(truth, T, SOLID), radial=radial, scale=scale, **KNOWN)
    assert deviation(found.camera, truth, found.T_camera_target[0], T) < 1e-9


@pytest.mark.parametrize("t_y", [0.07, -0.07])
@pytest.mark.parametrize("t_x", [0.05, -0.05])
def test_the_sign_of_t_y_is_found(t_x: float, t_y: float) -> None:
    truth, T = camera("division"), pose(30)
    T[:2, 3] = t_x, t_y
    flat = calibrate_tsai_coplanar(BOARD, seen(truth, T, BOARD), aspect=ASPECT, **KNOWN)
    solid = calibrate_tsai(SOLID, seen(truth, T, SOLID), **KNOWN)
    for found in (flat, solid):
        np.testing.assert_allclose(found.T_camera_target[0], T, atol=1e-9)


ALONG_THE_FLOOR = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])  # x_w ahead, y_w left, z_w up: r1 = r4 = r5 = 0
SPECIAL = {
    "zero row and column": ALONG_THE_FLOOR,
    "zero column": ALONG_THE_FLOOR @ so3.exp([0.0, 0, 0]) @ so3.exp([0.7, 0, 0]),
    "zero row": so3.exp([np.pi / 2, 0, 0]) @ so3.exp([0, 0, 0.6]),
    "r3 = 0": so3.exp([0.6, 0, 0]),
    "r6 = 0": so3.exp([0, -0.6, 0]),
    "r2 = r4 = 0 and diagonal": so3.exp([0, 0.9, 0]),
    "from behind": so3.exp([np.pi, 0, 0]) @ so3.exp([0.5, 0.3, 0]),
    "upside down": so3.exp([0, 0, np.pi]) @ so3.exp([0.4, 0.5, 0]),
}


@pytest.mark.parametrize("name", SPECIAL)
@pytest.mark.parametrize("scale", SCALES)
def test_rotations_with_zeros_give_the_truth(name: str, scale: str) -> None:
    """Slide 57's other case, and each element of slide 60 that may vanish."""
    R = SPECIAL[name]
    truth, T = camera("division"), se3.make(R, [0.13, 0.21, 0.9])
    found = calibrate_tsai_coplanar(BOARD, seen(truth, T, BOARD), aspect=ASPECT, scale=scale, **KNOWN)
    assert deviation(found.camera, truth, found.T_camera_target[0], T) < 1e-9


def test_the_special_rotations_are_what_they_say() -> None:
    block = SPECIAL["zero column"][:2, :2]
    assert np.abs(block[:, 0]).max() < 1e-15
    assert np.abs(SPECIAL["zero row"][1, :2]).max() < 1e-15
    assert np.abs(SPECIAL["zero row and column"][:2, :2]).sum() == 1


def test_a_plane_that_is_not_z_0_keeps_its_frame() -> None:
    truth, T = camera("division"), pose(31)
    T_plane_world = se3.make(so3.exp([0.3, 0.8, -0.4]), [0.2, -0.1, 0.4])
    points = se3.apply(se3.inverse(T_plane_world), BOARD)
    found = calibrate_tsai_coplanar(points, seen(truth, T @ T_plane_world, points), aspect=ASPECT, **KNOWN)
    np.testing.assert_allclose(found.T_camera_target[0], T @ T_plane_world, atol=1e-9)


@pytest.mark.parametrize("noise", [0.0, 0.2])
@pytest.mark.parametrize("points", [BOARD, SOLID], ids=["plane", "depth"])
def test_t_y_of_zero_is_refused_with_its_cures_and_they_work(points: np.ndarray, noise: float) -> None:
    truth, T = camera("division"), pose(32)
    T[1, 3] = 0.0
    uv = seen(truth, T, points, noise=noise)
    calibrate: Callable = calibrate_tsai_coplanar if points is BOARD else calibrate_tsai
    known = {**KNOWN, "aspect": ASPECT} if points is BOARD else KNOWN
    with pytest.raises(Degenerate, match=r"t_y = 0: .*divide by t_x .slide 56.*norm") as refused:
        calibrate(points, uv, **known)
    assert refused.value.name == "t_y = 0"
    for scale in ("t_x", "norm"):
        found = calibrate(points, uv, scale=scale, **known)
        tolerance = 1e-9 if noise == 0 else 0.05
        np.testing.assert_allclose(found.T_camera_target[0], T, atol=tolerance)


@pytest.mark.parametrize("points", [BOARD, SOLID], ids=["plane", "depth"])
def test_an_origin_on_the_axis_is_refused_unless_nothing_is_divided_by(points: np.ndarray) -> None:
    truth, T = camera("division"), pose(33)
    T[:2, 3] = 0.0
    uv = seen(truth, T, points)
    calibrate: Callable = calibrate_tsai_coplanar if points is BOARD else calibrate_tsai
    known = {**KNOWN, "aspect": ASPECT} if points is BOARD else KNOWN
    with pytest.raises(Degenerate, match=r"t_y = 0: .*t_x is 0 too: move the camera or the target"):
        calibrate(points, uv, **known)
    with pytest.raises(Degenerate, match=r"t_x = 0"):
        calibrate(points, uv, scale="t_x", **known)
    np.testing.assert_allclose(calibrate(points, uv, scale="norm", **known).T_camera_target[0], T, atol=1e-9)


@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_a_plane_that_faces_the_camera_is_refused(noise: float) -> None:
    uv = seen(camera("division"), pose(34, tilt=0.0), BOARD, noise=noise)
    with pytest.raises(Degenerate, match=r"fronto-parallel: a tilt of .*faces the camera.*Tilt the target") as refused:
        calibrate_tsai_coplanar(BOARD, uv, aspect=ASPECT, **KNOWN)
    assert refused.value.name == "fronto-parallel"


def test_points_with_depth_may_face_the_camera() -> None:
    truth, T = camera("division"), pose(34, tilt=0.0)
    found = calibrate_tsai(SOLID, seen(truth, T, SOLID), **KNOWN)
    np.testing.assert_allclose(found.T_camera_target[0], T, atol=1e-9)


def test_few_collinear_and_misplaced_points_are_refused() -> None:
    truth, T = camera(), pose(35)
    flat, solid = seen(truth, T, BOARD), seen(truth, T, SOLID)
    with pytest.raises(Degenerate, match=r"too few points: .*at least 5 points, got 4"):
        calibrate_tsai_coplanar(BOARD[[0, 8, 20, 62]], flat[[0, 8, 20, 62]], aspect=ASPECT, **KNOWN)
    with pytest.raises(Degenerate, match=r"too few points: .*at least 7 points, got 6"):
        calibrate_tsai(SOLID[:6], solid[:6], **KNOWN)
    with pytest.raises(Degenerate, match=r"collinear points"):
        calibrate_tsai_coplanar(BOARD[:9], flat[:9], aspect=ASPECT, **KNOWN)
    with pytest.raises(Degenerate, match=r"coplanar points: .*use the form for coplanar points"):
        calibrate_tsai(BOARD, flat, **KNOWN)
    with pytest.raises(Degenerate, match=r"points with depth: .*one plane"):
        calibrate_tsai_coplanar(SOLID, solid, aspect=ASPECT, **KNOWN)


def test_the_fewest_points_are_enough() -> None:
    truth, T = camera("division"), pose(36)
    five = BOARD[[0, 8, 22, 30, 62]]
    found = calibrate_tsai_coplanar(five, seen(truth, T, five), aspect=ASPECT, **KNOWN)
    assert deviation(found.camera, truth, found.T_camera_target[0], T) < 1e-9
    seven = SOLID[:7]
    found = calibrate_tsai(seven, seen(truth, T, seven), **KNOWN)
    assert deviation(found.camera, truth, found.T_camera_target[0], T) < 1e-9


def test_a_mirrored_picture_of_a_solid_is_refused() -> None:
    uv = seen(camera(), pose(37), SOLID)
    with pytest.raises(Degenerate, match=r"no positive focal length|points behind the camera"):
        calibrate_tsai(SOLID, 2 * CENTRE * [1, 0] + uv * [-1, 1], **KNOWN)


def test_unusable_arguments_are_named() -> None:
    uv = seen(camera(), pose(38), BOARD)
    with pytest.raises(InputError, match=r"the principal point \(1500, 520\) px lies outside the image of 1280 x 1024"):
        calibrate_tsai_coplanar(BOARD, uv, image_size=SIZE, centre=(1500, 520))
    with pytest.raises(InputError, match=r"principal point is two numbers"):
        calibrate_tsai_coplanar(BOARD, uv, image_size=SIZE, centre=(1, 2, 3))
    with pytest.raises(InputError, match=r"aspect is f_y / f_x"):
        calibrate_tsai_coplanar(BOARD, uv, image_size=SIZE, aspect=-1.0)
    with pytest.raises(InputError, match=r"radial is one of division"):
        calibrate_tsai_coplanar(BOARD, uv, image_size=SIZE, radial="fisheye")  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"scale is one of t_y, t_x, norm"):
        calibrate_tsai_coplanar(BOARD, uv, image_size=SIZE, scale="t_z")  # type: ignore[arg-type]


@pytest.mark.parametrize(("radial", "sign"), [("division", 1), ("inverse_brown", -1)])
def test_the_two_variants_of_the_slides_differ_in_sign_and_second_order(radial: str, sign: int) -> None:
    """Slide 49's k is minus slide 50's to first order, and each reproduces its own slide's equation."""
    truth, T = camera(radial), pose(39)
    k = slide_k(truth)
    uv = seen(truth, T, BOARD)
    X, Y = (uv - CENTRE).T
    p = se3.apply(T, BOARD)
    r2 = ASPECT**2 * X**2 + Y**2
    ideal = truth.parameters["fx"] * p[:, 0] / p[:, 2]
    np.testing.assert_allclose(X / (1 + k * r2) if radial == "division" else X * (1 + k * r2), ideal, atol=1e-9)
    weak = 0.05
    lens = truth.create("division", {**camera().parameters, "l1": weak * LENSES["division"]["l1"]}, image_size=SIZE)
    fitted = calibrate_tsai_coplanar(BOARD, seen(lens, T, BOARD), aspect=ASPECT, radial=radial, **KNOWN)
    assert slide_k(fitted.camera) == pytest.approx(sign * slide_k(lens), rel=0.02)


@pytest.mark.statistics
def test_noise_moves_the_focal_length_in_proportion_and_to_no_side() -> None:
    truth, T = camera("division"), pose(40)

    def errors(noise: float) -> np.ndarray:
        runs = (seen(truth, T, BOARD, noise=noise, seed=s) for s in range(80))
        found = (calibrate_tsai_coplanar(BOARD, uv, aspect=ASPECT, scale="norm", **KNOWN) for uv in runs)
        return np.array([f.camera.parameters["fx"] - 900 for f in found])

    small, large = errors(0.05), errors(0.2)
    # 80 trials know a standard deviation to 8 %, so a ratio to 11 %: 3 sigma.
    assert 4 / 1.35 < np.std(large) / np.std(small) < 4 * 1.35
    assert abs(np.mean(small)) < 4 * np.std(small) / np.sqrt(80)


def test_what_was_not_given_is_said() -> None:
    points, uv = BOARD, seen(camera(), pose(3), BOARD)
    silent = calibrate_tsai_coplanar(points, uv, image_size=SIZE)
    assert [text.partition(":")[0] for text in silent.assumed] == ["centre", "aspect"]
    assert "(639.5, 511.5) px" in silent.assumed[0]
    said = calibrate_tsai_coplanar(points, uv, image_size=SIZE, centre=(639.5, 511.5), aspect=1.0)
    assert said.assumed == ()
    assert said.camera.parameters == silent.camera.parameters
    rac = calibrate_fast_rac(points, uv, image_size=SIZE, aspect=ASPECT)
    assert [text.partition(":")[0] for text in rac.assumed] == ["centre"]
    deep = calibrate_tsai(SOLID, seen(camera(), pose(3), SOLID), image_size=SIZE)
    assert [text.partition(":")[0] for text in deep.assumed] == ["centre"]
