"""MuJoCo's models: loaded by MuJoCo itself, whose poses, lenses and pictures are those that calibrant has."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import calibrant as cb
from calibrant.data.results import as_transform
from calibrant.errors import InputError
from calibrant.formats.exchange.exchange_format import read_cameras
from calibrant.formats.exchange.places import places_in
from calibrant.geometry import se3, so3

mujoco = pytest.importorskip("mujoco", reason="MuJoCo is in the extra `sim`")
LENS = {"fx": 610.25, "fy": 605.5, "cx": 300.75, "cy": 260.0}
CAMERA = cb.Camera.create("pinhole", LENS, image_size=(640, 480))
PLACES = """<mujoco>
  <compiler angle="radian" eulerseq="zYx"/>
  <default><camera fovy="70" resolution="320 240"/>
    <default class="wide"><camera fovy="100" quat="0 1 0 0"/></default></default>
  <worldbody>
    <!-- a mast -->
    <camera name="fixed" pos="1 2 3" xyaxes="1 1 0 0 1 1"/>
    <body name="mast" pos="0.1 0.2 0.3" euler="0.1 0.2 0.3" childclass="wide">
      <freejoint/>
      <camera name="axis" axisangle="1 2 2 0.7"/>
      <camera name="class"/>
      <frame pos="0 0 1" euler="0.5 0.6 0.7">
        <body name="arm" quat="2 0 0 1" pos="0 1 0">
          <joint type="hinge" ref="0.3"/><geom size="0.1"/>
          <camera name="z" zaxis="0 1 -1" class="main"/>
          <camera name="down" zaxis="0 0 -1"/>
        </body>
      </frame>
      <geom size="0.1"/>
    </body>
  </worldbody>
