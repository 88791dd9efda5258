"""Bags play as camera and robot."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.devices.recorded.made import COUNT, JOINTS, POSES, grey
from tests.made_bags import EPOCH_NS, written_bag

from calibrant.devices import open_devices
from calibrant.errors import DeviceError, InputError
from calibrant.geometry import se3
from calibrant.robots.arms import arm

COLOUR, DEPTH, INFO = "/camera/color/image_raw", "/camera/depth/image_rect_raw", "/camera/color/camera_info"
K = np.array([[60.0, 0, 31.5], [0, 60.0, 23.5], [0, 0, 1]])
LATE = 0.25
"""Pictures are stamped by so much before the robot's clock says it."""


def write(folder: Path, kind: str, *, depth: bool = True) -> Path:
    """Pictures at 0, 1, 2 … s, the robot between its poses all the while; depth 10 ms later, none for the last."""
    with written_bag(folder, kind) as (path, bag):
        bag.camera_info(INFO, K, [0.0] * 5, (64, 48), 0.0)
        chain = arm("ur5e")
        for k in range(COUNT):
            bag.image(COLOUR, np.full((48, 64, 3), grey(k), np.uint8), float(k), "rgb8")
            if depth and k < COUNT - 1:
                z = np.full((24, 32), 500 + k, np.uint16)
                z[0, 0] = 0
                bag.image(DEPTH, z, k + 0.01, "16UC1")
            for s in (0.0, 0.25, 0.5, 0.75):
                q = JOINTS[k] + s * (JOINTS[min(k + 1, COUNT - 1)] - JOINTS[k])
                bag.joints("/joint_states", dict(zip((j.name for j in chain.joints), q)), k + s + 0.001)
            bag.transforms("/tf", {("base_link", "tool0"): POSES[k]}, k + 0.002, stamp=float(k))
    return path


@pytest.mark.parametrize("kind", ["ros1", "mcap"])
def test_pictures_play_and_the_robot_is_where_it_was(tmp_path: Path, kind: str) -> None:
    path = write(tmp_path, kind)
    spec = f"bag:{path},camera={COLOUR},depth={DEPTH},info={INFO},tf=base_link:tool0"
    with open_devices(robot=spec, camera=spec) as devices:
        stated = devices.camera.stated.colour
        assert stated is not None
        assert stated.parameters["cx"] == 31.5
        for k in range(COUNT):
            picture = devices.camera.take()
            assert int(picture.colour[0, 0, 0]) == grey(k)
            assert picture.time_s == pytest.approx(1e-9 * EPOCH_NS + k, abs=1e-6)
            assert np.allclose(devices.robot.pose(), POSES[k], atol=1e-9)
            if k < COUNT - 1:
                assert picture.depth is not None
                assert np.isnan(picture.depth[0, 0])
                assert picture.depth[1, 1] == pytest.approx(0.5 + 1e-3 * k)
            else:
                assert picture.depth is None, "no depth picture is near in time"
        with pytest.raises(DeviceError, match="has ended"):
            devices.camera.take()


def test_joint_values_of_a_named_robot_and_the_clocks_offset(tmp_path: Path) -> None:
    path = write(tmp_path, "mcap", depth=False)
    spec = f"bag:{path},robot=ur5e,clock-offset=251ms"
    devices = open_devices(robot=spec, camera=spec)
    devices.camera.take()
    devices.camera.take()
    q = JOINTS[1] + 0.25 * (JOINTS[2] - JOINTS[1])
    assert np.allclose(devices.robot.joints(), q, atol=1e-6)
    assert np.abs(se3.local(devices.robot.pose(), arm("ur5e").forward(q))).max() < 1e-6
    with pytest.raises(InputError, match="37ms"):
        open_devices(robot=f"bag:{path},robot=ur5e,clock-offset=251")


def test_what_is_not_there_is_said(tmp_path: Path) -> None:
    path = write(tmp_path, "mcap")
    with pytest.raises(InputError, match=r"several topics: .*camera=TOPIC"):
        open_devices(camera=f"bag:{path}")
    with pytest.raises(InputError, match="no pictures under /other"):
        open_devices(camera=f"bag:{path},camera=/other")
    with pytest.raises(InputError, match="no pictures under /other"):
        open_devices(camera=f"bag:{path},camera={COLOUR},depth=/other")
    with pytest.raises(InputError, match="is no depth"):
        open_devices(camera=f"bag:{path},camera={DEPTH},depth={COLOUR}").camera.take()
    with pytest.raises(InputError, match="BASE:TOOL"):
        open_devices(robot=f"bag:{path},camera={COLOUR},tf=tool0")
    with pytest.raises(InputError, match="no frame 'flange'"):
        open_devices(robot=f"bag:{path},camera={COLOUR},tf=base_link:flange")
    with pytest.raises(InputError, match="bag"):
        open_devices(camera=f"bag:{tmp_path / 'none.mcap'}")
