"""OpenCV's files: written ones are read by OpenCV, OpenCV's are read here, in its three syntaxes."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

import calibrant as cb
from calibrant.cameras import Camera, camera_model
from calibrant.data import CalibrationResult, as_transform
from calibrant.errors import InputError
from calibrant.formats.cameras.opencv import write_intrinsics
from calibrant.formats.cameras.read import read_camera
from calibrant.formats.documents.opencv_storage import read_json, read_xml, read_yaml, yaml_text
from calibrant.geometry import se3, so3

CAMERA = Camera.create(
    "brown",
    {
        "fx": 1000 / 3,
        "fy": 534.5,
        "cx": 342.0,
        "cy": 233.1,
        "k1": -0.28,
        "k2": 1e-7,
        "p1": 1.23e-19,
        "p2": -0.0001,
        "k3": 2.0,
    },
    image_size=(640, 480),
    covariance=np.diag(np.arange(9.0)),
)


def test_opencv_reads_what_is_written(tmp_path: Path) -> None:
    path = write_intrinsics(CAMERA, tmp_path / "Intr.yml", rms_px=0.123456789012345)
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    np.testing.assert_array_equal(storage.getNode("camera_matrix").mat(), CAMERA.K)
    np.testing.assert_array_equal(storage.getNode("distortion_coefficients").mat()[:, 0], CAMERA.values[4:])
    assert storage.getNode("image_width").real() == 640
    assert storage.getNode("image_height").real() == 480
    assert storage.getNode("avg_reprojection_error").real() == 0.123456789012345
    assert storage.getNode("camera_model").string() == "brown"
    assert storage.getNode("parameter_sigma").mat().shape == (9, 1)
    assert path.read_text().startswith("%YAML:1.0\n---\n")


def test_what_is_written_is_read_back(tmp_path: Path) -> None:
    camera = read_camera(write_intrinsics(CAMERA, tmp_path / "Intr.yml"))
    np.testing.assert_array_equal(camera.values, CAMERA.values)
    assert (camera.model.name, camera.image_size) == ("brown", (640, 480))
    np.testing.assert_allclose(list(camera.sigma.values()), list(CAMERA.sigma.values()), rtol=1e-15)
    pinhole = Camera.create("pinhole", {"fx": 500, "fy": 501, "cx": 1, "cy": 2}, image_size=(64, 48))
    back = read_camera(write_intrinsics(pinhole, tmp_path / "pinhole.yml"))
    assert back.model.name == "pinhole"
    np.testing.assert_array_equal(back.values, pinhole.values)


STEREO = """%YAML:1.0
---
M1: !!opencv-matrix
   {rows: 3, cols: 3, dt: d, data: [500., 0., 320., 0., 501., 240., 0., 0., 1.]}
D1: !!opencv-matrix
   {rows: 1, cols: 5, dt: d, data: [-0.1, 0.01, 0.001, 0.002, 0.]}
M2: !!opencv-matrix
   {rows: 3, cols: 3, dt: d, data: [510., 0., 330., 0., 511., 250., 0., 0., 1.]}
D2: !!opencv-matrix
   {rows: 1, cols: 5, dt: d, data: [-0.2, 0.02, 0.003, 0.004, 0.]}