</mujoco>"""


def loaded(text: str) -> tuple[object, object]:
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def optical_poses(text: str) -> dict[str, np.ndarray]:
    """T_world_optical of every camera as MuJoCo has it at qpos0."""
    model, data = loaded(text)
    flip = np.diag([1.0, -1.0, -1.0])
    return {
        model.cam(i).name: se3.make(data.cam_xmat[i].reshape(3, 3) @ flip, data.cam_xpos[i]) for i in range(model.ncam)
    }


def lens_as_drawn(model: object, data: object, index: int, size: tuple[int, int]) -> tuple[float, float, float, float]:
    """fx, fy, cx, cy of the frustum that MuJoCo draws with: near plane, its middle and half width."""
    scene, camera = mujoco.MjvScene(model, 10), mujoco.MjvCamera()
    camera.type, camera.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, index
    mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, camera, mujoco.mjtCatBit.mjCAT_ALL, scene)
    c, (width, height) = scene.camera[0], size
    fy = height * c.frustum_near / (c.frustum_top - c.frustum_bottom)
    v = height * c.frustum_top / (c.frustum_top - c.frustum_bottom)
    if c.frustum_width == 0:  # as wide as the picture
        return fy, fy, width / 2 - 0.5, v - 0.5
    fx = width * c.frustum_near / (2 * c.frustum_width)
    u = width * (c.frustum_width - c.frustum_center) / (2 * c.frustum_width)
    return fx, fy, u - 0.5, v - 0.5


def test_every_orientation_is_where_mujoco_has_it(tmp_path: Path) -> None:
    file = tmp_path / "scene.xml"
    file.write_text(PLACES)
    found = cb.convert(file)
    expected = optical_poses(PLACES)
    assert set(found.cameras) == set(expected) == {"fixed", "axis", "class", "z", "down"}
    for name, T in places_in(found, "world", tuple(expected)).items():
        np.testing.assert_allclose(T, expected[name], atol=1e-12, err_msg=name)
    model, data = loaded(PLACES)
    for i in range(model.ncam):
        p = found.cameras[model.cam(i).name].parameters
        drawn = lens_as_drawn(model, data, i, (320, 240))
        assert [p[k] for k in ("fx", "fy", "cx", "cy")] == pytest.approx(drawn, rel=1e-5)


@pytest.mark.parametrize(
    "lens",
    [
        'focalpixel="610.25 605.5" principalpixel="18.75 -20.5"',
        'focal="0.0061025 0.006055" principal="0.0001875 -0.000205"',
        'focal="1 1" focalpixel="610.25 605.5" principalpixel="18.75 -20.5"',
    ],
)
def test_lenses_with_a_sensor_are_those_that_mujoco_draws_with(tmp_path: Path, lens: str) -> None:
    camera = f'<camera name="c" resolution="640 480" sensorsize="0.0064 0.0048" {lens}/>'
    text = f"<mujoco><worldbody>{camera}</worldbody></mujoco>"
    file = tmp_path / "c.xml"
    file.write_text(text)
    p = cb.convert(file).camera.parameters
    assert [p[k] for k in LENS] == pytest.approx(list(LENS.values()), rel=1e-12)
    assert [p[k] for k in LENS] == pytest.approx(lens_as_drawn(*loaded(text), 0, (640, 480)), rel=1e-5)


def rig() -> cb.CalibrationResult:
    T_left = se3.make(so3.exp([0.1, -0.2, 0.3]), [0.5, 0.1, 0.2])
    T_right = se3.make(so3.exp([2.1, 0.2, -0.3]), [-0.5, 0.3, 1.2])
    places = (as_transform("base", "left", T_left), as_transform("base", "right", T_right))
    board = as_transform("left", "board", se3.make(so3.exp([0.0, 3.0, 0.0]), [0.0, 0.0, 0.7]))
    return read_cameras({"left": CAMERA, "right": CAMERA}, transforms=(*places, board))


def test_a_rig_is_loaded_by_mujoco_and_read_back(tmp_path: Path) -> None:
    before = rig()
    file = tmp_path / "rig.xml"
    cb.convert(before.write(tmp_path / "rig.json"), file, to="mjcf")
    poses = optical_poses(file.read_text())
    for name in ("left", "right"):
        np.testing.assert_allclose(poses[name], before.transform("base", name).matrix, atol=1e-12)
    after = cb.convert(file)
    for name in ("left", "right"):
        np.testing.assert_allclose(after.transform("base", name).matrix, poses[name], atol=1e-12)
        assert after.cameras[name].parameters == pytest.approx(LENS, rel=1e-12)
    expected = before.transform("base", "left").matrix @ before.transform("left", "board").matrix
    np.testing.assert_allclose(after.transform("base", "board").matrix, expected, atol=1e-12)


def test_a_camera_goes_into_its_parents_body(tmp_path: Path) -> None:
    file = tmp_path / "hand.mjcf.xml"
    cb.convert(rig().write(tmp_path / "rig.json"), file, transform="right:left", choose=["parent=hand", "child=wrist"])
    found = cb.convert(file)
    T = se3.inverse(rig().transform("base", "right").matrix) @ rig().transform("base", "left").matrix
    np.testing.assert_allclose(found.transform("hand", "wrist").matrix, T, atol=1e-12)
    np.testing.assert_allclose(optical_poses(file.read_text())["wrist"], T, atol=1e-12)


RENDER = """
import sys, numpy as np, mujoco
model = mujoco.MjModel.from_xml_path(sys.argv[1])
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
with mujoco.Renderer(model, 480, 640) as renderer:
    renderer.update_scene(data, "left")
    np.save(sys.argv[2], renderer.render())
