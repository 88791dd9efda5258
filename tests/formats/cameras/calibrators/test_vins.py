"""VINS-Fusion's settings: the poses on the IMU, the camera files beside, the shift between the clocks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.formats.cameras.calibrators.rigs import assert_same, graph, rig, through

import calibrant as cb
from calibrant.errors import InputError
from calibrant.formats.exchange.read import read_any
from calibrant.reading.notes import heard

RIG = """%YAML:1.0

#support: 1 imu 1 cam; 1 imu 2 cam: 2 cam;
imu: 1
num_of_cam: 2

imu_topic: "/camera/imu"
cam0_calib: "left.yaml"
cam1_calib: "right.yaml"
image_width: 1280
image_height: 800

# Extrinsic parameter between IMU and Camera.
body_T_cam0: !!opencv-matrix
   rows: 4
   cols: 4
   dt: d
   data: [0., 0., 1., 0.02,
          -1., 0., 0., 0.008,
          0., -1., 0., 0.003, 0., 0., 0., 1. ]
body_T_cam1: !!opencv-matrix
   rows: 4
   cols: 4
   dt: d
   data: [0., 0., 1., 0.02, -1., 0., 0., -0.05, 0., -1., 0., 0.003, 0., 0., 0., 1.]
td: -0.0125                # readed image clock + td = real image clock (IMU clock)
"""
CAMERA = """%YAML:1.0
---
model_type: PINHOLE
camera_name: camera
image_width: 1280
image_height: 800
distortion_parameters:
   k1: -0.1
   k2: 0.02
   p1: 0.001
   p2: -0.002
projection_parameters:
   fx: 640.5
   fy: 641.5
   cx: 642.0
   cy: 402.0
"""


def put(folder: Path, text: str = RIG, **cameras: str) -> Path:
    file = folder / "rig.yaml"
    file.write_text(text)
    for name, content in cameras.items():
        (folder / f"{name}.yaml").write_text(content)
    return file


def test_poses_cameras_and_the_clocks(tmp_path: Path) -> None:
    file = put(tmp_path, left=CAMERA, right=CAMERA.replace("640.5", "655.5"))
    with heard() as notes:
        found = read_any(file)
    assert [found.cameras[f"cam{i}"].parameters["fx"] for i in (0, 1)] == [640.5, 655.5]
    # The optical axis looks along the IMU's x axis, 58 mm between the cameras along the image rows.
    np.testing.assert_allclose(graph(found).T("imu", "cam0") @ [0, 0, 1, 1], [1.02, 0.008, 0.003, 1], atol=1e-12)
    np.testing.assert_allclose(graph(found).T("cam0", "cam1")[:3, 3], [0.058, 0, 0], atol=1e-12)
    assert (found.figures["timeshift cam1"].value, found.figures["timeshift cam1"].unit) == (-0.0125, "s")
    assert any("not used: imu_topic" in note for note in notes)
    assert_same(read_any(tmp_path), found)


def test_the_shift_goes_into_kalibrs_file_with_its_sign(tmp_path: Path) -> None:
    cb.convert(put(tmp_path, left=CAMERA, right=CAMERA), tmp_path / "chain.yaml", to="kalibr")
    assert "timeshift_cam_imu: -0.0125" in (tmp_path / "chain.yaml").read_text()


def test_without_an_imu_and_without_the_camera_files(tmp_path: Path) -> None:
    with heard() as notes:
        found = read_any(put(tmp_path, RIG.replace("imu: 1", "imu: 0").replace("td: -0.0125", "td: 0.0")))
    assert not found.cameras
    assert [(t.parent, t.child) for t in found.transforms] == [("body", "cam0"), ("body", "cam1")]
    assert sum("its place is read alone" in note for note in notes) == 2


def test_there_and_back(tmp_path: Path) -> None:
    before = rig("brown", "kannala_brandt", "unified")
    after = through(before, tmp_path / "vins", "vins")
    assert_same(after, before)
    np.testing.assert_allclose(graph(after).T("imu", "cam2"), graph(before).T("imu", "cam2"), atol=1e-12)
    assert after.figures["timeshift cam0"].value == 0.0125


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("num_of_cam: 2", "num_of_cam: 0", "num_of_cam is 0"),
        ("data: [0., 0., 1., 0.02, -1.", "data: [0., 0., 2., 0.02, -1.", "rotation of body_T_cam1 is none"),
        ("td: -0.0125", "td: [1, 2]", "td holds 2 numbers"),
    ],
)
def test_bad_files_are_refused_by_name(tmp_path: Path, old: str, new: str, words: str) -> None:
    with pytest.raises(InputError, match=rf"rig\.yaml: .*{words}"):
        read_any(put(tmp_path, RIG.replace(old, new), left=CAMERA, right=CAMERA))


def test_a_camera_file_that_is_none_is_named_and_so_are_two_settings(tmp_path: Path) -> None:
    file = put(tmp_path, left=CAMERA.replace("PINHOLE", "CYLINDER"), right=CAMERA)
    with pytest.raises(InputError, match=r"left\.yaml: model_type is 'CYLINDER'"):
        read_any(file)
    (tmp_path / "mono.yaml").write_text(RIG)
    with pytest.raises(InputError, match=r"settings of rigs in this folder: mono\.yaml, rig\.yaml; give the one"):
        read_any(tmp_path)
