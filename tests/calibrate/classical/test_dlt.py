"""Direct linear transform: exact points give the truth, noise its share, and each failure its name."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.calibrate.classical.classical_views import BOARD, SIZE, SOLID, camera, deviation, pose, seen

from calibrant.calibrate.classical import Degenerate, calibrate_dlt, decompose, dlt
from calibrant.cameras import Camera
from calibrant.errors import InputError
from calibrant.geometry import se3, so3

SKEWED = Camera.create("pinhole_skew", {"fx": 900, "fy": 880, "cx": 630, "cy": 520, "skew": 3.0}, image_size=SIZE)


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    fx=st.floats(300, 4000),
    ratio=st.floats(0.5, 2.0),
    skew=st.floats(-20, 20),
    unit=st.sampled_from([0.01, 1.0, 100.0]),
)
def test_exact_points_give_the_camera_to_1e9(seed: int, fx: float, ratio: float, skew: float, unit: float) -> None:
    truth = Camera.create(
        "pinhole_skew", {"fx": fx, "fy": fx * ratio, "cx": 630, "cy": 520, "skew": skew}, image_size=SIZE
    )
    points = np.random.default_rng(seed).uniform(-0.1, 0.1, (12, 3)) * unit
    T = pose(seed)
    T[:3, 3] *= unit
    found = calibrate_dlt(points, seen(truth, T, points), image_size=SIZE)
    T_found = found.T_camera_target[0]
    T_found = se3.make(T_found[:3, :3], T_found[:3, 3] / unit)
    assert deviation(found.camera, truth, T_found, se3.make(T[:3, :3], T[:3, 3] / unit)) < 1e-9


def test_the_slides_coefficients_reproduce_the_pixels() -> None:
    T = pose(1)
    uv = seen(SKEWED, T, SOLID)
    P = dlt(SOLID, uv)
    a = P / P[2, 3]  # slide 33: a34 = 1
    homogeneous = np.column_stack([SOLID, np.ones(len(SOLID))]) @ a.T
    np.testing.assert_allclose(homogeneous[:, :2] / homogeneous[:, 2:], uv, atol=1e-9)
    assert P[2, 3] == pytest.approx(T[2, 3], rel=1e-9)  # t_z, by the scale of the third row


def test_six_points_are_enough_and_five_are_not() -> None:
    T = pose(2)
    uv = seen(SKEWED, T, SOLID[:6])
    found = calibrate_dlt(SOLID[:6], uv, image_size=SIZE)
    assert deviation(found.camera, SKEWED, found.T_camera_target[0], T) < 1e-9
    with pytest.raises(Degenerate, match=r"too few points: .* at least 6 points, got 5") as refused:
        dlt(SOLID[:5], uv[:5])
    assert refused.value.exit_status == 1


def test_an_origin_in_the_plane_of_the_lens_is_no_obstacle() -> None:
    """a34 = t_z = 0 there, which the slide's a34 = 1 excludes."""
    T = se3.make(so3.exp([0.2, 0.1, 0.3]), [0.3, 0.2, 0.0])
    points = se3.apply(se3.inverse(T), np.random.default_rng(3).uniform([-0.2, -0.2, 0.5], [0.2, 0.2, 0.9], (20, 3)))
    found = calibrate_dlt(points, seen(SKEWED, T, points), image_size=SIZE)
    assert deviation(found.camera, SKEWED, found.T_camera_target[0], T) < 1e-9


@pytest.mark.parametrize("turn", [np.zeros(3), np.array([0.4, -0.8, 0.3])], ids=["z = 0", "any plane"])
@pytest.mark.parametrize("noise", [0.0, 0.5])
def test_coplanar_points_are_refused_and_zhang_and_tsai_named(turn: np.ndarray, noise: float) -> None:
    points = BOARD @ so3.exp(turn).T + [0.1, 0.2, 0.05]
    uv = seen(camera(), pose(4) @ se3.inverse(se3.make(so3.exp(turn), [0.1, 0.2, 0.05])), points, noise=noise)
    with pytest.raises(Degenerate, match=r"coplanar points: .*Zhang's method with several views, or Tsai's") as refused:
        dlt(points, uv)
    assert refused.value.name == "coplanar points"


