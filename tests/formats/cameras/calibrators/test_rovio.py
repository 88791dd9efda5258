"""ROVIO's settings: cameras on the IMU, quaternions of both kinds, a field-of-view lens."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.formats.cameras.calibrators.rigs import assert_same, graph, rig, through

from calibrant.errors import InputError
from calibrant.formats.exchange.exchange_format import ReadOptions
from calibrant.formats.exchange.read import read_any
from calibrant.reading.notes import heard

# Of ROVIO's cfg/rovio.info.
INFO = """; You can partially override parameter set in this file by creating your own subset
Common
{
	doVECalibration true;	Should the camera-IMU extrinsics be calibrated online
}
Camera0
{
	CalibrationFile  ;	Camera-Calibration file for intrinsics
	qCM_x  0.00666398307551;	X-entry of IMU to Camera quaterion (Hamilton)
	qCM_y  -0.0079168224269;	Y-entry of IMU to Camera quaterion (Hamilton)
	qCM_z  -0.701985972528;	Z-entry of IMU to Camera quaterion (Hamilton)
	qCM_w  0.712115587266;	W-entry of IMU to Camera quaterion (Hamilton)
	MrMC_x -0.0111674199187;	X-entry of IMU to Camera vector (expressed in IMU CF) [m]
	MrMC_y -0.0574640920022;	Y-entry of IMU to Camera vector (expressed in IMU CF) [m]
	MrMC_z 0.0207586947896;	Z-entry of IMU to Camera vector (expressed in IMU CF) [m]
}
"""
Q = np.array([0.00666398307551, -0.0079168224269, -0.701985972528, 0.712115587266])
FOV = """image_width: 752
image_height: 480
camera_name: cam0
camera_matrix:
  rows: 3
  cols: 3
  data: [300.0, 0.0, 370.0, 0.0, 301.0, 240.0, 0.0, 0.0, 1.0]
distortion_model: fov
distortion_coefficients:
  rows: 1
  cols: 1
  data: [0.93]
"""


def put(tmp_path: Path, text: str, name: str = "rovio.info") -> Path:
    file = tmp_path / name
    file.write_text(text)
    return file


def test_the_camera_is_where_its_vector_says_and_turned_as_its_quaternion_does(tmp_path: Path) -> None:
    with heard() as notes:
        found = read_any(put(tmp_path, INFO))
    assert any("its place is read alone" in note for note in notes)
    T = graph(found).T("cam0", "imu")
    t = np.array([-0.0111674199187, -0.0574640920022, 0.0207586947896])
    np.testing.assert_allclose(T[:3, :3] @ t + T[:3, 3], 0, atol=1e-12)
    X = np.array([0.4, -0.2, 1.3])
    d = X - t
    turned = d + 2 * np.cross(Q[:3], np.cross(Q[:3], d) + Q[3] * d)
    np.testing.assert_allclose(T[:3, :3] @ X + T[:3, 3], turned, atol=1e-9)


def test_jpls_quaternion_is_the_conjugate_and_silence_is_asked(tmp_path: Path) -> None:
    hamilton = read_any(put(tmp_path, INFO)).transforms[0].matrix
    jpl = read_any(put(tmp_path, INFO.replace("Hamilton", "JPL"))).transforms[0].matrix
    np.testing.assert_allclose(jpl[:3, :3], hamilton[:3, :3].T, atol=1e-9)
    np.testing.assert_allclose(jpl[:3, 3], hamilton[:3, 3], atol=1e-12)
    silent = put(tmp_path, INFO.replace("(Hamilton)", ""))
    with pytest.raises(InputError, match=r"rovio\.info: cam0: whether qCM is .* --answer quaternion=hamilton"):
        read_any(silent)
    told = read_any(silent, ReadOptions(answers={"quaternion": "hamilton"})).transforms[0].matrix
    np.testing.assert_allclose(told, hamilton, atol=1e-12)


def test_there_and_back(tmp_path: Path) -> None:
    before = rig("pinhole", "kannala_brandt", "brown")
    target = tmp_path / "rovio"
    after = through(before, target, "rovio")
    assert_same(after, before)
    np.testing.assert_allclose(graph(after).T("imu", "cam1"), graph(before).T("imu", "cam1"), atol=1e-12)


def test_a_field_of_view_lens(tmp_path: Path) -> None:
    with heard() as notes:
        camera = read_any(put(tmp_path, FOV, "cam0.yaml"), ReadOptions(answers={"approximate": "yes"})).cameras["cam0"]
    assert any("a fov lens is read as the nearest" in note for note in notes)
    r = np.hypot(0.3, 0.2)
    rd = np.arctan(2 * r * np.tan(0.93 / 2)) / 0.93
    by_hand = [300 * rd / r * 0.3 + 370, 301 * rd / r * 0.2 + 240]
    np.testing.assert_allclose(camera.project(np.array([0.3, 0.2, 1.0])), by_hand, atol=0.05)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("qCM_w  0.712115587266", "qCM_w  0.9", "the quaternion of cam0.qCM .* expected length 1"),
        ("MrMC_z 0.0207586947896;", "", "cam0 has no MrMC_z"),
        ("MrMC_z 0.0207586947896", "MrMC_z up", "cam0.MrMC_z is 'up'"),
    ],
)
def test_bad_files_are_refused_by_name(tmp_path: Path, old: str, new: str, words: str) -> None:
    with pytest.raises(InputError, match=rf"rovio\.info: .*{words}"):
        read_any(put(tmp_path, INFO.replace(old, new)))
