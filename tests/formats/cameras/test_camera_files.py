"""Cameras from the files of other programs, and what is said about files that hold none."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml

from calibrant.cameras import Camera, camera_model
from calibrant.data import CalibrationResult
from calibrant.data.result_file import write_result
from calibrant.errors import InputError
from calibrant.formats.cameras.read import read_camera
from calibrant.formats.cameras.ros.camera_info import write_camera_info

K = [[800.5, 0, 320.25], [0, 801.5, 240.75], [0, 0, 1]]
K_FLAT = [number for row in K for number in row]
D = [-0.1, 0.02, 0.001, -0.002, 0.003]
EXPECTED = [800.5, 801.5, 320.25, 240.75, *D]


def camera_of(path: Path, data: object, **options: tuple[int, int]) -> Camera:
    path.write_text(yaml.safe_dump(data))
    return read_camera(path, **options)


def test_ros_camera_info_file_and_message(tmp_path: Path) -> None:
    file = {
        "image_width": 640,
        "image_height": 480,
        "camera_name": "left",
        "camera_matrix": {"rows": 3, "cols": 3, "data": K_FLAT},
        "distortion_model": "plumb_bob",
        "distortion_coefficients": {"rows": 1, "cols": 5, "data": D},
        "projection_matrix": {"rows": 3, "cols": 4, "data": [0.0] * 12},
    }
    message = {"width": 640, "height": 480, "distortion_model": "plumb_bob", "K": K_FLAT, "D": D}
    for data in (file, message):
        camera = camera_of(tmp_path / "c.yaml", data)
        assert camera.image_size == (640, 480)
        np.testing.assert_array_equal(camera.values, EXPECTED)


def message(
    terms: list[float], *, model: str = "rational_polynomial", matrix: list[float] = K_FLAT
) -> dict[str, object]:
    return {"width": 640, "height": 480, "distortion_model": model, "K": matrix, "D": terms}


FOURTEEN = [*D, 0.1, -0.2, 0.3, 1e-3, 2e-3, 3e-3, 4e-3, 0.01, -0.02]


@pytest.mark.parametrize(
    ("count", "model"), [(4, "brown"), (5, "brown"), (8, "rational"), (12, "thin_prism"), (14, "tilted")]
)
def test_the_model_with_fewest_terms_is_taken(tmp_path: Path, count: int, model: str) -> None:
    camera = camera_of(tmp_path / "c.yaml", message(FOURTEEN[:count]))
    assert camera.model.name == model
    np.testing.assert_array_equal(camera.values[4 : 4 + count], FOURTEEN[:count])
    padded = camera_of(tmp_path / "c.yaml", message([*FOURTEEN[:count], *[0.0] * (14 - count)]))
    assert padded.model.name == model


def test_an_equidistant_ros_camera_is_a_kannala_brandt(tmp_path: Path) -> None:
    camera = camera_of(tmp_path / "c.yaml", message(D[:4], model="equidistant"))
    assert camera.model.name == "kannala_brandt"
    np.testing.assert_array_equal(camera.values[4:], D[:4])
    with pytest.raises(
        InputError, match="5 distortion coefficients; a camera of the model kannala_brandt has k1, k2, k3, k4"
    ):
        camera_of(tmp_path / "c.yaml", message(D, model="equidistant"))
    with pytest.raises(InputError, match="'fov', expected one of plumb_bob, rational_polynomial, equidistant"):
        camera_of(tmp_path / "c.yaml", message(D, model="fov"))


def test_skew_is_kept_where_a_model_has_it(tmp_path: Path) -> None:
    """Without distortion, pinhole_skew; with k1 k2 p1 p2, the unified model at xi = 0: u = fx x' + skew y' + cx."""
    skewed = [800.5, 2.5, 320.25, *K_FLAT[3:]]
    plain = camera_of(tmp_path / "c.yaml", message([], matrix=skewed))
    assert (plain.model.name, plain.parameters["skew"]) == ("pinhole_skew", 2.5)
    bent = camera_of(tmp_path / "c.yaml", message(D[:4], matrix=skewed))
    straight = camera_of(tmp_path / "c.yaml", message(D[:4]))
    p = np.array([[0.1, -0.2, 1.0], [-0.3, 0.25, 0.8]])
    y = (straight.project(p)[:, 1] - 240.75) / 801.5
    np.testing.assert_allclose(bent.project(p), straight.project(p) + np.stack([2.5 * y, 0 * y], axis=1), atol=1e-10)
    with pytest.raises(InputError, match=r"skew 2\.5 together with k1, k2, k3, p1, p2; models with skew"):
        camera_of(tmp_path / "c.yaml", message(D, matrix=skewed))


@pytest.mark.parametrize("model", ["pinhole", "brown", "rational", "thin_prism", "tilted", "kannala_brandt"])
def test_a_ros_file_comes_back(tmp_path: Path, model: str) -> None:
    names = camera_model(model).parameter_names
    given = dict(zip(names, [500.0, 501.0, 320.0, 240.0, *(0.01 * np.arange(1.0, len(names) - 3))]))
    camera = Camera.create(model, given, image_size=(640, 480))
    back = read_camera(write_camera_info(camera, tmp_path / "c.yaml"))
    assert back.model.name == model
    np.testing.assert_array_equal(back.values, camera.values)
    data = yaml.safe_load((tmp_path / "c.yaml").read_text())
    assert data["projection_matrix"]["data"][:4] == [500.0, 0.0, 320.0, 0.0]


def test_a_model_that_ros_lacks_is_refused(tmp_path: Path) -> None:
    camera = Camera.create("double_sphere", {"fx": 5, "fy": 5, "cx": 1, "cy": 2}, image_size=(64, 48))
    with pytest.raises(InputError, match="double_sphere camera cannot be written as ROS camera_info"):
        write_camera_info(camera, tmp_path / "c.yaml")
    assert not (tmp_path / "c.yaml").exists()


def test_a_principal_point_off_the_images_is_named(tmp_path: Path) -> None:
    """Half the images' size, or width and height exchanged; a projector's shifted lens is let through."""
    data = {"fx": 800.0, "fy": 800.0, "cx": 640.0, "cy": 512.0}
    with pytest.raises(InputError, match=r"\(640, 512\) px lies outside of images of 512x400 px; expected a camera of"):
        camera_of(tmp_path / "c.yaml", data, image_size=(512, 400))
    with pytest.raises(InputError, match="lies outside of images of 320x256 px"):
        camera_of(tmp_path / "c.yaml", {**data, "width": 320, "height": 256})
    projector = {**data, "cy": 1357.8, "width": 1280, "height": 800}
    assert camera_of(tmp_path / "c.yaml", projector).parameters["cy"] == 1357.8


def test_named_intrinsics_need_the_image_size(tmp_path: Path) -> None:
    data = {"intrinsics": {"fx": 550.0, "fy": 551.0, "cx": 320.0, "cy": 240.0}}
    with pytest.raises(InputError, match=r"c\.yaml: the file holds no image size; give it with the images"):
        camera_of(tmp_path / "c.yaml", data)
    camera = camera_of(tmp_path / "c.yaml", data, image_size=(640, 480))
    assert camera.model.name == "pinhole"
    np.testing.assert_array_equal(camera.values, [550, 551, 320, 240])
    flat = {"fx": 1.0, "fy": 2.0, "cx": 3.0, "cy": 4.0, "k1": 0.5, "width": 8, "height": 6}
    assert camera_of(tmp_path / "c.yaml", flat).parameters["k1"] == 0.5


def test_a_result_file_is_read_with_its_covariance(tmp_path: Path) -> None:
    camera = Camera.create(
        "brown", {"fx": 1, "fy": 2, "cx": 3, "cy": 4}, image_size=(8, 6), covariance=np.diag(np.arange(9.0))
    )
    path = write_result(CalibrationResult("intrinsics", "ok", cameras={"camera": camera}), tmp_path / "c.json")
    back = read_camera(path)
    np.testing.assert_array_equal(back.values, camera.values)
    np.testing.assert_array_equal(back.covariance, camera.covariance)
    with pytest.raises(InputError, match="images of 8x6 px, the images are 640x480 px"):
        read_camera(path, image_size=(640, 480))
    path = write_result(CalibrationResult("hand-eye", "ok"), tmp_path / "h.json")
    with pytest.raises(InputError, match="0 cameras"):
        read_camera(path)


def test_the_size_of_the_images_must_be_that_of_the_camera(tmp_path: Path) -> None:
    data = {"fx": 1.0, "fy": 2.0, "cx": 3.0, "cy": 4.0, "width": 8, "height": 6}
    with pytest.raises(InputError, match="8x6 px, the images are 9x6 px"):
        camera_of(tmp_path / "c.yaml", data, image_size=(9, 6))


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ({"a": 1, "b": 2}, "no camera in it; its keys are 'a', 'b'; formats read: .*calibrant, "),
        ([1, 2], "expected keys and values"),
        ({"fx": "wide", "fy": 1, "cx": 1, "cy": 1, "width": 2, "height": 2}, "fx is .*'wide'.*, expected numbers"),
        ({"camera_matrix": {"data": [1, 2]}, "image_width": 2, "image_height": 2}, "2 numbers, expected 9"),
        (
            {"camera_matrix": {"data": [1, 0, 0, 0, 1, 0, 0, 0, 2]}, "image_width": 2, "image_height": 2},
            r"expected \[\[fx, skew, cx\]",
        ),
        ({"fx": 1, "fy": -1, "cx": 1, "cy": 1, "width": 2, "height": 2}, "fy is -1 px; a focal length is above 0"),
        ({"fx": 1, "fy": [1, 2], "cx": 1, "cy": 1, "width": 2, "height": 2}, "fy holds 2 numbers, expected one"),
        (
            {
                "camera_matrix": {"data": K_FLAT},
                "distortion_coefficients": {"data": [0.1, 0, 0]},
                "image_width": 640,
                "image_height": 480,
            },
            "3 distortion coefficients .* expected 4, 5, 8, 12 or 14",
        ),
    ],
)
def test_files_without_a_usable_camera_say_why(tmp_path: Path, data: object, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        camera_of(tmp_path / "c.yaml", data)
    assert "c.yaml" in str(caught.value)


def test_missing_and_binary_files_are_said(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.yaml does not exist"):
        read_camera(tmp_path / "none.yaml")
    (tmp_path / "b.yaml").write_bytes(b"\xff\xd8\xff\x00")
    with pytest.raises(InputError, match="a binary file; expected a camera in a file of a known format"):
        read_camera(tmp_path / "b.yaml")
    (tmp_path / "v.json").write_text(json.dumps({"format": "calibrant/9"}))
    with pytest.raises(InputError, match=r"'calibrant/9'; this version .* reads 'calibrant/2' and 'calibrant/1'"):
        read_camera(tmp_path / "v.json")


def test_the_real_files_are_read(shared_data: Callable[[str], Path]) -> None:
    rct = read_camera(
        shared_data("handeye_rct_charuco_static") / "camera_intr_calibrated.yaml", image_size=(1600, 1200)
    )
    np.testing.assert_array_equal(rct.values, [1352.02747, 1356.14287, 789.67065, 627.2995])
    procam = read_camera(shared_data("procam_kamino_graycode") / "calibration_result.xml")
    assert procam.image_size == (1280, 1024)
    assert procam.parameters["fx"] == 3.4523929068729908e03
