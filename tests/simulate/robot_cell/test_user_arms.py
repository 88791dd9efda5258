"""Arms of the user's own files in the cell."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.simulate.robot_cell import cells  # noqa: F401  skips without MuJoCo

from calibrant.errors import InputError

from calibrant.simulate.robot_cell import RobotCellSpec, make_robot_cell  # isort: skip

AXES = ("0 0 1", "0 1 0", "0 1 0", "1 0 0", "0 1 0", "1 0 0")


def _mjcf() -> str:
    body = '<site name="flange" pos="0 0 0.1" quat="0 1 0 0"/><geom type="box" size=".03 .03 .03"/>'
    body += '<body name="own hand" pos="0 0 0.1"><joint name="finger" type="slide" axis="0 1 0"/>'
    body += '<geom type="box" size=".01 .01 .01"/></body>'
    for k in reversed(range(6)):
        geom = '<geom type="capsule" size="0.04" fromto="0 0 0 0 0 0.2"/>'
        joint = f'<joint name="j{k}" axis="{AXES[k]}" range="-2.5 2.5" limited="true"/>'
        body = f'<body name="b{k}" pos="0 0 {0.2 if k else 0.1}">{joint}{geom}{body}</body>'
    key = '<keyframe><key qpos="0 0.2 1.0 0 1.2 0 0"/></keyframe>'
    motor = '<actuator><motor joint="j0"/></actuator>'
    return f'<mujoco><compiler angle="radian"/><worldbody>{body}</worldbody>{motor}{key}</mujoco>'


def _urdf() -> str:
    text = '<link name="base"/>'
    parent = "base"
    for k in range(6):
        text += f'<link name="l{k}"><inertial><mass value="1"/><origin xyz="0 0 0.1"/>'
        text += '<inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        text += f'<joint name="j{k}" type="revolute"><parent link="{parent}"/><child link="l{k}"/>'
        text += f'<origin xyz="0 0 {0.2 if k else 0.1}" rpy="0 0 0.2"/><axis xyz="{AXES[k]}"/>'
        text += '<limit lower="-2.5" upper="2.5" effort="100" velocity="2"/></joint>'
        parent = f"l{k}"
    return f'<robot name="six">{text}</robot>'


@pytest.mark.parametrize(("name", "text"), [("arm.xml", _mjcf()), ("arm.urdf", _urdf())])
def test_a_file_is_the_cells_arm(tmp_path: Path, name: str, text: str) -> None:
    file = tmp_path / name
    file.write_text(text)
    spec = RobotCellSpec(arm=str(file), objects=(), cameras=()).without_noise()
    with make_robot_cell(0, spec=spec) as cell:
        robot = cell.robot
        assert len(robot.home) == 6
        goal = np.array([0.3, 0.3, 0.9, -0.2, 1.1, 0.4])
        robot.move_joints(goal)
        np.testing.assert_allclose(robot.joints(), goal, atol=1e-4)
        np.testing.assert_allclose(robot.pose(), cell.truth.T_base_gripper(), atol=1e-9)
        there = robot.pose()
        there[2, 3] += 0.02
        robot.move_to(there)
        np.testing.assert_allclose(cell.truth.T_base_gripper(), there, atol=1e-4)


def test_the_key_of_a_file_is_where_its_arm_rests_and_its_site_the_flange(tmp_path: Path) -> None:
    file = tmp_path / "arm.xml"
    file.write_text(_mjcf())
    with make_robot_cell(0, spec=RobotCellSpec(arm=str(file), objects=(), cameras=()).without_noise()) as cell:
        np.testing.assert_allclose(cell.robot.home, [0, 0.2, 1.0, 0, 1.2, 0])
        np.testing.assert_allclose(cell.robot.forward(np.zeros(6))[:3, 3], [0, 0, 1.2], atol=1e-9)
        np.testing.assert_allclose(cell.robot.forward(np.zeros(6))[:3, 2], [0, 0, -1], atol=1e-9)


def test_files_that_are_no_arm_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "arm.xml"
    file.write_text('<mujoco><worldbody><body><joint name="a"/><geom size="1"/></body></worldbody></mujoco>')
    with pytest.raises(InputError, match="a chain of 1 joints"):
        make_robot_cell(0, spec=RobotCellSpec(arm=str(file)))
    file.write_text("no robot")
    with pytest.raises(InputError, match="no robot that MuJoCo reads"):
        make_robot_cell(0, spec=RobotCellSpec(arm=str(file)))
    with pytest.raises(InputError, match="pip install --no-deps dm-robotics-panda"):
        make_robot_cell(0, spec=RobotCellSpec(arm="panda-mesh"))
