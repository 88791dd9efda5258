"""The bridge to ROS 2 against a stand-in of rclpy's documented interface; it has not run on a real ROS 2."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.ros.bridge import Bridge
from calibrant.ros.transport import Event, Info, Transform
from calibrant.tasks.live.camera_config import CameraConfig
from calibrant.tasks.live.picture import Picture

STAND_IN = Path(__file__).with_name("stand_in_ros2.py")


def config(folder: Path, **more: object) -> CameraConfig:
    given = {
        "name": "wrist", "ros": 2, "image": "/wrist/image", "base": "base", "tool": "tool0",
        "target": "chessboard:7x6:30mm", "session": folder / "session", "camera_info": "/wrist/camera_info",
        "python": str(folder / "python"),
    }  # fmt: skip
    return CameraConfig(**{**given, **more})  # type: ignore[arg-type]


def heard(bridge: Bridge, count: int) -> list[Event]:
    found: list[Event] = []
    end = time.monotonic() + 10
    while len(found) < count and time.monotonic() < end:
        events: Sequence[Event] | None = bridge.events()
        found += events or []
    return found


@pytest.fixture
def log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "python").write_text(f'#!/bin/sh\nexec "{sys.executable}" "{STAND_IN}" "$@"\n')
    (tmp_path / "python").chmod(0o755)
    monkeypatch.setenv("STAND_IN_LOG", str(tmp_path / "log"))
    return tmp_path / "log"


def test_what_ros_2_says_comes_as_events(tmp_path: Path, log: Path) -> None:
    bridge = Bridge(config(tmp_path, image="/wrist/image/compressed"))
    bridge.close()
    bridge = Bridge(config(tmp_path))
    found = heard(bridge, 4)
    bridge.close()
    (picture,) = (e for e in found if isinstance(e, Picture))
    assert (picture.topic, picture.stamp, picture.frame) == ("/wrist/image", 12.0, "wrist_optical")
    np.testing.assert_array_equal(picture.grey(), [[0, 1, 2, 3], [5, 6, 7, 8]])
    (info,) = (e for e in found if isinstance(e, Info))
    assert (info.data["width"], info.data["k"][2], info.data["distortion_model"]) == (4, 1.5, "plumb_bob")
    moving, static = sorted((e for e in found if isinstance(e, Transform)), key=lambda e: e.static)
    assert (moving.parent, moving.child, moving.stamp, moving.static) == ("base", "tool0", 12.5, False)
    assert (static.parent, static.child, static.static) == ("tool0", "bracket", True)
    np.testing.assert_array_equal(moving.T_parent_child, se3.make(np.eye(3), [0.25, 0, 0]))
    assert bridge.events() is None


def test_what_is_published_reaches_ros_2(tmp_path: Path, log: Path) -> None:
    T = se3.make(so3.exp([0.1, -0.2, 0.3]), [0.01, 0.02, 0.03])
    bridge = Bridge(config(tmp_path))
    bridge.publish_static(Transform("tool0", "wrist_optical", T, 7.25, True))
    bridge.publish_live(Transform("base", "front_live", T, 8.0, False))
    covariance = np.arange(36.0).reshape(6, 6)
    bridge.publish_pose(Transform("base", "front_live", T, 8.5, False), covariance + covariance.T)
    bridge.show(np.zeros((2, 4, 3), np.uint8), frame="wrist_optical", stamp=9.0)
    bridge.close()
    static, live, pose, shown = (json.loads(line) for line in log.read_text().splitlines())
    assert (static["topic"], static["latched"], static["stamp"]) == ("/tf_static", True, [7, 250_000_000])
    assert (live["topic"], live["latched"], live["parent"], live["child"]) == ("/tf", False, "base", "front_live")
    x, y, z, *xyzw = static["place"]
    np.testing.assert_allclose(se3.make(so3.from_quaternion_wxyz([xyzw[3], *xyzw[:3]]), [x, y, z]), T, atol=1e-15)
    assert (pose["topic"], pose["latched"], pose["frame"]) == ("/calibrant/wrist/pose", False, "base")
    np.testing.assert_allclose(pose["place"], static["place"], atol=1e-15)
    told = np.reshape(pose["covariance"], (6, 6))  # x, y, z, then turns about x, y, z
    np.testing.assert_array_equal(told[:3, :3], (covariance + covariance.T)[3:, 3:])
    np.testing.assert_array_equal(told[:3, 3:], (covariance + covariance.T)[3:, :3])
    assert shown == {
        "topic": "/calibrant/wrist/samples", "latched": False, "size": [4, 2, 12], "bytes": 24, "stamp": [9, 0],
    }  # fmt: skip


def test_a_ros_that_ends_is_said(tmp_path: Path, log: Path) -> None:
    bridge = Bridge(config(tmp_path))
    heard(bridge, 4)
    bridge._process.kill()
    with pytest.raises(InputError, match="ROS 2 ended: its process is gone; is it still running"):
        heard(bridge, 1)


def test_a_python_without_ros_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=rf"ROS 2 by {sys.executable}: ModuleNotFoundError: .*rclpy"):
        Bridge(config(tmp_path, python=sys.executable))
    with pytest.raises(InputError, match=r"/no/python cannot be run \(No such file .*name the Python that has ROS"):
        Bridge(config(tmp_path, python="/no/python"))
