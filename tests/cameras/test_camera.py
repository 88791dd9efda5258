from __future__ import annotations

import numpy as np
import pytest

from calibrant.cameras import Camera, camera_model
from calibrant.errors import InputError

PIXELS = {"fx": 900.0, "fy": 905.0, "cx": 645.0, "cy": 507.0}
SIZE = (1280, 1024)


def test_terms_left_out_are_zero_and_K_is_opencvs() -> None:
    camera = Camera.create("brown", {**PIXELS, "k1": -0.1}, image_size=SIZE)
    assert camera.parameters == {**PIXELS, "k1": -0.1, "k2": 0.0, "p1": 0.0, "p2": 0.0, "k3": 0.0}
    np.testing.assert_array_equal(camera.K, [[900, 0, 645], [0, 905, 507], [0, 0, 1]])


def test_sigma_is_the_root_of_the_variances() -> None:
    covariance = np.diag([4.0, 9.0, 0.25, 0.0])
    camera = Camera.create("pinhole", PIXELS, image_size=SIZE, covariance=covariance)
    assert camera.sigma == {"fx": 2.0, "fy": 3.0, "cx": 0.5, "cy": 0.0}
    assert Camera.create("pinhole", PIXELS, image_size=SIZE).sigma == {}


def test_a_camera_cannot_be_changed() -> None:
    values = np.array(list(PIXELS.values()))
    camera = Camera(camera_model("pinhole"), SIZE, values)
    values[0] = 1.0
    assert camera.parameters["fx"] == 900.0
    with pytest.raises(ValueError, match="read-only"):
        camera.values[0] = 1.0


@pytest.mark.parametrize(
    ("model", "parameters", "size", "message"),
    [
        ("brwn", PIXELS, SIZE, "unknown camera model 'brwn'; known models: .*brown"),
        ("brown", {**PIXELS, "k9": 1.0}, SIZE, "no parameter 'k9'; it has fx, fy"),
        ("brown", {"fx": 900.0, "cy": 1.0}, SIZE, "missing: fy, cx"),
        ("pinhole", {**PIXELS, "fx": float("nan")}, SIZE, "4 finite parameters"),
        ("pinhole", {**PIXELS, "fy": -905.0}, SIZE, "fy is -905 px; a focal length is above 0"),
        ("pinhole", PIXELS, (0, 1024), r"image_size is \(width, height\)"),
    ],
    ids=["model", "parameter", "missing", "nan", "negative", "size"],
)
def test_unusable_cameras_are_refused(
    model: str, parameters: dict[str, float], size: tuple[int, int], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        Camera.create(model, parameters, image_size=size)


def test_a_covariance_of_the_wrong_size_is_refused() -> None:
    with pytest.raises(InputError, match=r"\(4, 4\), got \(3, 3\)"):
        Camera.create("pinhole", PIXELS, image_size=SIZE, covariance=np.eye(3))


def test_points_and_pixels_of_a_wrong_shape_are_named() -> None:
    camera = Camera.create("pinhole", PIXELS, image_size=SIZE)
    with pytest.raises(InputError, match=r"points are rows of x, y, z: expected .* \(\.\.\., 3\), got \(5, 2\)"):
        camera.project(np.zeros((5, 2)))
    with pytest.raises(InputError, match=r"pixels are rows of u, v: expected .* \(\.\.\., 2\), got \(\)"):
        camera.unproject(1.0)
