"""Specs, and robot and camera opened together."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from tests.devices.recorded.made import write_pictures, write_poses

from calibrant.devices import open_devices
from calibrant.devices.register import MODULES, drivers, parse_spec
from calibrant.devices.spec import split_spec
from calibrant.errors import InputError, MissingExtraError


@pytest.mark.parametrize(
    ("text", "driver", "place", "options"),
    [
        ("cell", "cell", "", {}),
        ("cell:seed=3,arm=ur5e", "cell", "", {"seed": "3", "arm": "ur5e"}),
        ("folder:runs/1,2", "folder", "runs/1,2", {}),
        ("folder:C:\\runs,poses=p.csv", "folder", "C:\\runs", {"poses": "p.csv"}),
        ("opencv:0", "opencv", "0", {}),
        ("opencv:rtsp://host:554/a,fps=5", "opencv", "rtsp://host:554/a", {"fps": "5"}),
        ("ur:192.168.0.10", "ur", "192.168.0.10", {}),
        ("realsense", "realsense", "", {}),
        ("bag:run,camera=/a,tf=base:tool", "bag", "run", {"camera": "/a", "tf": "base:tool"}),
    ],
)
def test_parts_of_a_spec(text: str, driver: str, place: str, options: dict[str, str]) -> None:
    spec = split_spec(text)
    assert (spec.driver, spec.place, dict(spec.options)) == (driver, place, options)
    assert parse_spec(text) == spec


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "names no device"),
        (":0", "names no device"),
        ("webcam:0", "begins with a driver's name: cell, folder"),
        ("cell:sead=3", "no option 'sead'; its options: seed, arm"),
        ("cell:seed=3,seed=4", "seed is given twice"),
        ("ur:host,speed=3", "no option 'speed'"),
    ],
)
def test_what_a_spec_cannot_be(text: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        parse_spec(text)


def test_camera_is_no_robot() -> None:
    with pytest.raises(InputError, match=r"opencv is no robot, it is a camera .*drivers of a robot: cell"):
        open_devices(robot="opencv:0")
    with pytest.raises(InputError, match="ur is no camera"):
        open_devices(camera="ur:192.168.0.10")


def test_every_driver_is_described() -> None:
    found = list(drivers())
    assert [d.name for d in found] == list(MODULES)
    for driver in found:
        assert driver.form.startswith(driver.name)
        assert set(driver.gives) <= {"robot", "camera"}
        assert "untested on hardware" in driver.tested or driver.extra != "devices"


def test_robot_and_camera_of_one_place_are_one_recording(tmp_path: Path) -> None:
    write_pictures(tmp_path)
    write_poses(tmp_path / "poses.csv")
    spec = f"folder:{tmp_path}"
    devices = open_devices(robot=spec, camera=f"{spec},images=*.png")
    first = devices.robot.pose()
    devices.camera.take()
    devices.camera.take()
    assert not np.allclose(devices.robot.pose(), first)
    with pytest.raises(InputError, match=r"say images=0\*\.png and images=\*\.png"):
        open_devices(robot=f"{spec},images=0*.png", camera=f"{spec},images=*.png")


def test_what_was_not_opened_is_said(tmp_path: Path) -> None:
    write_pictures(tmp_path)
    devices = open_devices(camera=f"folder:{tmp_path}")
    with pytest.raises(InputError, match="no robot was opened"):
        _ = devices.robot
    with pytest.raises(InputError, match="no camera was opened"):
        _ = open_devices().camera


@pytest.mark.parametrize(
    ("which", "spec", "module", "package"),
    [
        ("robot", "ur:192.168.0.10", "rtde_receive", "ur-rtde"),
        ("robot", "panda:172.16.0.2", "panda_py", "panda-python"),
        ("camera", "realsense", "pyrealsense2", "pyrealsense2"),
    ],
)
def test_missing_library_names_the_extra(
    monkeypatch: pytest.MonkeyPatch, which: str, spec: str, module: str, package: str
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(MissingExtraError, match=rf"{package}.*calibrant\[devices\]"):
        open_devices(**{which: spec})
