"""ROS camera_info as pairs, ini and archives: read by ROS's rules, written so that ROS's own reader agrees."""

from __future__ import annotations

import gzip
import io
import json
import subprocess
import tarfile
import time
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import yaml

from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, as_transform
from calibrant.errors import InputError
from calibrant.formats.cameras.read import read_camera
from calibrant.formats.exchange.exchange_format import WriteOptions
from calibrant.formats.exchange.read import read_any
from calibrant.formats.exchange.registry import format_named
from calibrant.geometry import se3, so3
from calibrant.opencv import cv2
from calibrant.reading.notes import heard

LEFT = Camera.create(
    "brown",
    dict(
        zip(
            ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3"),
            (702.5, 701.25, 318, 243, -0.2, 0.05, 1e-3, -2e-4, 0.01),
        )
    ),
    image_size=(640, 480),
)
RIGHT = Camera.create("pinhole", {"fx": 699.0, "fy": 698.5, "cx": 322.0, "cy": 237.0}, image_size=(640, 480))
T_LEFT_RIGHT = se3.make(so3.exp([0.01, -0.03, 0.02]), [0.12, 0.003, -0.004])
SYSTEM_PYTHON = Path("/usr/bin/python3")


def pair(T: np.ndarray = T_LEFT_RIGHT, **cameras: Camera) -> CalibrationResult:
    names = {"left": LEFT, "right": RIGHT} | cameras
    return CalibrationResult("rig", "ok", cameras=names, transforms=(as_transform("left", "right", T),))


def written(result: CalibrationResult, form: str, folder: Path) -> Path:
    content = format_named(form).write(result, WriteOptions())
    if isinstance(content, bytes):
        (folder / "camera.ini").write_bytes(content)
        return folder / "camera.ini"
    for name, data in content.items():
        (folder / name).write_bytes(data)
    return folder


def info(camera: Camera, name: str, R: np.ndarray, P: np.ndarray) -> dict[str, object]:
    terms = [camera.parameters.get(k, 0.0) for k in ("k1", "k2", "p1", "p2", "k3")]
    return {
        "image_width": 640,
        "image_height": 480,
        "camera_name": name,
        "camera_matrix": {"rows": 3, "cols": 3, "data": camera.K.ravel().tolist()},
        "distortion_model": "plumb_bob",
        "distortion_coefficients": {"rows": 1, "cols": 5, "data": terms},
        "rectification_matrix": {"rows": 3, "cols": 3, "data": R.ravel().tolist()},
        "projection_matrix": {"rows": 3, "cols": 4, "data": P.ravel().tolist()},
    }


def opencvs(T_left_right: np.ndarray) -> tuple[dict[str, object], dict[str, object]]:
    """Both files as camera_calibration makes them: with cv2.stereoRectify."""
    T = se3.inverse(T_left_right)
    terms = np.array([LEFT.parameters[k] for k in ("k1", "k2", "p1", "p2", "k3")])
    R1, R2, P1, P2, *_ = cv2.stereoRectify(LEFT.K, terms, RIGHT.K, np.zeros(5), (640, 480), T[:3, :3], T[:3, 3:])
    return info(LEFT, "narrow_stereo", R1, P1), info(RIGHT, "narrow_stereo", R2, P2)


@pytest.mark.parametrize("t", [(0.12, 0.003, -0.004), (0.002, 0.2, 0.01)])
def test_opencvs_pair_is_where_opencv_was_told(tmp_path: Path, t: tuple[float, float, float]) -> None:
    T = se3.make(T_LEFT_RIGHT[:3, :3], t)
    for name, data in zip(("left.yaml", "right.yaml"), opencvs(T)):
        (tmp_path / name).write_text(yaml.safe_dump(data))
    found = read_any(tmp_path)
    assert list(found.cameras) == ["left", "right"]
    np.testing.assert_allclose(found.transform("left", "right").matrix, T, atol=1e-12)


