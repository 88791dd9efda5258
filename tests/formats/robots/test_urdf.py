"""URDF: chains against hand-made transforms, mimics, limits, writing back, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calibrant.errors import InputError
from calibrant.formats.robots.read import read_robot, robot_text
from calibrant.formats.robots.urdf import corrected_urdf, new_urdf, parse_urdf
from calibrant.geometry import rotations, se3
from calibrant.reading.notes import heard
from calibrant.robots.arms import arm

ROBOT = """<?xml version="1.0"?>
<!-- a bench arm -->
<robot name="bench">
  <link name="world"/>
  <link name="base"><inertial><mass value="5"/></inertial></link>
  <link name="upper"><inertial><origin xyz="0.1 0 0"/><mass value="2"/></inertial></link>
  <link name="fore"/><link name="slider"/><link name="tool"/><link name="camera"/>
  <joint name="mount" type="fixed"><origin xyz="0 0 1"/><parent link="world"/><child link="base"/></joint>
  <joint name="shoulder" type="revolute">
    <origin xyz="0 0 0.3" rpy="0 0 1.5707963267948966"/><parent link="base"/><child link="upper"/>
    <axis xyz="0 1 0"/><limit lower="-2" upper="2.5" effort="1" velocity="1"/>
  </joint>
  <joint name="elbow" type="revolute">
    <origin xyz="0.4 0 0"/><parent link="upper"/><child link="fore"/><axis xyz="0 2 0"/>
    <limit lower="-3" upper="3" effort="1" velocity="1"/><mimic joint="shoulder" multiplier="-2" offset="0.1"/>
  </joint>
  <joint name="rail" type="prismatic">
    <parent link="fore"/><child link="slider"/><axis xyz="1 0 0"/><limit lower="0" upper="0.5" effort="1" velocity="1"/>
  </joint>
  <joint name="tool_mount" type="fixed"><origin xyz="0.05 0 0"/><parent link="slider"/><child link="tool"/></joint>
  <joint name="camera_mount" type="fixed"><origin xyz="0 0.1 0"/><parent link="slider"/><child link="camera"/></joint>
</robot>
"""


def turn(order: str, angle: float) -> np.ndarray:
    return se3.make(rotations.matrix_from_euler([angle, 0, 0], order=order, unit="rad"), [0, 0, 0])


def shift(*xyz: float) -> np.ndarray:
    return se3.make(np.eye(3), xyz)


def test_the_chain_is_the_product_of_its_joints() -> None:
    chain = parse_urdf(ROBOT, "r.urdf", link="tool").chain
    assert [j.name for j in chain.joints] == ["shoulder", "rail"]
    a, s = 0.7, 0.2
    expected = (
        shift(0, 0, 1.3) @ turn("ZYX", np.pi / 2) @ turn("YXZ", a) @ shift(0.4, 0, 0) @ turn("YXZ", -2 * a + 0.1)
    ) @ shift(s + 0.05, 0, 0)
    assert np.allclose(chain.forward([a, s]), expected, atol=1e-14)
    assert (chain.joints[0].lower, chain.joints[0].upper) == (-2.0, 2.5)
    assert chain.joints[1].kind == "prismatic"


def test_a_base_may_be_named() -> None:
    whole, part = (parse_urdf(ROBOT, "r.urdf", link="tool", base=b).chain.forward([0.3, 0.1]) for b in (None, "base"))
    assert np.allclose(whole, shift(0, 0, 1) @ part, atol=1e-14)


def test_masses_hang_on_the_joint_that_carries_them() -> None:
    loads = parse_urdf(ROBOT, "r.urdf", link="tool").chain.loads
    assert [(load.mover, load.mass, load.centre) for load in loads] == [(0, 2.0, (0.1, 0.0, 0.0))]


def test_a_corrected_chain_comes_back_from_its_file() -> None:
    original = parse_urdf(ROBOT, "r.urdf", link="tool")
    delta = np.random.default_rng(0).normal(scale=1e-2, size=len(original.chain.parameters))
    changed = original.chain.moved(delta)
    text = corrected_urdf(original, changed)
    again = parse_urdf(text, "new.urdf", link="tool")
    assert np.allclose(again.chain.links, changed.links, atol=1e-14)
    assert "a bench arm" not in text.split("<robot")[1]
    assert text.count("<mass") == 2
    # What is not in the chain stays as it was.
    assert 'xyz="0 0.1 0"' in text


def test_any_chain_can_become_a_urdf() -> None:
    ur = arm("ur5e")
    again = parse_urdf(new_urdf(ur), "ur5e.urdf").chain
    q = np.random.default_rng(0).uniform(-2, 2, (5, 6))
    assert np.allclose(again.forward(q), ur.forward(q), atol=1e-12)
    assert [(j.name, j.lower) for j in again.joints] == [(j.name, j.lower) for j in ur.joints]


JOINT = '<joint name="{}" type="fixed"><parent link="{}"/><child link="{}"/></joint></robot>'


@pytest.mark.parametrize(
    ("change", "link", "message"),
    [
        (("", ""), "hand", "no link 'hand'; the links are world, base"),
        (("", ""), None, "ends in several links .tool, camera.; choose one with --robot-link"),
        (('type="prismatic"', 'type="planar"'), "tool", "joint 'rail' is of type 'planar'"),
        (
            ('<limit lower="0" upper="0.5" effort="1" velocity="1"/>', ""),
            "tool",
            "'rail' is prismatic and has no",
        ),
        (('lower="-2" upper="2.5"', 'lower="2" upper="-2"'), "tool", "limits 2 to -2"),
        (('axis xyz="1 0 0"', 'axis xyz="0 0 0"'), "tool", "axis of joint 'rail' is 0 0 0"),
        (('mimic joint="shoulder"', 'mimic joint="knee"'), "tool", "mimics 'knee', which is no joint"),
        (('mimic joint="shoulder"', 'mimic joint="elbow"'), "tool", "mimics itself"),
        (('xyz="0.4 0 0"', 'xyz="0.4 zero 0"'), "tool", "origin of 'elbow', xyz: '0.4 zero 0'"),
        (("</robot>", ""), "tool", "not XML"),
        (("<robot name", "<xacro:macro/><robot name"), "tool", "not XML"),
        (('name="bench"', 'name="${arm}" xmlns:xacro="http://wiki.ros.org/xacro"'), "tool", "holds xacro macros"),
        (('<?xml version="1.0"?>', "<!DOCTYPE a [<!ENTITY b 'c'>]>"), "tool", "document types"),
        (("", ""), "world", "no joint moves"),
        (('<link name="base"', '<link name="world"/><link name="base"'), "tool", "two links are called 'world'"),
        (("</robot>", JOINT.format("elbow", "world", "tool")), "tool", "two joints are called 'elbow'"),
        (("</robot>", JOINT.format("extra", "word", "tool")), "tool", "has the parent 'word', and there is no such"),
        (("</robot>", JOINT.format("extra", "world", "tool")), "tool", "'tool' hangs on two joints, .* and 'extra'"),
        (("</robot>", JOINT.format("extra", "tool", "world")), "tool", "in a circle, .*correct the parent"),
        (("</robot>", JOINT.format("extra", "tool", "world")), None, "in a circle"),
    ],
)
def test_what_cannot_be_read_is_said(change: tuple[str, str], link: str | None, message: str) -> None:
    with pytest.raises(InputError, match=message):
        parse_urdf(ROBOT.replace(*change) if change[0] else ROBOT, "r.urdf", link=link)


TABLE = """
convention: modified
units: {length: mm, angle: deg}
joints:
  - {name: one, a: 0, alpha: 0, d: 400, lower: -90, upper: 90}
  - {name: two, a: 300, alpha: 0, d: 0, theta: 5}
  - {name: z, kind: prismatic, a: 250, alpha: 180, d: 50, beta: 1, lower: 0, upper: 200}
