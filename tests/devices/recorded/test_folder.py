"""A folder plays as camera and robot."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.devices.recorded.made import COUNT, JOINTS, POSES, grey, write_joints, write_pictures, write_poses

import calibrant as cb
from calibrant.devices import open_devices
from calibrant.errors import DeviceError, InputError, RefusedError
from calibrant.formats.cameras.ros.camera_info import write_camera_info
from calibrant.robots.arms import arm


def test_pictures_play_and_the_robot_is_where_it_was(tmp_path: Path) -> None:
    write_pictures(tmp_path)
    write_poses(tmp_path / "poses.csv", times=True)
    with open_devices(robot=f"folder:{tmp_path}", camera=f"folder:{tmp_path}") as devices:
        camera, robot = devices.camera, devices.robot
        assert not robot.moves_matter
        assert np.allclose(robot.pose(), POSES[0], atol=1e-12), "before the first picture: where it was at it"
        for k in range(COUNT):
            picture = camera.take()
            assert (picture.name, int(picture.colour[0, 0, 0])) == (f"{k:02d}.png", grey(k))
            assert picture.depth is None
            assert picture.time_s == robot.time_s == 10 + 0.5 * k
            assert np.allclose(robot.pose(), POSES[k], atol=1e-12)
        with pytest.raises(DeviceError, match="all 4 pictures"):
            camera.take()
    with pytest.raises(DeviceError, match="closed"):
        camera.take()


def test_recorded_robot_refuses_to_move(tmp_path: Path) -> None:
    write_pictures(tmp_path)
    write_poses(tmp_path / "poses.csv")
    robot = open_devices(robot=f"folder:{tmp_path}").robot
    for move in (
        lambda: robot.move_joints(JOINTS[0]),
        lambda: robot.move_to(POSES[1]),
        lambda: robot.move_line(POSES[1]),
        lambda: robot.drive(np.zeros(6), seconds=0.1),
        lambda: robot.grip(0.02),
    ):
        with pytest.raises(RefusedError, match="plays what was recorded"):
            move()
    robot.wait(1e9)
    robot.stop()
    with pytest.raises(RefusedError, match="no joint values"):
        robot.joints()
    with pytest.raises(RefusedError, match="robot=ur5e"):
        robot.forward(JOINTS[0])
    assert robot.limits.joints.shape == (0, 2)


@pytest.mark.parametrize("depth", ["beside", "array", "folder"])
def test_depth_beside_the_pictures(tmp_path: Path, depth: str) -> None:
    write_pictures(tmp_path, depth=depth)
    camera = open_devices(camera=f"folder:{tmp_path}").camera
    for k in range(COUNT):
        z = camera.take().depth
        assert z is not None
        assert z.dtype == np.float32
        assert np.isnan(z[0, 0])
        assert z[1, 1] == pytest.approx(0.5 + 1e-3 * k, abs=1e-7)
    with pytest.raises(DeviceError, match="has ended"):
        camera.take()


def test_unit_of_depth_can_be_said(tmp_path: Path) -> None:
    """The cell's recordings keep depth in 0.1 mm."""
    write_pictures(tmp_path, depth="beside")
    z = open_devices(camera=f"folder:{tmp_path},depth-unit=0.1mm").camera.take().depth
    assert z is not None
    assert z[1, 1] == pytest.approx(0.05)


def test_joint_values_of_a_named_robot(tmp_path: Path) -> None:
    write_pictures(tmp_path)
    write_joints(tmp_path / "measured.csv")
    devices = open_devices(
        robot=f"folder:{tmp_path},poses=measured.csv,robot=ur5e,joint-angle=rad", camera=f"folder:{tmp_path}"
    )
    devices.camera.take()
    devices.camera.take()
    assert np.allclose(devices.robot.joints(), JOINTS[1], atol=1e-12)
    assert np.allclose(devices.robot.pose(), POSES[1], atol=1e-12)
    assert np.allclose(devices.robot.forward(JOINTS[3]), POSES[3], atol=1e-12)
    assert np.array_equal(devices.robot.limits.joints[:, 1], arm("ur5e").upper)
    assert not devices.robot.limits.speeds.any()


def test_pictures_without_a_pose_are_left_out_and_order_pairs_the_rest(tmp_path: Path) -> None:
    write_pictures(tmp_path)
    write_poses(tmp_path / "poses.csv", names=False)
    devices = open_devices(robot=f"folder:{tmp_path},images=*.png", camera=f"folder:{tmp_path}")
    seen = [(devices.camera.take().name, devices.robot.pose()) for _ in range(COUNT)]
    assert all(np.allclose(T, POSES[int(name[:2])]) for name, T in seen)
    (tmp_path / "more.png").write_bytes((tmp_path / "00.png").read_bytes())
    with pytest.raises(InputError, match="4 poses and 5 images"):
        open_devices(robot=f"folder:{tmp_path}")


def test_lens_of_a_file_is_what_the_camera_states(tmp_path: Path) -> None:
    write_pictures(tmp_path)
    lens = cb.Camera.create("pinhole", {"fx": 60.0, "fy": 60.0, "cx": 31.5, "cy": 23.5}, image_size=(64, 48))
    write_camera_info(lens, tmp_path / "lens.yaml")
    stated = open_devices(camera=f"folder:{tmp_path},lens=lens.yaml").camera.stated
    assert stated.colour is not None
    assert stated.colour.parameters["fx"] == pytest.approx(60.0)


def test_bad_input(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="does not exist"):
        open_devices(camera=f"folder:{tmp_path / 'none'}")
    write_pictures(tmp_path)
    with pytest.raises(InputError, match="no robot in it"):
        open_devices(robot=f"folder:{tmp_path}")
    with pytest.raises(InputError, match="no such file"):
        open_devices(robot=f"folder:{tmp_path},poses=none.csv")
    (tmp_path / "poses.csv").write_text(
        "image,x,y,z,rx,ry,rz\n" + "".join(f"0{k}.png,1,2,3,.1,.2,.3\n" for k in range(4))
    )
    with pytest.raises(InputError, match="rotation=rotvec"):
        open_devices(robot=f"folder:{tmp_path}")
    assert open_devices(robot=f"folder:{tmp_path},rotation=rotvec,angle=rad,units=mm").robot.pose()[2, 3] == 0.003
    (tmp_path / "poses.json").write_text("[]")
    with pytest.raises(InputError, match="several files of poses"):
        open_devices(robot=f"folder:{tmp_path}")
