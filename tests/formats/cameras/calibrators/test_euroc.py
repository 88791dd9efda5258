"""EuRoC's sensor.yaml: its folders, several cameras in one file, sizes and matrices in all their ways."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.formats.cameras.calibrators.rigs import assert_same, graph, rig, through

from calibrant.data import as_transform
from calibrant.errors import InputError
from calibrant.formats.documents.document import Document
from calibrant.formats.exchange.exchange_format import read_cameras
from calibrant.formats.exchange.read import format_of, read_any
from calibrant.geometry import se3
from calibrant.reading.notes import heard

SENSOR = """# General sensor definitions.
sensor_type: camera
comment: cam0 of a test

# Sensor extrinsics wrt. the body-frame.
T_BS:
  cols: 4
  rows: 4
  data: [0.0, -1.0, 0.0, -0.02,
         1.0, 0.0, 0.0, -0.06,
         0.0, 0.0, 1.0, 0.01,
         0.0, 0.0, 0.0, 1.0]

# Camera specific definitions.
rate_hz: 20
resolution: [752, 480]
camera_model: pinhole
intrinsics: [458.5, 457.5, 367.25, 248.375] #fu, fv, cu, cv
distortion_model: radial-tangential
distortion_coefficients: [-0.28, 0.07, 0.0002, 1.75e-05]
"""
IMU = "sensor_type: imu\nT_BS:\n  cols: 4\n  rows: 4\n  data: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]\n"


def put(file: Path, text: str = SENSOR) -> Path:
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text)
    return file


def test_a_camera_and_its_place_on_the_body(tmp_path: Path) -> None:
    with heard() as notes:
        found = read_any(put(tmp_path / "cam3" / "sensor.yaml"))
    camera = found.cameras["cam3"]
    assert (camera.model.name, camera.image_size) == ("brown", (752, 480))
    assert camera.parameters == pytest.approx(
        {
            "fx": 458.5,
            "fy": 457.5,
            "cx": 367.25,
            "cy": 248.375,
            "k1": -0.28,
            "k2": 0.07,
            "p1": 2e-4,
            "p2": 1.75e-5,
            "k3": 0,
        }
    )
    (place,) = found.transforms
    assert (place.parent, place.child) == ("body", "cam3")
    # The camera's x axis is the body's y axis.
    np.testing.assert_allclose(place.matrix @ [1, 0, 0, 1], [-0.02, 0.94, 0.01, 1], atol=1e-12)
    assert any("not used: cam3.comment, cam3.rate_hz" in note for note in notes)


@pytest.mark.parametrize("inside", ["", "mav0"])
def test_a_folder_of_sensors(tmp_path: Path, inside: str) -> None:
    put(tmp_path / inside / "cam0" / "sensor.yaml")
    put(tmp_path / inside / "cam1" / "sensor.yaml", SENSOR.replace("-0.06", "0.05"))
    put(tmp_path / inside / "imu0" / "sensor.yaml", IMU)
    found = read_any(tmp_path)
    assert list(found.cameras) == ["cam0", "cam1"]
    np.testing.assert_allclose(graph(found).T("cam0", "cam1")[:3, 3], [0.11, 0, 0], atol=1e-12)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("resolution: [752, 480]", "resolution:\n  width: 752\n  height: 480"),
        ("camera_model: pinhole", "projection_model: pinhole"),
        ("radial-tangential", "radial_tangential"),
        ("# General", "%YAML:1.0\n# General"),
        ("T_BS:\n  cols: 4\n  rows: 4\n  data:", "T_BS:\n "),
        ("T_BS:\n", "T_BS: !!opencv-matrix\n  dt: d\n"),
    ],
)
def test_the_same_words_as_other_programs_write_them(tmp_path: Path, old: str, new: str) -> None:
    wanted = read_any(put(tmp_path / "cam0" / "sensor.yaml"))
    text = SENSOR.replace(old, new)
    assert text != SENSOR
    found = read_any(put(tmp_path / "cam0" / "other.yaml", text))
    assert_same(found, wanted)
    np.testing.assert_array_equal(found.transforms[0].matrix, wanted.transforms[0].matrix)


def test_several_cameras_in_one_file(tmp_path: Path) -> None:
    indented = "\n".join(f"  {line}" for line in SENSOR.splitlines())
    text = f"ncam: 2\ncamera_0:\n{indented}\ncamera_1:\n{indented.replace('-0.06', '0.05')}\n"
    found = read_any(put(tmp_path / "rig.yaml", text))
    assert list(found.cameras) == ["camera_0", "camera_1"]
    np.testing.assert_allclose(graph(found).T("camera_0", "camera_1")[:3, 3], [0.11, 0, 0], atol=1e-12)


def test_there_and_back(tmp_path: Path) -> None:
    before = rig("pinhole", "kannala_brandt", "brown")
    after = through(before, tmp_path / "mav0", "euroc")
    assert format_of(Document(tmp_path / "mav0")).name == "euroc"
    assert_same(after, before)
    np.testing.assert_allclose(graph(after).T("body", "cam1"), graph(before).T("imu", "cam1"), atol=1e-12)
    one = read_cameras(
        {"camera": before.cameras["cam0"]},
        transforms=(as_transform("imu", "camera", se3.exp([1.0, 2, 3, 0.1, 0.2, 0.3])),),
    )
    alone = through(one, tmp_path / "sensor.yaml", "euroc")
    np.testing.assert_allclose(alone.transforms[0].matrix, one.transforms[0].matrix, atol=1e-12)
    assert_same(alone, one)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("camera_model: pinhole", "camera_model: cylinder", "camera_model is 'cylinder'"),
        ("0.0, 0.0, 1.0, 0.01,", "0.0, 0.0, 1.1, 0.01,", "rotation of camera.T_BS is none"),
        ("resolution: [752, 480]", "", "no image size"),
        ("[458.5, 457.5, 367.25, 248.375]", "[458.5, 457.5, 367.25]", "holds 3 numbers, expected fx, fy, cx, cy"),
    ],
)
def test_bad_files_are_refused_by_name(tmp_path: Path, old: str, new: str, words: str) -> None:
    with pytest.raises(InputError, match=rf"sensor\.yaml.*{words}"):
        read_any(put(tmp_path / "sensor.yaml", SENSOR.replace(old, new)))
