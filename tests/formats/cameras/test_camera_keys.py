"""What programs call a lens and its terms: each is used, or refused by its name; nothing is dropped in silence."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calibrant.cameras import Camera
from calibrant.errors import InputError
from calibrant.formats.cameras.read import read_camera
from calibrant.formats.exchange.read import read_any
from calibrant.reading.notes import heard

FOCAL = {"width": 1280, "height": 800, "fx": 640.25, "fy": 639.81, "cx": 643.17, "cy": 402.88}
FIVE = [-0.3561, 0.1672, -0.00021, 0.00055, -0.0215]
FISHEYE = [-0.02, 0.01, -0.003, 0.0004]
P = [0.8, 0.5, 1.0]
BROWN_PIXEL = (1053.7675, 659.0118)
"""By OpenCV's equations, and by cv2.projectPoints."""


def camera_of(folder: Path, data: Mapping[str, Any], **options: tuple[int, int]) -> Camera:
    path = folder / "camera.json"
    path.write_text(json.dumps(data))
    return read_camera(path, **options)


def pixel(camera: Camera) -> tuple[float, float]:
    u, v = camera.project(P)
    return float(u), float(v)


@pytest.mark.parametrize(
    "key",
    [
        *(
            "coeffs",
            "dist",
            "disto",
            "distortion",
            "D",
            "distortion_coefficients",
            "dist_coeffs",
            "distCoeffs",
            "coefs",
        ),
        *("kc", "distortion_coeffs", "Distortion Coefficients", "distortionParameters", "cam_dist", "dist_params"),
    ],
)
def test_terms_are_read_by_any_of_their_names(tmp_path: Path, key: str) -> None:
    np.testing.assert_allclose(pixel(camera_of(tmp_path, {**FOCAL, key: FIVE})), BROWN_PIXEL, atol=1e-3)
    matrix = {"K": [[640.25, 0, 643.17], [0, 639.81, 402.88], [0, 0, 1]], "image_size": [1280, 800]}
    np.testing.assert_allclose(pixel(camera_of(tmp_path, {**matrix, key: [FIVE]})), BROWN_PIXEL, atol=1e-3)
    by_name = dict(zip(("k1", "k2", "p1", "p2", "k3"), FIVE))
    nested = {"intrinsics": {"fx": 640.25, "fy": 639.81, "ppx": 643.17, "ppy": 402.88}, "distortion": by_name}
    camera = camera_of(tmp_path, {**nested, "resolution": {"width": 1280, "height": 800}})
    np.testing.assert_allclose(pixel(camera), BROWN_PIXEL, atol=1e-3)


@pytest.mark.parametrize("key", ["model", "camera_model", "distortion_model", "camera_type", "lens_model"])
def test_a_model_is_read_by_any_of_its_names(tmp_path: Path, key: str) -> None:
    theta = np.arctan2(np.hypot(*P[:2]), P[2])
    scale = theta * (1 + sum(k * theta ** (2 * i) for i, k in enumerate(FISHEYE, 1))) / np.hypot(*P[:2])
    expected = (640.25 * scale * P[0] + 643.17, 639.81 * scale * P[1] + 402.88)
    for word in ("fisheye", "equidistant", "Kannala-Brandt", "KB4", "OPENCV_FISHEYE"):
        for terms in ({"coeffs": FISHEYE}, dict(zip(("k1", "k2", "k3", "k4"), FISHEYE))):
            np.testing.assert_allclose(pixel(camera_of(tmp_path, {**FOCAL, key: word, **terms})), expected, atol=1e-9)
    both = camera_of(tmp_path, {**FOCAL, "xi": -0.2, "alpha": 0.6, key: "ds"})
    assert both.model.name == "double_sphere"
    back = camera_of(tmp_path, {**FOCAL, "coeffs": FIVE, key: "distortion.inverse_brown_conrady"})
    assert (back.model.name, back.parameters["k3"]) == ("inverse_brown", -0.0215)
    assert camera_of(tmp_path, {**FOCAL, "xi": 1.2, "D": FIVE[:4], key: "mei"}).model.name == "unified"
    plain = camera_of(tmp_path, {**FOCAL, "coeffs": FIVE, key: "Brown Conrady"})
    np.testing.assert_allclose(pixel(plain), BROWN_PIXEL, atol=1e-3)
    for word in ("fov", "ftheta", "Basler acA1300"):
        with pytest.raises(InputError, match=f"{key} is .*, expected one of plumb_bob.*remove the key"):
            camera_of(tmp_path, {**FOCAL, "coeffs": FIVE, key: word})


