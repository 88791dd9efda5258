"""Files that a user may give by mistake: the error names the file and what is wrong, and what would serve."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calibrant.errors import InputError
from calibrant.formats.cameras.camera_format import matrix_parameters, whole_size
from calibrant.formats.points_yaml import read_own_points
from calibrant.formats.poses.read import read_poses
from calibrant.formats.robots.read import read_robot, robot_text
from calibrant.robots.arms import arm


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1 0 0 1\n0 1 0 2\n0 0 1\n0 0 0 1\n", r"poses\.txt:3: 3 numbers, expected 4 a line"),
        ("joint_1,joint_2,axis_1,axis_2\n1,2,3,4\n", r"poses\.txt: several sets of joints: joint, axis; keep"),
    ],
)
def test_poses(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "poses.txt"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        read_poses(path)


def test_points_of_ones_own(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"points file .*none\.yaml does not exist"):
        read_own_points(tmp_path / "none.yaml")
    (tmp_path / "photo.yaml").write_bytes(b"\x89PNG\xff\xfe")
    with pytest.raises(InputError, match=r"points file .*photo\.yaml cannot be read as text"):
        read_own_points(tmp_path / "photo.yaml")


def test_robots(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"robot file .* cannot be read: it is a folder, expected a file"):
        read_robot(tmp_path)
    (tmp_path / "table.yaml").write_text("joints: [}")
    with pytest.raises(InputError, match=r"table\.yaml: not YAML"):
        read_robot(tmp_path / "table.yaml")
    (tmp_path / "arm.urdf").write_text(
        "<robot name='r'><link name='a'/><link name='b'/>"
        "<joint name='j' type='revolute'><parent link='a'/><child link='b'/><axis xyz='0 0 1'/></joint></robot>"
    )
    with pytest.raises(InputError, match="joint 'j' is revolute and has no <limit lower upper>; add it"):
        read_robot(tmp_path / "arm.urdf")
    (tmp_path / "two.urdf").write_text("<robot name='r'><link name='a'/><link name='b'/></robot>")
    with pytest.raises(InputError, match="2 links without a parent"):
        read_robot(tmp_path / "two.urdf")
    with pytest.raises(
        InputError, match=r"cannot write a robot as '\.txt'; expected a name ending in \.urdf or \.yaml"
    ):
        robot_text(None, arm("ur5e"), ".txt")


def test_cameras() -> None:
    with pytest.raises(InputError, match="expected 3x3 finite numbers"):
        matrix_parameters(np.full((3, 3), np.nan))
    with pytest.raises(InputError, match="the image size is 'wide' x 480, expected two whole numbers"):
        whole_size("wide", 480)