"""


@pytest.mark.long
def test_rendered_corners_lie_where_the_camera_projects_them(tmp_path: Path) -> None:
    file = tmp_path / "rig.xml"
    cb.convert(rig().write(tmp_path / "rig.json"), file, to="mjcf")
    side, columns, rows = 0.03, 9, 7
    squares = "".join(
        f'<geom type="box" size="{side / 2} {side / 2} 0.0005" pos="{(c - 4) * side} {(r - 3) * side} 0" '
        f'rgba="{(r + c) % 2} {(r + c) % 2} {(r + c) % 2} 1"/>'
        for r in range(rows)
        for c in range(columns)
    )
    plate = '<geom type="box" size="0.2 0.16 0.0003" pos="0 0 -0.0005" rgba="1 1 1 1"/>'
    light = (
        '<visual><headlight ambient="1 1 1" diffuse="0 0 0" specular="0 0 0"/><global offwidth="640" offheight="480"/>'
        '<quality offsamples="8"/></visual><worldbody>'
    )
    text = file.read_text()
    board = next(line for line in text.splitlines() if 'name="board"' in line)
    text = text.replace(board, board.replace("/>", f">{squares}{plate}</body>")).replace("<worldbody>", light)
    file.write_text(text)
    picture = tmp_path / "left.npy"
    said = ""
    for engine in ("egl", "osmesa"):
        environment = {**os.environ, "MUJOCO_GL": engine}
        ran = subprocess.run(
            [sys.executable, "-c", RENDER, str(file), str(picture)], env=environment, capture_output=True, text=True
        )
        said = ran.stderr.strip().splitlines()[-1] if ran.returncode else ""
        if not ran.returncode:
            break
    if said:
        pytest.skip(f"MuJoCo draws nothing here: {said}; apt install libosmesa6 libegl1 libgl1-mesa-dri")
    from calibrant.opencv import cv2

    grey = cv2.cvtColor(np.load(picture), cv2.COLOR_RGB2GRAY)
    seen, corners = cv2.findChessboardCornersSB(grey, (columns - 1, rows - 1))
    assert seen
    T = rig().transform("left", "board").matrix
    # The front faces of the squares: the board's z points to the camera.
    points = np.array(
        [[(c - 3.5) * side, (r - 2.5) * side, 0.0005] for r in range(rows - 1) for c in range(columns - 1)]
    )
    expected = CAMERA.project(se3.apply(T, points))
    found = corners.reshape(-1, 2)
    apart = np.linalg.norm(found[:, None] - expected[None], axis=2)
    assert sorted(apart.argmin(axis=1).tolist()) == list(range(len(points)))
    assert apart.min(axis=1).max() < 0.5
    # A half pixel between corner and middle of the first pixel would show.
    assert np.abs(found.mean(axis=0) - expected.mean(axis=0)).max() < 0.1


BAD = {
    "two.xml": ('<camera quat="1 0 0 0" euler="0 0 0"/>', "expected one orientation"),
    "zero.xml": ('<camera quat="0 0 0 0"/>', "has no direction"),
    "short.xml": ('<camera pos="1 2"/>', "expected 3 finite numbers"),
    "size.xml": ("<camera/>", "image size"),
    "wide.xml": ('<camera resolution="64 48" fovy="180"/>', "between 0 and 180"),
    "flat.xml": ('<camera resolution="64 48" projection="orthographic"/>', "orthographic"),
    "sensor.xml": ('<camera resolution="64 48" sensorsize="1 1"/>', "says no focal length"),
    "class.xml": ('<camera class="none" resolution="64 48"/>', "no default class 'none'"),
    "twice.xml": ('<camera name="a" resolution="6 4"/><camera name="a" resolution="6 4"/>', "two cameras are called"),
    "empty.xml": ("<geom/>", "no camera and no body"),
}


@pytest.mark.parametrize("name", BAD)
def test_what_is_wrong_is_said_with_the_file(tmp_path: Path, name: str) -> None:
    body, words = BAD[name]
    file = tmp_path / name
    file.write_text(f"<mujoco><worldbody>{body}</worldbody></mujoco>")
    with pytest.raises(InputError) as caught:
        cb.convert(file)
    assert words in str(caught.value)
    assert str(caught.value).startswith(str(file))


def test_a_bent_lens_is_refused_with_its_error(tmp_path: Path) -> None:
    bent = cb.Camera.create("brown", {**LENS, "k1": -0.2}, image_size=(640, 480))
    source = read_cameras({"c": bent}).write(tmp_path / "c.json")
    with pytest.raises(InputError, match=r"has no brown camera .* would be off by [\d.]+ px RMS"):
        cb.convert(source, tmp_path / "c.xml", to="mjcf")
    made = cb.convert(source, tmp_path / "c.xml", to="mjcf", approximate=True)
    assert made.check("approximation of c").value > 1