def test_kalibr_and_matlab_and_nerf(tmp_path: Path) -> None:
    chain = {
        "cam0": {
            "camera_model": "omni",
            "intrinsics": [1.5, 640.25, 639.81, 643.17, 402.88],
            "distortion_model": "radtan",
            "distortion_coeffs": FIVE[:4],
            "resolution": [1280, 800],
        }
    }
    camera = camera_of(tmp_path, chain)
    assert (camera.model.name, camera.parameters["xi"], camera.image_size) == ("unified", 1.5, (1280, 800))
    with pytest.raises(InputError, match="it holds 2 cameras, cam0, cam1; say which"):
        camera_of(tmp_path, {**chain, "cam1": chain["cam0"]})
    matlab = {
        "FocalLength": [640.25, 639.81],
        "PrincipalPoint": [643.17, 402.88],
        "ImageSize": [800, 1280],
        "RadialDistortion": [FIVE[0], FIVE[1], FIVE[4]],
        "TangentialDistortion": FIVE[2:4],
    }
    np.testing.assert_allclose(pixel(camera_of(tmp_path, matlab)), BROWN_PIXEL, atol=1e-3)
    nerf = {"fl_x": 640.25, "fl_y": 639.81, "cx": 643.17, "cy": 402.88, "w": 1280, "h": 800}
    terms = dict(zip(("k1", "k2", "p1", "p2", "k3"), FIVE))
    np.testing.assert_allclose(pixel(camera_of(tmp_path, {**nerf, **terms})), BROWN_PIXEL, atol=1e-3)