"""


def test_a_table_in_millimetres_and_degrees(tmp_path: Path) -> None:
    path = tmp_path / "scara.yaml"
    path.write_text(TABLE)
    chain = read_robot(path).chain
    assert np.allclose(chain.lower, [-np.pi / 2, -np.pi, 0.0])
    assert np.allclose(chain.upper, [np.pi / 2, np.pi, 0.2])
    state = chain.state.reshape(3, 5)
    assert np.allclose(state[2], [0.25, np.pi, 0.05, 0, np.deg2rad(1)])
    assert np.allclose(state[1], [0.3, 0, 0, np.deg2rad(5), 0])
    path.write_text(robot_text(None, chain, ".yaml"))
    assert np.array_equal(read_robot(path).chain.state, chain.state)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("modified", "craig"), "convention is 'craig', expected standard or modified"),
        (("units: {length: mm, angle: deg}", ""), "units is None"),
        (("a: 300, ", ""), "joint 2: no a"),
        (("d: 400", "d: high"), "joint 1: d is 'high', expected a number"),
        (("lower: 0, upper: 200", "upper: 200"), "joint 3: no lower"),
        (("lower: -90", "lower: 95"), "limits 95 to 90"),
        (("theta: 5", "tehta: 5"), "unknown key 'tehta'"),
        (("kind: prismatic", "kind: sliding"), "kind is 'sliding'"),
        (("joints:", "links:"), "no list of joints"),
    ],
)
def test_what_is_no_table_is_said(change: tuple[str, str], message: str, tmp_path: Path) -> None:
    path = tmp_path / "scara.yaml"
    path.write_text(TABLE.replace(*change))
    with pytest.raises(InputError, match=message):
        read_robot(path)


def test_robots_by_name_and_what_is_not_there(tmp_path: Path) -> None:
    assert len(read_robot("ur5e").chain.joints) == 6
    with pytest.raises(InputError, match=r"no robot file arm.urdf.*ur3e, ur5e, ur10e"):
        read_robot("arm.urdf")
    with pytest.raises(InputError, match="no link 'hand'"):
        read_robot("ur5e", link="hand")
    (tmp_path / "empty.urdf").write_text("")
    with pytest.raises(InputError, match="the file is empty"):
        read_robot(tmp_path / "empty.urdf")


def test_what_is_not_used_is_said(tmp_path: Path) -> None:
    extra = '<transmission name="t"/><gazebo/><gazebo/><!-- nothing --></robot>'
    shaped = ROBOT.replace('<link name="fore"/>', '<link name="fore"><visual/><collision/></link>')
    path = tmp_path / "r.urdf"
    path.write_text(shaped.replace("</robot>", extra))
    with heard() as notes:
        read_robot(path, link="upper")
    assert notes == [
        f"{path}: not used: joint elbow, joint rail, visual, collision, transmission, gazebo (2)",
    ]
    path.write_text(ROBOT)
    with heard() as notes:
        read_robot(path, link="tool")
    assert notes == []