def test_collinear_points_are_refused() -> None:
    points = np.linspace(-0.1, 0.1, 12)[:, None] * np.array([1.0, 0.5, 0.3])
    with pytest.raises(Degenerate, match=r"collinear points"):
        dlt(points, seen(camera(), pose(5), points))


def test_points_too_flat_for_their_noise_are_refused() -> None:
    points = BOARD + np.random.default_rng(6).uniform(-1, 1, BOARD.shape) * [0, 0, 2e-5]
    uv = seen(camera(), pose(6), points, noise=0.5)
    with pytest.raises(Degenerate, match=r"undetermined: .*nearly in a plane"):
        dlt(points, uv)


def test_a_mirrored_picture_is_refused() -> None:
    uv = seen(camera(), pose(7), SOLID)
    with pytest.raises(Degenerate, match=r"mirrored points: .*--mirror-x"):
        calibrate_dlt(SOLID, np.array([SIZE[0] - 1, 0]) + uv * [-1, 1], image_size=SIZE)


def test_a_parallel_projection_is_refused() -> None:
    with pytest.raises(Degenerate, match=r"no positive focal length: .*telecentric"):
        dlt(SOLID, SOLID[:, :2] * 3000 + 600)


def test_shuffled_pixels_are_refused() -> None:
    uv = seen(camera(), pose(8), SOLID)
    with pytest.raises(Degenerate, match=r"points behind the camera: .*same order"):
        dlt(SOLID, np.random.default_rng(10).permutation(uv))


def test_unusable_input_is_named() -> None:
    uv = seen(camera(), pose(8), SOLID)
    with pytest.raises(InputError, match=r"points \(n, 3\) in metres .* got shapes \(24, 2\)"):
        dlt(SOLID[:, :2], uv)
    lost = uv.copy()
    lost[3] = np.nan
    with pytest.raises(InputError, match=r"pixel 3 is .*not finite"):
        dlt(SOLID, lost)
    far = SOLID.copy()
    far[5, 2] = np.inf
    with pytest.raises(InputError, match=r"point 5 is .*not finite"):
        dlt(far, uv)
    with pytest.raises(InputError, match=r"image_size"):
        calibrate_dlt(SOLID, uv, image_size=(0, 100))


def test_decomposition_agrees_with_opencv() -> None:
    P = dlt(SOLID, seen(SKEWED, pose(9), SOLID))
    K, T = decompose(-3.7 * P if np.linalg.det(P[:, :3]) < 0 else 3.7 * P)
    K_cv, R_cv, centre = cv2.decomposeProjectionMatrix(P)[:3]
    np.testing.assert_allclose(K, K_cv / K_cv[2, 2], atol=1e-9 * 900)
    np.testing.assert_allclose(T[:3, :3], R_cv, atol=1e-12)
    np.testing.assert_allclose(-T[:3, :3].T @ T[:3, 3], (centre[:3] / centre[3]).ravel(), atol=1e-12)


@pytest.mark.statistics
def test_noise_moves_the_focal_length_in_proportion_and_to_no_side() -> None:
    truth, T = camera(), pose(10)
    points = np.random.default_rng(11).uniform(-0.1, 0.1, (60, 3))

    def errors(noise: float) -> np.ndarray:
        found = (calibrate_dlt(points, seen(truth, T, points, noise=noise, seed=s), image_size=SIZE) for s in range(80))
        return np.array([f.camera.parameters["fx"] - 900 for f in found])

    small, large = errors(0.1), errors(0.4)
    # 80 trials know a standard deviation to 8 %, so a ratio to 11 %: 3 sigma.
    assert 4 / 1.35 < np.std(large) / np.std(small) < 4 * 1.35
    assert abs(np.mean(small)) < 4 * np.std(small) / np.sqrt(80)
