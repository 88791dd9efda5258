"""The simulated cell: what it writes is what a user has, and it follows from the seed."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.simulate.cell import SIGMA_ROBOT_MM, make_cell, observe_cell, photograph


@pytest.mark.long
def test_files_hold_the_cell(tmp_path: Path) -> None:
    cell = make_cell(3, views=3)
    calls: list[tuple[int, int]] = []
    images, poses = photograph(cell, tmp_path, progress=lambda done, total: calls.append((done, total)))
    assert [p.name for p in images] == ["00.png", "01.png", "02.png"]
    assert calls == [(1, 3), (2, 3), (3, 3)]
    assert {cv2.imread(str(p), cv2.IMREAD_UNCHANGED).shape for p in images} == {(1024, 1280)}
    header, *rows = poses.read_text().splitlines()
    assert header == "image,x,y,z,qx,qy,qz,qw"
    for row, name, T in zip(rows, cell.robot_poses.ids, cell.robot_poses.T_base_gripper):
        image, *numbers = row.split(",")
        x, y, z, qx, qy, qz, qw = map(float, numbers)
        assert image == name
        assert np.abs(T[:3, 3] - [x, y, z]).max() < 1e-9  # nine decimals
        assert np.abs(T[:3, :3] - so3.from_quaternion_wxyz([qw, qx, qy, qz])).max() < 1e-8


def test_a_seed_is_a_cell() -> None:
    a, b, c = make_cell(1, views=4), make_cell(1, views=4), make_cell(2, views=4)
    assert np.array_equal(a.robot_poses.T_base_gripper, b.robot_poses.T_base_gripper)
    assert np.abs(se3.local(a.X, c.X)).max() > 1e-3


def test_measurements_are_near_the_truth() -> None:
    cell = make_cell(0, setup="eye-to-hand", views=5)
    delta = se3.local(cell.T_base_gripper, cell.robot_poses.T_base_gripper)
    assert 0 < 1e3 * np.abs(delta[:, 3:]).max() < 5 * SIGMA_ROBOT_MM
    A = se3.inverse(cell.T_base_gripper)
    assert np.abs(A @ cell.X @ cell.T_camera_target - cell.Z).max() < 1e-12
    seen = observe_cell(cell, sigma_px=0.1)
    assert tuple(v.id for v in seen.views) == cell.robot_poses.ids
    assert seen.target == cell.target.spec
    assert 0.3 < cell.workpiece[2] < 0.7


def test_too_few_views_and_a_folder_that_is_a_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="at least 3 views"):
        make_cell(0, views=2)
    blocked = tmp_path / "file"
    blocked.write_text("mine")
    with pytest.raises(InputError, match="--out"):
        photograph(make_cell(0, views=3), blocked)
    assert blocked.read_text() == "mine"