def test_a_written_pair_projects_by_the_messages_rule_and_comes_back(tmp_path: Path) -> None:
    """sensor_msgs/CameraInfo: [u v w] = P [R_left X; 1], the same row in both, u_left - u_right = fx' baseline / Z."""
    folder = written(pair(), "camera-info-pair", tmp_path)
    left, right = (yaml.safe_load((folder / f"{side}.yaml").read_text()) for side in ("left", "right"))
    X = np.array([0.1, -0.05, 1.3])
    rectified = np.array(left["rectification_matrix"]["data"]).reshape(3, 3) @ X
    rows = [np.array(d["projection_matrix"]["data"]).reshape(3, 4) @ [*rectified, 1] for d in (left, right)]
    (u, v), (u_right, v_right) = (row[:2] / row[2] for row in rows)
    fx = left["projection_matrix"]["data"][0]
    assert v == pytest.approx(v_right, abs=1e-10)
    assert u - u_right == pytest.approx(fx * np.linalg.norm(T_LEFT_RIGHT[:3, 3]) / rectified[2], abs=1e-9)
    in_right = np.array(right["rectification_matrix"]["data"]).reshape(3, 3) @ se3.apply(se3.inverse(T_LEFT_RIGHT), X)
    K = np.array(right["projection_matrix"]["data"]).reshape(3, 4)[:, :3]
    np.testing.assert_allclose((K @ in_right)[:2] / in_right[2], [u_right, v_right], atol=1e-9)
    back = read_any(folder)
    np.testing.assert_allclose(back.transform("left", "right").matrix, T_LEFT_RIGHT, atol=1e-12)
    np.testing.assert_array_equal(back.cameras["left"].values, LEFT.values)
    assert read_camera(folder, name="right").parameters == RIGHT.parameters


def test_a_pair_given_the_other_way_round_has_its_left_one_left(tmp_path: Path) -> None:
    folder = written(pair(se3.inverse(T_LEFT_RIGHT)), "camera-info-pair", tmp_path)
    left = yaml.safe_load((folder / "left.yaml").read_text())
    assert (left["camera_name"], left["projection_matrix"]["data"][3]) == ("right", 0.0)
    back = read_any(folder)
    np.testing.assert_allclose(back.transform("right", "left").matrix, T_LEFT_RIGHT, atol=1e-12)


def test_one_file_of_a_pair_says_that_there_is_another(tmp_path: Path) -> None:
    folder = written(pair(), "camera-info-pair", tmp_path)
    with heard() as notes:
        assert list(read_any(folder / "right.yaml").cameras) == ["right"]
    assert [("second camera of a pair, 120." in n, "give the folder" in n) for n in notes] == [(True, True)]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"rectification_matrix": {"data": [1, 0, 0, 0, 2, 0, 0, 0, 1]}}, "expected a rotation"),
        ({"projection_matrix": {"data": [800.0, 0, 0, 320, 0, 800, 0, 240, 0, 0, 1, 0]}}, "expected .*Tx"),
        ({"projection_matrix": {"data": [800.0, 0, 320]}}, "holds 3 numbers, expected 12"),
    ],
)
def test_a_camera_is_read_whatever_its_rectification_is(tmp_path: Path, change: dict[str, object], words: str) -> None:
    data = info(LEFT, "left", np.eye(3), np.hstack([LEFT.K, np.zeros((3, 1))])) | change
    (tmp_path / "left.yaml").write_text(yaml.safe_dump(data))
    with pytest.warns(UserWarning, match=f"not used: R and P .*{words}"):
        np.testing.assert_array_equal(read_camera(tmp_path / "left.yaml").values, LEFT.values)


def test_two_files_of_two_calibrations_are_refused(tmp_path: Path) -> None:
    left, right = opencvs(T_LEFT_RIGHT)
    right["projection_matrix"]["data"][0] *= 1.1  # type: ignore[index]
    (tmp_path / "a.yaml").write_text(yaml.safe_dump(left))
    (tmp_path / "b.yaml").write_text(yaml.safe_dump(right))
    with pytest.raises(InputError, match="which those of a rectified pair share; are the files of one calibration"):
        read_any(tmp_path)


def test_a_part_of_the_sensor_is_said(tmp_path: Path) -> None:
    data = {"width": 640, "height": 480, "distortion_model": "plumb_bob", "k": LEFT.K.ravel().tolist(), "d": [0.0] * 5}
    data |= {"binning_x": 2, "binning_y": 2, "roi": {"x_offset": 0, "width": 320, "do_rectify": True}}
    (tmp_path / "c.yaml").write_text(yaml.safe_dump(data))
    with pytest.warns(
        UserWarning, match=r"the whole picture, not of the part that was sent \(binning_x 2, .*roi width"
    ):
        assert read_camera(tmp_path / "c.yaml").image_size == (640, 480)