@pytest.mark.parametrize(
    ("extra", "message"),
    [
        ({"lens_terms": FIVE}, r"'lens_terms' \(-0.3561, .*could say how the lens bends"),
        ({"calibration": {"distortion_rational": FIVE}}, r"'calibration\.distortion_rational'"),
        ({"xi": 0.1, "alpha": 0.5}, "'alpha' .*could say how the lens bends"),
        ({"k1": 0.1, "k2": 0.1, "k3": 0.1, "k4": 0.1}, "k1 to k4 alone can be a fisheye's"),
        ({"model": "ds"}, "double_sphere needs xi and alpha"),
        ({"model": "none", "D": FIVE}, "the model is none, and there are distortion coefficients"),
        ({"coeffs": FIVE, "dist": FIVE[:4]}, "distortion coefficients that differ"),
        ({"coeffs": FIVE, "k1": 0.5}, "k1 is 0.5 by name"),
        ({"K": [[600.0, 0, 640], [0, 600, 400], [0, 0, 1]]}, "two camera matrices that differ"),
        ({"image_size": [640, 480]}, "two image sizes, 1280x800 and 640x480"),
        ({"coeffs": FIVE, "model": "fisheye", "camera_model": "ds"}, "two models are named"),
    ],
)
def test_what_could_bend_the_picture_is_never_dropped(tmp_path: Path, extra: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        camera_of(tmp_path, {**FOCAL, **extra})
    assert "camera.json" in str(caught.value)


def test_other_keys_are_said(tmp_path: Path) -> None:
    more = {"serial": "42", "poses": [[1, 2, 3]], "binning_x": 2, "binning_y": 0, "T_cam_imu": [1.0], "tx": 1, "tz": 2}
    with heard() as notes:
        camera_of(tmp_path, {**FOCAL, "coeffs": FIVE, **more})
    assert notes == [f"{tmp_path / 'camera.json'}: not used: poses, binning_x, T_cam_imu, tx, tz"]
    with pytest.warns(UserWarning, match="not used: poses"):
        camera_of(tmp_path, {**FOCAL, "poses": [1]})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        camera_of(tmp_path, {**FOCAL, "roi": {"x_offset": 0, "do_rectify": False}, "serial": "42"})


def test_messages_as_ros2_prints_them(tmp_path: Path) -> None:
    message = (
        "header:\n  stamp: {sec: %d, nanosec: 5}\nheight: 800\nwidth: 1280\ndistortion_model: plumb_bob\n"
        "d: [0.1, 0.0, 0.0, 0.0, 0.0]\nk: [600.0, 0.0, 640.0, 0.0, 600.0, 400.0, 0.0, 0.0, 1.0]\n---\n"
    )
    path = tmp_path / "echo.yaml"
    path.write_text(message % 1 + message % 2)
    assert read_camera(path).parameters["k1"] == 0.1
    path.write_text(message % 1 + (message % 2).replace("600.0", "601.0"))
    with pytest.raises(InputError, match="2 documents that differ"):
        read_camera(path)


def test_the_cases_from_the_field(shared_case: Callable[[str], Path]) -> None:
    np.testing.assert_allclose(
        read_camera(shared_case("02-camera-keys") / "min_coeffs.json").project(P), (1053.77, 659.01), atol=5e-3
    )
    echo = read_camera(shared_case("06-ros2-topic-echo") / "min_echo.yaml")
    assert (echo.image_size, echo.parameters["fx"], echo.parameters["k1"]) == ((1280, 800), 600.0, 0.1)


def test_cameras_by_name_with_what_stands_beside_them(tmp_path: Path) -> None:
    """As many programs write several: each under its name, the size once for all of them."""
    path = tmp_path / "intrinsics.json"
    one = {"K": [[640.25, 0, 643.17], [0, 639.81, 402.88], [0, 0, 1]], "distortion": FIVE}
    path.write_text(json.dumps({"front": one, "back": one | {"distortion": [0.0] * 5}, "width": 1280, "height": 800}))
    found = read_any(path)
    assert {name: camera.model.name for name, camera in found.cameras.items()} == {"front": "brown", "back": "pinhole"}
    np.testing.assert_allclose(pixel(found.cameras["front"]), BROWN_PIXEL, atol=1e-3)
    assert read_camera(path, name="back").image_size == (1280, 800)
    with pytest.raises(InputError, match="it holds 2 cameras, front, back; say which"):
        read_camera(path)
    path.write_text(
        json.dumps({"front": one | {"distortion": [0.1, 0.2, 0.3]}, "back": one, "width": 1280, "height": 800})
    )
    with pytest.raises(InputError, match="front"):
        read_any(path)


def test_a_size_in_a_list_whose_order_the_principal_point_contradicts_is_asked(tmp_path: Path) -> None:
    """Programs that write an image's shape give the height first."""
    K = [[640.25, 0, 643.17], [0, 639.81, 402.88], [0, 0, 1]]
    listed = {"camera_resolution": [800, 1280], "camera_matrix": K, "distortion_coefficients": FIVE}
    with pytest.raises(InputError, match=r"written as 800, 1280.*say --image-size 1280x800 or 800x1280"):
        camera_of(tmp_path, listed)
    assert camera_of(tmp_path, listed, image_size=(1280, 800)).image_size == (1280, 800)
    assert camera_of(tmp_path, listed | {"camera_resolution": [1280, 800]}).image_size == (1280, 800)
    # A projector's lens is shifted down by half an image: one way, and no reason to ask.
    shifted = [[1400.0, 0, 640.0], [0, 1400.0, 790.0], [0, 0, 1]]
    assert camera_of(tmp_path, {"image_size": [1280, 800], "camera_matrix": shifted}).image_size == (1280, 800)
