"""CamOdoCal's cameras and rigs, OCamCalib's text: equations, rows and columns, what the nearest camera differs by."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from tests.formats.cameras.calibrators.rigs import assert_same, camera, graph, rig, through

import calibrant as cb
from calibrant.errors import InputError
from calibrant.formats.cameras.read import read_camera
from calibrant.formats.documents.document import Document
from calibrant.formats.exchange.exchange_format import ReadOptions, read_cameras
from calibrant.formats.exchange.read import format_of, read_any
from calibrant.reading.notes import heard

MEI = """%YAML:1.0
---
model_type: MEI
camera_name: cam0
image_width: 1280
image_height: 800
mirror_parameters:
   xi: 1.3
distortion_parameters:
   k1: -0.1
   k2: 0.02
   p1: 0.001
   p2: -0.002
projection_parameters:
   gamma1: 1200.0
   gamma2: 1201.0
   u0: 640.0
   v0: 400.0
"""
# An LF-VIO camera (its README).
SCARAMUZZA = """%YAML:1.0
---
model_type: SCARAMUZZA
camera_name: pal
image_width: 1280
image_height: 960
poly_parameters:
   p0: -2.445239e+02
   p1: 0.000000e+00
   p2: 1.748610e-03
   p3: -1.757770e-06
   p4: 4.475965e-09
affine_parameters:
   ac: 1.001
   ad: 0.0004
   ae: 0.0003
   cx: 645.107791
   cy: 486.025172
"""
# As rpg's OCam example gives the toolbox's output.
OCAM = """#polynomial coefficients for the DIRECT mapping function (ocam_model.ss in MATLAB).

5 -2.065170e+02 0.000000e+00 2.207161e-03 -4.879622e-06 1.865656e-08

#polynomial coefficients for the inverse mapping function (ocam_model.invpol in MATLAB)

12 294.182260 152.289570 -12.191217 27.959546 8.241525 -1.970397 10.689256 1.871609 -6.437684 0.430037 3.21 0.92

#center: "row" and "column", starting from 0 (C convention)

241.800066 394.552874

#affine parameters "c", "d", "e"

1.000330 0.000219 0.000257

#image size: "height" and "width"

480 752