"""


@pytest.mark.parametrize(("name", "fx", "k1"), [("left", 500.0, -0.1), ("right", 510.0, -0.2)])
def test_each_camera_of_a_stereo_file_can_be_read(tmp_path: Path, name: str, fx: float, k1: float) -> None:
    (tmp_path / "stereo.yml").write_text(STEREO)
    camera = read_camera(tmp_path / "stereo.yml", image_size=(640, 480), name=name)
    assert (camera.parameters["fx"], camera.parameters["k1"]) == (fx, k1)


def test_a_stereo_file_says_which_cameras_it_has(tmp_path: Path) -> None:
    (tmp_path / "stereo.yml").write_text(STEREO)
    with pytest.raises(InputError, match="the cameras left and right, none of them 'up'"):
        read_camera(tmp_path / "stereo.yml", image_size=(640, 480), name="up")
    with pytest.raises(InputError, match="it holds 2 cameras, left, right; say which"):
        read_camera(tmp_path / "stereo.yml", image_size=(640, 480))


def test_the_named_camera_of_a_result_is_read(tmp_path: Path) -> None:
    other = Camera.create("pinhole", {"fx": 500, "fy": 501, "cx": 1, "cy": 2}, image_size=(64, 48))
    both = CalibrationResult("rig", "ok", cameras={"left": CAMERA, "right": other}).write(tmp_path / "rig.json")
    assert read_camera(both, name="right").model.name == "pinhole"
    np.testing.assert_array_equal(read_camera(both, name="left").values, CAMERA.values)
    with pytest.raises(InputError, match="it holds the cameras left, right, none of them 'up'"):
        read_camera(both, name="up")
    alone = CalibrationResult("intrinsics", "ok", cameras={"camera": CAMERA}).write(tmp_path / "alone.json")
    np.testing.assert_array_equal(read_camera(alone, name="left").values, CAMERA.values)


def test_an_existing_file_is_kept(tmp_path: Path) -> None:
    (tmp_path / "Intr.yml").write_text("mine")
    with pytest.raises(InputError, match="exists already"):
        write_intrinsics(CAMERA, tmp_path / "Intr.yml")


@pytest.mark.parametrize("suffix", ["yml", "xml", "json"])
def test_opencv_files_are_read(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"c.{suffix}"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", 640)
    storage.write("image_height", 480)
    storage.write("cameraMatrix", CAMERA.K)
    storage.write("distCoeffs", CAMERA.values[4:].reshape(1, 5))
    storage.write("note", "a note: with # signs")
    storage.release()
    camera = read_camera(path)
    np.testing.assert_array_equal(camera.values, CAMERA.values)


def test_matrices_of_every_type_agree_with_opencv(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    matrices = {
        "bytes": rng.integers(0, 255, (2, 3)).astype(np.uint8),
        "floats": rng.normal(size=(3, 2)).astype(np.float32),
        "points": rng.normal(size=(4, 1, 2)),
        "long": 1e9 * rng.normal(size=(1, 30)),
    }
    for suffix, read in (("yml", read_yaml), ("xml", read_xml), ("json", read_json)):
        path = tmp_path / f"m.{suffix}"
        storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
        for name, matrix in matrices.items():
            storage.write(name, matrix)
        storage.release()
        data = read(path.read_text(), str(path))
        for name, matrix in matrices.items():
            # float32 is written with nine digits
            np.testing.assert_allclose(data[name], matrix, rtol=1e-8, err_msg=f"{suffix} {name}")


def test_every_number_survives_opencv(tmp_path: Path) -> None:
    values = np.array([[0.0, 1.0, -1e-300, 1e300, 1 / 3, 123456789.0, 5e-324, -0.1]])
    path = tmp_path / "v.yml"
    path.write_text(yaml_text({"v": values, "x": 1e22, "n": 3, "s": 'quote " and \\ back'}))
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    np.testing.assert_array_equal(storage.getNode("v").mat(), values)
    assert storage.getNode("x").real() == 1e22
    assert storage.getNode("s").string() == 'quote " and \\ back'
    data = read_yaml(path.read_text(), "v.yml")
    np.testing.assert_array_equal(data["v"], values)
    assert data["x"] == 1e22


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "%YAML:1.0\n---\nK: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ 1., 2. ]\n",
            "do not fit rows x cols",
        ),
        ("%YAML:1.0\n---\nK: !!opencv-matrix\n   rows: 3\n   cols: 3\n", "without dt and data"),
        ("%YAML:1.0\n---\nK: [1, 2\nx: 3\n", r"c\.yml:4: not YAML"),
        ("<opencv_storage><K>", r"c\.yml:1: not XML"),
        ("<other/>", "XML whose root is <other>; expected a camera"),
        ("{", r"c\.yml:1: not JSON"),
    ],
)
def test_broken_files_are_named_with_their_line(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "c.yml"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        read_camera(path)


@pytest.mark.parametrize("model", ["pinhole_skew", "rational", "thin_prism", "tilted", "kannala_brandt", "unified"])
def test_opencvs_other_models_come_back(tmp_path: Path, model: str) -> None:
    kind = camera_model(model)
    values = np.concatenate([[500.0, 501.0, 320.0, 240.0], 0.01 * np.arange(1.0, len(kind.parameter_names) - 3)])
    camera = Camera(kind, (640, 480), values)
    back = read_camera(write_intrinsics(camera, tmp_path / "Intr.yml"))
    assert back.model.name == model
    np.testing.assert_array_equal(back.values, values)


def test_opencvs_fisheye_and_omnidir_files_are_read(tmp_path: Path) -> None:
    """calibration.cpp writes fisheye_model: 1; omnidir's sample writes xi."""
    K = np.array([[500.0, 0, 320], [0, 501, 240], [0, 0, 1]])
    values = {
        "image_width": 640,
        "image_height": 480,
        "camera_matrix": K,
        "distortion_coefficients": np.full((4, 1), 0.01),
    }
    (tmp_path / "f.yml").write_text(yaml_text({**values, "fisheye_model": 1}))
    (tmp_path / "o.yml").write_text(yaml_text({**values, "xi": 1.3}))
    assert read_camera(tmp_path / "f.yml").model.name == "kannala_brandt"
    omnidir = read_camera(tmp_path / "o.yml")
    assert (omnidir.model.name, omnidir.parameters["xi"]) == ("unified", 1.3)


def test_a_model_that_opencv_lacks_is_refused(tmp_path: Path) -> None:
    camera = Camera.create("double_sphere", {"fx": 5, "fy": 5, "cx": 1, "cy": 2}, image_size=(64, 48))
    with pytest.raises(InputError, match="double_sphere camera cannot be written as OpenCV YAML"):
        write_intrinsics(camera, tmp_path / "Intr.yml")
    assert not (tmp_path / "Intr.yml").exists()


