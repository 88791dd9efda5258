"""Every registered driver keeps the protocols of `data.devices`: hardware behind fakes, recordings and the cell as is.

A driver without a line in OPENED fails here: give it one when it is registered.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.devices import fake_panda as panda
from tests.devices import fake_realsense as realsense
from tests.devices import fake_ur as ur
from tests.devices.fake_clock import patched_clock
from tests.devices.fake_opencv import FakeCapture
from tests.devices.recorded.made import write_pictures, write_poses

from calibrant.data.devices import CameraSource, DeviceCalibration, GripperState, Picture, Robot, RobotLimits
from calibrant.devices import open_devices, opencv_camera
from calibrant.devices.register import MODULES, Devices, driver_named
from calibrant.errors import CalibrantError, DeviceError, RefusedError
from calibrant.geometry import se3

Opening = Callable[[Path, pytest.MonkeyPatch], str]


def _cell(folder: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    pytest.importorskip("mujoco", reason="the cell is MuJoCo's: pip install 'calibrant[sim]'")
    return "cell:seed=1"


def _folder(folder: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    write_pictures(folder, depth="beside")
    write_poses(folder / "poses.csv")
    return f"folder:{folder}"


def _bag(folder: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    pytest.importorskip("rosbags", reason="bags are read by rosbags: pip install 'calibrant[ros]'")
    from tests.devices.recorded.test_bag import COLOUR, DEPTH, write

    return f"bag:{write(folder, 'mcap')},camera={COLOUR},depth={DEPTH},robot=ur5e"


def _project(folder: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    from tests.devices.recorded.test_project import made

    from calibrant.formats.projects.records import Component

    arm = Component(kind="robot", chain="ur5e", joint_angle="rad")
    return f"project:{made(folder, arm=arm, poses='joints.csv')},camera=hand"


def _opencv(folder: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    capture = FakeCapture(patched_clock(monkeypatch))
    monkeypatch.setattr(opencv_camera, "open_capture", lambda source: capture)
    return "opencv:0"


def _ur(folder: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    ur.installed(monkeypatch, patched_clock(monkeypatch))
    return "ur:192.168.0.10"


def _panda(folder: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    panda.installed(monkeypatch, patched_clock(monkeypatch))
    return "panda:172.16.0.2"


def _realsense(folder: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    patched_clock(monkeypatch)
    realsense.installed(monkeypatch)
    return "realsense:123456"


OPENED: dict[str, Opening] = {
    "cell": _cell,
    "folder": _folder,
    "bag": _bag,
    "project": _project,
    "opencv": _opencv,
    "ur": _ur,
    "panda": _panda,
    "realsense": _realsense,
}
SLOW = {"cell": pytest.mark.long}


def giving(kind: str) -> list[Any]:
    names = [name for name in MODULES if kind in driver_named(name).gives]
    return [pytest.param(name, marks=SLOW[name]) if name in SLOW else name for name in names]


ROBOTS, CAMERAS = giving("robot"), giving("camera")


def opened(name: str, folder: Path, monkeypatch: pytest.MonkeyPatch, *gives: str) -> Devices:
    spec = OPENED[name](folder, monkeypatch)
    return open_devices(**dict.fromkeys(gives, spec))


def lacks(device: object, protocol: type) -> list[str]:
    """What of a protocol a device has not, or with other parameters."""
    found = []
    for member, wanted in vars(protocol).items():
        if member.startswith("_"):
            continue
        if not hasattr(type(device), member) and not hasattr(device, member):
            found.append(member)
        elif callable(wanted):
            given = inspect.signature(getattr(device, member)).parameters
            asked = [p for p in inspect.signature(wanted).parameters.values() if p.name != "self"]
            if [(p.name, p.kind, p.default) for p in given.values()] != [(p.name, p.kind, p.default) for p in asked]:
                found.append(f"{member}{inspect.signature(getattr(device, member))}")
    return found


def test_every_driver_is_looked_at() -> None:
    assert set(OPENED) == set(MODULES)


@pytest.mark.parametrize("name", ROBOTS)
def test_robots_keep_the_protocol(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with opened(name, tmp_path, monkeypatch, "robot") as devices:
        robot = devices.robot
        assert lacks(robot, Robot) == []
        assert isinstance(robot.name, str)
        assert robot.name
        assert isinstance(robot.moves_matter, bool)
        assert robot.moves_matter == (driver_named(name).extra == "devices"), "a person is asked before hardware moves"
        assert isinstance(robot.limits, RobotLimits)
        assert np.isfinite(robot.time_s)
        T = robot.pose()
        assert np.allclose(se3.check(T, name="pose"), T)
        _joints_agree(robot)
        _motions(robot)
        robot.stop()


def _joints_agree(robot: Robot) -> None:
    """Joints lie in their ranges, and the controller's geometry takes them to its pose."""
    try:
        q = robot.joints()
    except RefusedError:
        return  # a recording of poses alone
    limits = robot.limits
    assert limits.joints.shape == (len(q), 2)
    assert limits.speeds.shape == (len(q),)
    assert np.all((q >= limits.joints[:, 0]) & (q <= limits.joints[:, 1]))
    assert np.abs(se3.local(robot.pose(), robot.forward(q))).max() < 1e-6