"""


def put(tmp_path: Path, text: str, name: str = "cam.yaml") -> Path:
    file = tmp_path / name
    file.write_text(text)
    return file


def said_px(notes: list[str]) -> float:
    """What a note says that the camera is off by at most."""
    (told,) = (note for note in notes if "is read as the nearest" in note)
    return float(told.split(" px at most")[0].rsplit(" ", 1)[1])


def test_mei_by_its_equations(tmp_path: Path) -> None:
    X = np.array([0.6, -0.4, 0.5])
    x, y = X[:2] / (X[2] + 1.3 * np.linalg.norm(X))
    r2 = x * x + y * y
    radial = 1 - 0.1 * r2 + 0.02 * r2 * r2
    u = x * radial + 2 * 0.001 * x * y - 0.002 * (r2 + 2 * x * x)
    v = y * radial - 2 * 0.002 * x * y + 0.001 * (r2 + 2 * y * y)
    at = read_any(put(tmp_path, MEI)).camera.project(X)
    np.testing.assert_allclose(at, [1200 * u + 640, 1201 * v + 400], atol=1e-9)


@pytest.mark.parametrize("models", [("brown", "unified"), ("kannala_brandt", "rational")])
def test_a_rig_there_and_back(tmp_path: Path, models: tuple[str, ...]) -> None:
    before = rig(*models, imu=False)
    after = through(before, tmp_path / "rig", "camodocal")
    assert_same(after, before)
    assert (tmp_path / "rig" / "cam1_calib.yaml").exists()


def test_one_camera_there_and_back_and_vins_place_on_the_imu(tmp_path: Path) -> None:
    before = rig("kannala_brandt", imu=False)
    file = tmp_path / "cam.yaml"
    assert_same(through(before, file, "camodocal"), before)
    R = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    matrices = (("extrinsicRotation", 3, R), ("extrinsicTranslation", 1, np.array([0.1, 0.2, 0.3])))
    text = file.read_text() + "".join(
        f"{key}: !!opencv-matrix\n   rows: 3\n   cols: {cols}\n   dt: d\n   data: {M.ravel().tolist()}\n"
        for key, cols, M in matrices
    )
    T = read_any(put(tmp_path, text)).transform("imu", "cam0").matrix
    np.testing.assert_allclose(T, [[0, -1, 0, 0.1], [1, 0, 0, 0.2], [0, 0, 1, 0.3], [0, 0, 0, 1]], atol=1e-12)


def test_a_stereo_folder(tmp_path: Path) -> None:
    for side in ("left", "right"):
        put(tmp_path, MEI, f"camera_{side}.yaml")
    keys = zip(("q_x", "q_y", "q_z", "q_w", "t_x", "t_y", "t_z"), (0, 0, np.sin(0.1), np.cos(0.1), -0.12, 0.001, 0.002))
    put(tmp_path, "%YAML:1.0\n---\ntransform:\n" + "".join(f"   {k}: {v}\n" for k, v in keys), "extrinsics.yaml")
    T = graph(read_any(tmp_path)).T("camera_right", "camera_left")
    np.testing.assert_allclose(T[:3, 3], [-0.12, 0.001, 0.002], atol=1e-12)
    np.testing.assert_allclose(T[:2, 0], [np.cos(0.2), np.sin(0.2)], atol=1e-12)


def test_scaramuzza_is_read_as_the_nearest_within_what_is_said(tmp_path: Path) -> None:
    with heard() as notes:
        camera = read_any(put(tmp_path, SCARAMUZZA), ReadOptions(answers={"approximate": "yes"})).camera
    most = said_px(notes)
    assert 0 < most < 0.5
    # forward by hand: a pixel's ray from its polynomial; x right, y down, ahead where the middle looks
    uv = np.array([[645.0, 200.0], [300.0, 486.0], [900.0, 700.0]])
    xy = np.linalg.solve([[1.001, 0.0004], [0.0003, 1.0]], (uv - [645.107791, 486.025172]).T).T
    rho = np.hypot(*xy.T)
    z = -(-244.5239 + 1.748610e-3 * rho**2 - 1.757770e-6 * rho**3 + 4.475965e-9 * rho**4)
    at = camera.project(np.column_stack([xy, z]))
    assert np.linalg.norm(at - uv, axis=1).max() <= most


def test_ocam_counts_rows_before_columns(tmp_path: Path) -> None:
    with heard() as notes:
        found = read_any(put(tmp_path, OCAM, "calib_results.txt"), ReadOptions(answers={"approximate": "yes"}))
    camera, most = found.cameras["calib_results"], said_px(notes)
    assert (camera.image_size, 0 < most < 0.5) == ((752, 480), True)
    # cam2world of the toolbox, in its axes: x down the rows, y along the columns, z towards the viewer
    row, column = np.array([100.0, 241.8, 400.0]), np.array([600.0, 100.0, 300.0])
    A = np.array([[1.000330, 0.000219], [0.000257, 1.0]])
    x, y = np.linalg.solve(A, [row - 241.800066, column - 394.552874])
    rho = np.hypot(x, y)
    z = -206.5170 + 2.207161e-3 * rho**2 - 4.879622e-6 * rho**3 + 1.865656e-8 * rho**4
    at = camera.project(np.column_stack([y, x, -z]))
    assert np.linalg.norm(at - np.column_stack([column, row]), axis=1).max() <= most


@pytest.mark.long
def test_ocam_whose_affine_terms_turn_the_image(tmp_path: Path) -> None:
    """As real files have it, by a degree: the lens is read as near as one that is not turned, the frame turned."""
    turn = np.radians(0.8)
    c, d, e = np.cos(turn), -np.sin(turn), np.sin(turn)
    text = OCAM.replace("1.000330 0.000219 0.000257", f"{c} {d} {e}")
    with heard() as notes:
        turned = read_any(put(tmp_path, text, "t.txt"), ReadOptions(answers={"approximate": "yes"})).camera
    assert said_px(notes) < 0.5
    assert any("turn the image by -0.8 deg" in note for note in notes)
    # cam2world of the toolbox, in its axes, then turned about the axis as was said.
    row, column = np.array([100.0, 400.0]), np.array([600.0, 300.0])
    x, y = np.linalg.solve([[c, d], [e, 1.0]], [row - 241.800066, column - 394.552874])
    rho = np.hypot(x, y)
    z = -206.5170 + 2.207161e-3 * rho**2 - 4.879622e-6 * rho**3 + 1.865656e-8 * rho**4
    phi = np.radians(-0.8)
    ours = [np.cos(phi) * y - np.sin(phi) * x, np.sin(phi) * y + np.cos(phi) * x, -z]
    assert np.linalg.norm(turned.project(np.column_stack(ours)) - np.column_stack([column, row]), axis=1).max() < 0.5


@pytest.mark.parametrize("model", ["pinhole", "kannala_brandt", "double_sphere", "extended_unified"])
def test_ocam_is_written_so_that_its_own_equations_give_the_cameras_pixels(tmp_path: Path, model: str) -> None:
    before = camera(model)
    source, target = tmp_path / "camera.json", tmp_path / "calib_results.txt"
    read_cameras({"camera": before}).write(source)
    cb.convert(source, target, to="ocam")
    lines = [line for line in target.read_text().splitlines() if line and not line.startswith("#")]
    a, b, centre, (c, d, e), size = (np.array([float(v) for v in line.split()]) for line in lines)
    assert (a[0], b[0], a[2], tuple(size)) == (len(a) - 1, len(b) - 1, 0, (800, 1280))
    # world2cam of the toolbox: x down the rows, y along the columns, z towards the viewer.
    rays = np.array([[0.3, -0.2, 1.0], [-0.6, 0.4, 1.0], [0.01, 0.02, 1.0], [0.0, 0.5, 1.0]])
    x, y, z = rays[:, 1], rays[:, 0], -rays[:, 2]
    rho = np.polynomial.Polynomial(b[1:])(np.arctan2(z, np.hypot(x, y)))
    x, y = rho * x / np.hypot(x, y), rho * y / np.hypot(x, y)
    pixels = np.column_stack([x * e + y + centre[1], x * c + y * d + centre[0]])
    np.testing.assert_allclose(pixels, before.project(rays), atol=0.02)
    # cam2world: pixels back to rays.
    x, y = np.linalg.solve([[c, d], [e, 1.0]], [pixels[:, 1] - centre[0], pixels[:, 0] - centre[1]])
    back = np.column_stack([y, x, -np.polynomial.Polynomial(a[1:])(np.hypot(x, y))])
    np.testing.assert_allclose(before.project(back), pixels, atol=0.02)


def test_ocam_has_no_words_for_decentering_and_says_by_how_much(tmp_path: Path) -> None:
    source, target = tmp_path / "camera.json", tmp_path / "calib_results.txt"
    read_cameras({"camera": camera("brown")}).write(source)
    with pytest.raises(InputError, match=r"the nearest would be off by 3\.\d+ px RMS.*approximate"):
        cb.convert(source, target, to="ocam")
    cb.convert(source, target, to="ocam", approximate=True)
    assert format_of(Document(target)).name == "ocam"


def test_an_option_that_names_a_camera_says_the_command_that_takes_the_answer(tmp_path: Path) -> None:
    file = put(tmp_path, OCAM, "calib_results.txt")
    command = rf"calibrant convert {re.escape(str(file))} camera\.json --answer approximate=yes; then give camera\.json"
    with pytest.raises(InputError, match=command):
        read_camera(file)
    cb.convert(file, tmp_path / "camera.json", answer=("approximate=yes",))
    assert read_camera(tmp_path / "camera.json").image_size == (752, 480)


def test_ocam_without_comments_and_a_model_that_was_asked_for(tmp_path: Path) -> None:
    bare = "\n".join(line for line in OCAM.splitlines() if line and not line.startswith("#"))
    options = ReadOptions(answers={"model": "unified"})
    assert read_any(put(tmp_path, bare, "c.txt"), options).camera.model.name == "unified"


@pytest.mark.parametrize(
    ("text", "old", "new", "words"),
    [
        (MEI, "model_type: MEI", "model_type: EUCM", "model_type is 'EUCM', expected one of PINHOLE"),
        (MEI, "   k2: 0.02\n", "", "k2 holds 0 numbers"),
        (MEI, "   k2: 0.02\n", "   k2: 0.02\n   k9: 0.1\n", "k9 is no parameter of MEI"),
        (MEI, "image_width: 1280", "image_width: 12.5", "expected two whole numbers"),
        (MEI, "mirror_parameters:\n   xi: 1.3", "mirror_parameters: 3", "expected numbers by name"),
        (SCARAMUZZA, "ac: 1.001", "ac: 0.0", "affine terms"),
        (SCARAMUZZA, "image_width: 1280\nimage_height: 960\n", "", "say --image-size"),
        (OCAM, "5 -2.065", "7 -2.065", "expected the polynomial after its count"),
        (OCAM, "241.800066 394.552874", "241.8 3945.5", "lies outside of 752x480 px"),
        (OCAM, "480 752", "480.5 752", "expected two whole numbers"),
        (OCAM, "5 -2.065170e+02", "5 nan", "not finite"),
    ],
)
def test_bad_files_are_refused_by_name(tmp_path: Path, text: str, old: str, new: str, words: str) -> None:
    with pytest.raises(InputError, match=rf"cam\.yaml: .*{words}"):
        read_any(put(tmp_path, text.replace(old, new)))


def test_poses_of_a_left_handed_frame_and_folders_that_lack_a_file_are_refused(tmp_path: Path) -> None:
    put(tmp_path, SCARAMUZZA, "pal_calib.yaml")
    put(tmp_path, "pal\n1 0 0 0\n0 1 0 0\n0 0 1 0\n", "extrinsic.txt")
    with pytest.raises(InputError, match="left-handed frame"):
        read_any(tmp_path)
    put(tmp_path, "../other\n1 0 0 0\n0 1 0 0\n0 0 1 0\n", "extrinsic.txt")
    with pytest.raises(InputError, match=r"names the camera '../other', and there is no"):
        read_any(tmp_path)