INI = """# oST version 5.0 parameters


[image]

width
640

height
480

[narrow_stereo/left]

camera matrix
702.500000 0.000000 318.000000
0.000000 701.250000 243.000000
0.000000 0.000000 1.000000

distortion
-0.200000 0.050000 0.001000 -0.000200 0.010000

rectification
1.000000 0.000000 0.000000
0.000000 1.000000 0.000000
0.000000 0.000000 1.000000

projection
700.000000 0.000000 320.000000 0.000000
0.000000 700.000000 240.000000 0.000000
0.000000 0.000000 1.000000 0.000000
"""
RIGHT_INI = INI.replace("/left", "/right").replace("320.000000 0.000000", "320.000000 -84.000000")


def test_ost_txt_of_one_camera_and_of_two(tmp_path: Path) -> None:
    path = tmp_path / "ost.txt"
    path.write_text(INI)
    with heard() as notes:
        assert read_any(path).cameras["narrow_stereo/left"].parameters == LEFT.parameters
    assert notes == [f"{path}: narrow_stereo/left: not used: R and P, which say how rectified pictures look"]
    path.write_text(INI + "\n" + RIGHT_INI)
    found = read_any(path)
    place = found.transform("narrow_stereo/left", "narrow_stereo/right").matrix
    np.testing.assert_allclose(place, se3.make(np.eye(3), [0.12, 0, 0]), atol=1e-15)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("640", "", "holds no width"),
        ("702.500000", "seven", r"\[narrow_stereo/left\] camera matrix: .*seven"),
        ("702.500000", "", "camera matrix has 8 numbers, expected 9"),
        ("-0.200000 0.050000", "", "distortion has 3 numbers, expected 4, 5 or 8"),
        ("[narrow_stereo/left]", "", "no camera in it"),
        ("distortion\n", "", "camera matrix .*|holds no distortion"),
    ],
)
def test_an_ini_that_is_not_whole_is_refused_by_its_section(tmp_path: Path, old: str, new: str, words: str) -> None:
    (tmp_path / "c.ini").write_text(INI.replace(old, new))
    with pytest.raises(InputError, match=rf"c\.ini: .*(?:{words})"):
        read_any(tmp_path / "c.ini")


@pytest.mark.parametrize("model", ["pinhole", "brown", "rational"])
def test_an_ini_comes_back(tmp_path: Path, model: str) -> None:
    names = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")[: {"pinhole": 0, "brown": 5, "rational": 8}[model]]
    values = {"fx": 500 / 3, "fy": 501.0, "cx": 320.1, "cy": 240.2} | dict.fromkeys(names, 1e-07 / 3)
    camera = Camera.create(model, values, image_size=(640, 480))
    path = written(CalibrationResult("intrinsics", "ok", cameras={"wrist": camera}), "camera-info-ini", tmp_path)
    back = read_any(path)
    assert list(back.cameras) == ["wrist"]
    np.testing.assert_array_equal(back.camera.values, camera.values)


def archive(path: Path, files: dict[str, bytes], *, mode: str = "w:gz") -> Path:
    with tarfile.open(path, mode) as tar:  # type: ignore[call-overload]
        for name, data in files.items():
            member = tarfile.TarInfo(name)
            member.size = len(data)
            tar.addfile(member, io.BytesIO(data))
    return path


def text_of(data: dict[str, object]) -> bytes:
    return yaml.safe_dump(data).encode()


@pytest.mark.parametrize("mode", ["w:gz", "w"])
def test_the_archive_of_camera_calibration(tmp_path: Path, mode: str) -> None:
    one, _ = opencvs(T_LEFT_RIGHT)
    picture = np.random.default_rng(1).bytes(20_000)
    files = {"left-0000.png": picture, "left-0001.png": picture, "ost.yaml": text_of(one), "ost.txt": INI.encode()}
    path = archive(tmp_path / "calibrationdata.tar.gz", files, mode=mode)
    with heard() as notes:
        found = read_any(path)
    assert found.cameras["narrow_stereo"].parameters == LEFT.parameters
    assert any("2 pictures in it are not read" in n for n in notes)
    del files["ost.yaml"]
    with pytest.warns(UserWarning, match="2 pictures"):
        assert list(read_any(archive(path, files)).cameras) == ["narrow_stereo/left"]