def _motions(robot: Robot) -> None:
    """A robot moves where it is asked to, or refuses every motion and stays."""
    before = robot.pose()
    up = before.copy()
    up[2, 3] += 0.02
    twist = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.05])
    try:
        robot.move_to(up)
    except RefusedError:
        refused: list[Callable[[], Any]] = [
            lambda: robot.move_line(up),
            lambda: robot.move_joints(np.zeros(6)),
            lambda: robot.drive(twist, seconds=0.1),
            lambda: robot.grip(0.02),
        ]
        for move in refused:
            with pytest.raises(RefusedError):
                move()
        assert np.array_equal(robot.pose(), before)
        return
    assert np.abs(se3.local(robot.pose(), up)).max() < 2e-3
    began = robot.time_s
    robot.drive(twist, seconds=0.2)
    assert robot.time_s == pytest.approx(began + 0.2, abs=0.02)
    assert robot.pose()[2, 3] - up[2, 3] == pytest.approx(0.01, abs=3e-3)
    robot.wait(0.2)
    rest = robot.pose()
    robot.wait(0.2)
    assert np.abs(se3.local(rest, robot.pose())).max() < 1e-4
    robot.move_line(before)
    assert np.abs(se3.local(robot.pose(), before)).max() < 2e-3
    try:
        state = robot.grip(0.03)
    except RefusedError as refusal:
        assert "gripper" in str(refusal)  # noqa: PT017 - an arm without one may say so
    else:
        assert isinstance(state, GripperState)
        assert state.width_m == pytest.approx(0.03, abs=2e-3)


@pytest.mark.parametrize("name", ["ur", "panda"])
def test_stop_never_raises(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    devices = opened(name, tmp_path, monkeypatch, "robot")
    robot: Any = devices.robot

    class Gone:
        def __getattr__(self, member: str) -> Any:
            raise OSError("the cable is cut")

    for held in ("_control", "_receive", "_panda", "_hand"):
        if hasattr(robot, held):
            monkeypatch.setattr(robot, held, Gone())
    robot.stop()
    devices.close()


@pytest.mark.parametrize("name", CAMERAS)
def test_cameras_keep_the_protocol(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    devices = opened(name, tmp_path, monkeypatch, "camera")
    camera = devices.camera
    assert lacks(camera, CameraSource) == []
    assert isinstance(camera.name, str)
    assert camera.name
    assert isinstance(camera.stated, DeviceCalibration)
    first, second = camera.take(), camera.take()
    for picture in (first, second):
        assert isinstance(picture, Picture)
        assert np.isfinite(picture.time_s)
        if picture.depth is not None:
            assert picture.depth.dtype == np.float32
            z = picture.depth[np.isfinite(picture.depth)]
            assert np.all((z > 0) & (z < 20)), "metres"
    assert first.name != second.name
    assert second.time_s > first.time_s
    stated = camera.stated.colour
    assert stated is None or stated.image_size == first.size
    camera.close()
    camera.close()
    with pytest.raises(DeviceError):
        camera.take()
    devices.close()
    devices.close()


@pytest.mark.parametrize("name", MODULES)
def test_what_is_not_there_is_said_by_name(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No driver lets an error of a library pass."""
    if name == "cell":
        spec = "cell:arm=none"
    elif name in ("ur", "panda"):
        OPENED[name](tmp_path, monkeypatch)
        spec = f"{name}:nobody"
    elif name == "realsense":
        fake = realsense.installed(monkeypatch)
        fake.there = False
        spec = name
    else:
        spec = f"{name}:{'99' if name == 'opencv' else tmp_path / 'none'}"
    gives = driver_named(name).gives[-1]
    with pytest.raises(CalibrantError, match=r"none|nobody|No device|99"):
        open_devices(**{gives: spec})