def test_the_interactive_calibrations_file_is_read_with_its_deviations(tmp_path: Path) -> None:
    file = tmp_path / "cameraParameters.yml"
    values = {
        "camera_matrix": np.array([[910.0, 0, 640], [0, 911, 360], [0, 0, 1]]),
        "camera_matrix_std_dev": np.array([[1.0], [1.1], [2.0], [2.1]]),
        "dist_coeffs": np.array([[0.1, -0.2, 1e-3, 2e-3, 0.05]]),
        "dist_coeffs_std_dev": np.array([[0.01], [0.02], [1e-4], [2e-4], [0.03]]),
        "avg_reprojection_error": 0.24,
    }
    file.write_text(yaml_text(values) + "cameraResolution: [ 1280, 720 ]\n")
    camera = read_camera(file)
    assert camera.image_size == (1280, 720)
    sigma = {"fx": 1.0, "fy": 1.1, "cx": 2.0, "cy": 2.1, "k1": 0.01, "k2": 0.02, "p1": 1e-4, "p2": 2e-4, "k3": 0.03}
    assert camera.sigma == pytest.approx(sigma)


@pytest.mark.parametrize("ending", ["yml", "xml"])
def test_the_stereo_samples_two_files_are_a_pair(tmp_path: Path, ending: str) -> None:
    K = np.array([[910.0, 0, 640], [0, 911, 360], [0, 0, 1]])
    D = np.array([[0.1, -0.2, 1e-3, 2e-3, 0.05]])
    for name, values in (
        ("intrinsics", {"M1": K, "D1": D, "M2": K, "D2": D}),
        ("extrinsics", {"R": np.eye(3), "T": np.array([[-60.0], [0.0], [0.0]]), "R1": np.eye(3)}),
    ):
        storage = cv2.FileStorage(str(tmp_path / f"{name}.{ending}"), cv2.FILE_STORAGE_WRITE)
        for key, value in values.items():
            storage.write(key, value)
        storage.release()
    with pytest.raises(InputError, match="T_unit"):
        cb.convert(tmp_path, image_size="1280x720")
    found = cb.convert(tmp_path, image_size="1280x720", unit="mm")
    np.testing.assert_allclose(found.transform("left", "right").matrix[:3, 3], [0.06, 0, 0], atol=1e-15)
    assert list(found.cameras) == ["left", "right"]


def test_any_two_connected_cameras_are_written_as_a_pair(tmp_path: Path) -> None:
    camera = Camera.create("brown", {"fx": 800.0, "fy": 810.0, "cx": 320.0, "cy": 240.0}, image_size=(640, 480))
    T_base_a = se3.make(so3.exp([0.1, 0.2, -0.3]), [0.5, 0.1, 0.2])
    T_base_b = se3.make(so3.exp([0.1, 0.25, -0.3]), [0.6, 0.1, 0.2])
    places = (as_transform("base", "a", T_base_a), as_transform("base", "b", T_base_b))
    CalibrationResult("rig", "ok", cameras={"a": camera, "b": camera}, transforms=places).write(tmp_path / "rig.json")
    cb.convert(tmp_path / "rig.json", tmp_path / "stereo.yml", to="opencv-stereo")
    storage = cv2.FileStorage(str(tmp_path / "stereo.yml"), cv2.FILE_STORAGE_READ)
    R, T, F = (storage.getNode(key).mat() for key in "RTF")
    point = np.array([0.7, 0.2, 3.0])
    in_a, in_b = (se3.apply(se3.inverse(T_base_c), point) for T_base_c in (T_base_a, T_base_b))
    np.testing.assert_allclose(R @ (1e3 * in_a) + T[:, 0], 1e3 * in_b, atol=1e-9)
    a, b = (np.append(camera.project(p), 1.0) for p in (in_a, in_b))
    assert abs(b @ F @ a) < 1e-9 * np.linalg.norm(F) * np.linalg.norm(a) * np.linalg.norm(b)
    again = cb.convert(tmp_path / "stereo.yml")
    np.testing.assert_allclose(again.transform("a", "b").matrix, se3.inverse(T_base_a) @ T_base_b, atol=1e-12)


def test_values_close_behind_their_keys_are_read_as_opencv_reads_them(tmp_path: Path) -> None:
    """As ORB-SLAM's settings have them by hand."""
    file = tmp_path / "tight.yml"
    file.write_text(
        '%YAML:1.0\nfx:500.5\nname:"a: b"\nK: !!opencv-matrix\n   rows:1\n   cols:2\n   dt: d\n   data:[1., -2]\n'
    )
    storage = cv2.FileStorage(str(file), cv2.FILE_STORAGE_READ)
    found = read_yaml(file.read_text(), "tight.yml")
    assert found["fx"] == storage.getNode("fx").real() == 500.5
    assert found["name"] == storage.getNode("name").string() == "a: b"
    np.testing.assert_array_equal(found["K"], storage.getNode("K").mat())