def test_the_archive_of_a_pair(tmp_path: Path) -> None:
    left, right = opencvs(T_LEFT_RIGHT)
    path = archive(tmp_path / "a.tar.gz", {"left.yaml": text_of(left), "right.yaml": text_of(right)})
    found = read_any(path)
    np.testing.assert_allclose(found.transform("left", "right").matrix, T_LEFT_RIGHT, atol=1e-12)


def test_archives_as_weapons_are_refused_at_once(tmp_path: Path) -> None:
    one = text_of(opencvs(T_LEFT_RIGHT)[0])
    bomb = tmp_path / "bomb.tar.gz"
    bomb.write_bytes(gzip.compress(b"", 1))
    start = time.process_time()
    archive(bomb, {"left-0000.png": bytes(60_000_000), "ost.yaml": one})
    made = time.process_time()
    cases = {
        "swells to more than": bomb,
        "no archive of camera_calibration, or a damaged one": tmp_path / "text.tar.gz",
        "an archive without ost.yaml": archive(tmp_path / "else.tar.gz", {"readme.md": b"words"}),
        "holds ost.yaml twice": archive(tmp_path / "twice.tar.gz", {"ost.yaml": one, "a/ost.yaml": one}),
        "ost.yaml in the archive is no camera_info": archive(tmp_path / "list.tar.gz", {"ost.yaml": b"- 1\n"}),
        "ost.yaml has 2 MB": archive(tmp_path / "long.tar.gz", {"ost.yaml": bytes(2_000_000)}),
    }
    (tmp_path / "text.tar.gz").write_bytes(gzip.compress(b"no archive" * 100))
    for words, path in cases.items():
        with pytest.raises(InputError, match=words):
            read_any(path)
    assert time.process_time() - made < 1.0 + (made - start)
    outside = archive(tmp_path / "outside.tar.gz", {"../../../tmp/ost.yaml": one})
    assert list(read_any(outside).cameras) == ["narrow_stereo"]
    whole = archive(tmp_path / "whole.tar.gz", {"left-0000.png": bytes(range(256)) * 40, "ost.yaml": one}).read_bytes()
    (tmp_path / "cut.tar.gz").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match="damaged"):
        read_any(tmp_path / "cut.tar.gz")


@cache
def ros_reader() -> bool:
    if not SYSTEM_PYTHON.exists():
        return False
    run = subprocess.run([SYSTEM_PYTHON, "-c", "import camera_calibration_parsers"], capture_output=True, check=False)
    return run.returncode == 0


READ = """
import json, sys
from camera_calibration_parsers import readCalibration
found = []
for path in sys.argv[1:]:
    name, info = readCalibration(path)
    matrices = [list(m) for m in (info.D, info.K, info.R, info.P)]
    found.append([name, info.width, info.height, info.distortion_model, *matrices])
print(json.dumps(found))
"""


def test_ros_own_reader_reads_what_we_write(tmp_path: Path) -> None:
    if not ros_reader():
        pytest.skip("/usr/bin/python3 has no camera_calibration_parsers (Debian: python3-camera-calibration-parsers)")
    folder = written(pair(), "camera-info-pair", tmp_path)
    ini = written(CalibrationResult("intrinsics", "ok", cameras={"left": LEFT}), "camera-info-ini", tmp_path)
    paths = [folder / "left.yaml", folder / "right.yaml", ini]
    run = subprocess.run([SYSTEM_PYTHON, "-c", READ, *paths], capture_output=True, text=True, check=True)
    left, right, old = json.loads(run.stdout)
    for found, name, camera in ((left, "left", LEFT), (right, "right", RIGHT), (old, "left", LEFT)):
        assert found[:4] == [name, 640, 480, "plumb_bob"]
        np.testing.assert_allclose(found[4], [camera.parameters.get(k, 0.0) for k in ("k1", "k2", "p1", "p2", "k3")])
        np.testing.assert_allclose(found[5], camera.K.ravel(), rtol=1e-15)
    assert right[7][3] == pytest.approx(-right[7][0] * np.linalg.norm(T_LEFT_RIGHT[:3, 3]), rel=1e-12)
