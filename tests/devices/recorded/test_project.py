"""Observations of a project play as camera and robot."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.devices.recorded.made import COUNT, JOINTS, POSES, grey, write_joints, write_pictures, write_poses

from calibrant.devices import open_devices
from calibrant.errors import InputError
from calibrant.formats.projects.folder import create
from calibrant.formats.projects.records import Component, Notation, Project, Recording, Seen

CAMERA, TARGET = Component(kind="camera"), Component(kind="target", spec="chessboard:9x6:25mm")


def made(tmp_path: Path, *, arm: Component, poses: str, notation: Notation = Notation()) -> Path:  # noqa: B008 - frozen
    write_pictures(tmp_path / "photos")
    write_poses(tmp_path / "poses.csv")
    write_joints(tmp_path / "joints.csv")
    hand = Seen(
        camera="left", target="board", setup="eye-in-hand", robot="arm", images=("photos/*.png",), poses=(poses,),
        notation=notation,
    )  # fmt: skip
    lying = Seen(camera="left", target="board", images=("photos/*.png",))
    parts = {"left": CAMERA, "board": TARGET, "arm": arm}
    create(tmp_path, Project(components=parts, observations={"hand": hand, "lying": lying}), command="")
    return tmp_path


def test_observations_play(tmp_path: Path) -> None:
    folder = made(tmp_path, arm=Component(kind="robot"), poses="poses.csv")
    devices = open_devices(robot=f"project:{folder},camera=hand", camera=f"project:{folder}")
    for k in range(COUNT):
        assert int(devices.camera.take().colour[0, 0, 0]) == grey(k)
        assert np.allclose(devices.robot.pose(), POSES[k], atol=1e-12)
    assert devices.camera.name == "left"


def test_joint_values_of_the_projects_robot(tmp_path: Path) -> None:
    folder = made(tmp_path, arm=Component(kind="robot", chain="ur5e", joint_angle="rad"), poses="joints.csv")
    robot = open_devices(robot=f"project:{folder},camera=hand").robot
    assert np.allclose(robot.joints(), JOINTS[0], atol=1e-12)
    assert np.allclose(robot.forward(JOINTS[2]), POSES[2], atol=1e-12)


def test_recording_of_a_project(tmp_path: Path) -> None:
    from tests.devices.recorded.test_bag import COLOUR, write

    path = write(tmp_path, "mcap", depth=False)
    told = Recording(bag=path.name, topic=COLOUR, tf="base_link:tool0")
    seen = Seen(camera="left", target="board", setup="eye-in-hand", robot="arm", recording=told)
    parts = {"left": CAMERA, "board": TARGET, "arm": Component(kind="robot")}
    create(tmp_path, Project(components=parts, observations={"hand": seen}), command="")
    devices = open_devices(robot=f"project:{tmp_path}", camera=f"project:{tmp_path}")
    devices.camera.take()
    devices.camera.take()
    assert np.allclose(devices.robot.pose(), POSES[1], atol=1e-9)


def test_bad_input(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no project"):
        open_devices(camera=f"project:{tmp_path}")
    folder = made(tmp_path, arm=Component(kind="robot"), poses="poses.csv")
    with pytest.raises(InputError, match="hand, lying"):
        open_devices(camera=f"project:{folder}")
    with pytest.raises(InputError, match="no observations 'other'"):
        open_devices(camera=f"project:{folder},camera=other")
    with pytest.raises(InputError, match="no robot poses"):
        open_devices(robot=f"project:{folder},camera=lying")
