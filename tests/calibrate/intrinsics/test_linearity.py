"""Terms that bend over their intervals, and second cameras that fit as well: found, said, and the better one taken."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.calibrate.intrinsics.calibrate import calibrate_intrinsics
from calibrant.cameras import Camera, camera_model
from calibrant.data import CalibrationResult, Check
from calibrant.simulate.scenes import IMAGE_SIZE, grid, look_at_board, observe

BOARD = grid(11, 8, 0.03)


def calibrated(camera: Camera, seed: int = 7, **options: object) -> CalibrationResult:
    rng = np.random.default_rng(seed)
    T = look_at_board(camera, BOARD, 20, rng=rng, distance=(0.15, 0.45), tilt_deg=45)
    return calibrate_intrinsics(observe(camera, BOARD, T, sigma_px=0.1, rng=rng), model=camera.model.name, **options)  # type: ignore[arg-type]


def lens(model: str, *terms: float) -> Camera:
    return Camera(camera_model(model), IMAGE_SIZE, np.array([520.0, 523.0, 645.0, 507.0, *terms]))


def check(result: CalibrationResult, name: str) -> Check | None:
    return next((c for c in result.checks if c.name == name), None)


@pytest.mark.parametrize(
    "camera",
    [lens("brown", -0.02, 0.03, 1e-3, -1e-3, 0.01), lens("kannala_brandt", -0.02, 0.02, -0.02, 0.03)],
    ids=["brown", "kannala_brandt"],
)
def test_determined_terms_act_in_proportion(camera: Camera) -> None:
    linear = check(calibrated(camera), "linearity")
    assert linear is not None
    assert linear.status == "ok"
    # sigma of the terms is a few percent of what they do; the square of that is below a tenth of the noise.
    assert linear.value is not None
    assert linear.value < 0.1


def test_terms_that_cancel_are_named() -> None:
    """Numerator and denominator alike: k1 - k4 is determined, k1 and k4 are not."""
    result = calibrated(lens("rational", -0.02, 0.025, 1e-3, -1e-3, -0.02, -0.03, 0.03, -0.02))
    linear = check(result, "linearity")
    assert linear is not None
    assert linear.status == "warn"
    assert "k1" in linear.message
    assert "k4" in linear.message
    assert "cx" not in linear.message
    assert result.verdict == "warn"


def test_two_shapes_of_one_field_are_said_whichever_was_found() -> None:
    """xi = 0.2 and xi = -0.13 with other alpha have the same rays within 50 degrees to 0.002 px."""
    camera = lens("double_sphere", 0.2, 0.55)
    for options in ({}, {"initial": camera}):
        second = check(calibrated(camera, **options), "second-camera")
        assert second is not None
        assert second.status == "warn"
        assert second.value is not None
        assert abs(second.value) < 3.841


def test_the_better_of_two_shapes_is_taken() -> None:
    """The start finds the wrong side; on a board nearer by, the true one is far more likely."""
    camera, rng = lens("double_sphere", 0.2, 0.55), np.random.default_rng(3)
    T = look_at_board(camera, BOARD, 60, rng=rng, distance=(0.12, 0.25), tilt_deg=45)
    found = calibrate_intrinsics(observe(camera, BOARD, T, sigma_px=0.01, rng=rng), model="double_sphere")
    error = (found.camera.values - camera.values) / np.array(list(found.camera.sigma.values()))
    assert np.abs(error).max() < 5
    assert check(found, "second-camera") is None


def test_a_telecentric_camera_starts_from_a_given_one() -> None:
    camera = Camera(camera_model("orthographic"), IMAGE_SIZE, np.array([3000.0, 3010.0, 639.5, 511.5]))
    rng = np.random.default_rng(4)
    from calibrant.geometry import se3, so3

    lean = so3.exp(rng.uniform(-0.7, 0.7, (12, 3)))
    middle = 0.5 * (BOARD.min(axis=0) + BOARD.max(axis=0))
    T = se3.make(lean, np.array([0.0, 0.0, 0.5]) - lean @ middle)
    found = calibrate_intrinsics(
        observe(camera, BOARD, T, sigma_px=0.05, rng=rng), model="orthographic", initial=camera
    ).camera
    error = (found.values - camera.values)[:2] / np.array([found.sigma["fx"], found.sigma["fy"]])
    assert np.abs(error).max() < 5
