"""Files of one transform: by hand from the programs' published conventions, and there and back."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import calibrant as cb
from calibrant.data.results import as_transform
from calibrant.errors import InputError
from calibrant.formats.exchange.exchange_format import read_cameras
from calibrant.formats.exchange.read import read_any
from calibrant.geometry import se3, so3
from calibrant.reading.notes import heard

T_GRIPPER_CAMERA = se3.make(so3.exp([0.3, -1.1, 0.7]), [0.05, -0.0312, 0.1])
T_BASE_TARGET = se3.make(so3.exp([0.1, 0.2, -0.4]), [0.5, 0.1, 0.02])
READ_AND_WRITTEN = {
    "ros1-static-transform": "x.sh",
    "ros2-static-transform": "x.sh",
    "ros1-launch": "x.launch",
    "ros2-launch-xml": "x.launch.xml",
    "ros2-launch": "x.launch.py",
    "moveit": "camera_pose.launch.py",
    "urdf-joint": "x.urdf",
    "xacro": "x.xacro",
    "easy-handeye": "x.yaml",
    "easy-handeye2": "x.calib",
}


@pytest.fixture
def hand_eye(tmp_path: Path) -> Path:
    """A camera in the hand, and the board it saw."""
    places = (as_transform("gripper", "camera", T_GRIPPER_CAMERA), as_transform("base", "target", T_BASE_TARGET))
    return read_cameras({}, transforms=places).write(tmp_path / "hand-eye.json")


def rotated(yaw: float, pitch: float, roll: float) -> np.ndarray:
    """Rz(yaw) Ry(pitch) Rx(roll), as tf's page has it, written out."""
    (cy, sy), (cp, sp), (cr, sr) = ((math.cos(a), math.sin(a)) for a in (yaw, pitch, roll))
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    return about_z @ about_y @ about_x


def turned(x: float, y: float, z: float, w: float) -> np.ndarray:
    """The matrix of a unit quaternion, written out."""
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


@pytest.mark.parametrize("name", READ_AND_WRITTEN)
def test_there_and_back(tmp_path: Path, hand_eye: Path, name: str) -> None:
    file = tmp_path / READ_AND_WRITTEN[name]
    cb.convert(hand_eye, file, to=name, transform="gripper:camera", choose=["parent=tool0", "child=cam"])
    found = cb.convert(file)
    assert [(t.parent, t.child) for t in found.transforms] == [("tool0", "cam")]
    np.testing.assert_allclose(found.transforms[0].matrix, T_GRIPPER_CAMERA, atol=1e-12)


@pytest.mark.parametrize("name", [n for n in READ_AND_WRITTEN if not n.startswith("easy")])
def test_a_body_frame_is_put_between_and_looks_along_its_x(tmp_path: Path, hand_eye: Path, name: str) -> None:
    file = tmp_path / READ_AND_WRITTEN[name]
    cb.convert(hand_eye, file, to=name, transform="gripper:camera", choose=["body=camera_link"])
    found = cb.convert(file)
    T_body_optical = found.transform("camera_link", "camera_optical_frame").matrix
    # Ahead, right and down of the picture along the body's x, -y and -z: REP 103.
    np.testing.assert_allclose(T_body_optical[:3, :3] @ [0, 0, 1], [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(T_body_optical[:3, :3] @ [1, 0, 0], [0, -1, 0], atol=1e-12)
    np.testing.assert_allclose(T_body_optical[:3, :3] @ [0, 1, 0], [0, 0, -1], atol=1e-12)
    np.testing.assert_allclose(
        found.transform("gripper", "camera_link").matrix @ T_body_optical, T_GRIPPER_CAMERA, atol=1e-12
    )


def test_a_chain_of_transforms_and_its_inverse_are_written(tmp_path: Path) -> None:
    places = (as_transform("base", "left", T_BASE_TARGET), as_transform("left", "right", T_GRIPPER_CAMERA))
    source = read_cameras({}, transforms=places).write(tmp_path / "rig.json")
    for parent, child, T in (
        ("base", "right", T_BASE_TARGET @ T_GRIPPER_CAMERA),
        ("right", "left", se3.inverse(T_GRIPPER_CAMERA)),
    ):
        file = tmp_path / f"{child}.urdf"
        cb.convert(source, file, transform=f"{parent}:{child}")
        np.testing.assert_allclose(cb.convert(file).transform(parent, child).matrix, T, atol=1e-12)


def test_command_lines_say_what_tf_takes(tmp_path: Path, hand_eye: Path) -> None:
    file = tmp_path / "x.sh"
    chosen = {"rotation=rpy": rotated, "rotation=quaternion": turned}
    for choice, matrix in chosen.items():
        said = ["period=20", choice]
        cb.convert(hand_eye, file, to="ros1-static-transform", transform="gripper:camera", choose=said, force=True)
        words = file.read_text().split()
        assert words[:3] == ["rosrun", "tf", "static_transform_publisher"]
        assert words[-3:] == ["gripper", "camera", "20"]
        numbers = [float(w) for w in words[3:-3]]
        np.testing.assert_allclose(numbers[:3], T_GRIPPER_CAMERA[:3, 3], atol=1e-15)
        np.testing.assert_allclose(matrix(*numbers[3:]), T_GRIPPER_CAMERA[:3, :3], atol=1e-12)
    cb.convert(
        hand_eye, file, to="ros2-static-transform", transform="gripper:camera", choose=["rotation=rpy"], force=True
    )
    words = file.read_text().split()
    said_by = {name.lstrip("-"): value for name, value in zip(words[4::2], words[5::2])}
    assert (words[:4], said_by["frame-id"], said_by["child-frame-id"]) == (
        ["ros2", "run", "tf2_ros", "static_transform_publisher"],
        "gripper",
        "camera",
    )
    yaw, pitch, roll = (float(said_by[name]) for name in ("yaw", "pitch", "roll"))
    np.testing.assert_allclose(rotated(yaw, pitch, roll), T_GRIPPER_CAMERA[:3, :3], atol=1e-12)


LINES = {
    "ros1.sh": "rosrun tf static_transform_publisher 0.1 -0.2 .3 0.5 -0.25 1e-1 /base /cam 100\n",
    "tf2.sh": "# a camera\nrosrun tf2_ros static_transform_publisher 0.1 -0.2 .3 \\\n  0.5 -0.25 1e-1 base cam\n",
    "ros2.sh": "source /opt/ros/humble/setup.bash; ros2 run tf2_ros static_transform_publisher --x 0.1 --y=-0.2 --z .3 "
    "--yaw 0.5 --pitch -0.25 --roll 0.1 --frame-id base --child-frame-id cam --ros-args -r __node:=a &\n",
    "a.launch": '<launch><!-- c --><node pkg="tf" type="static_transform_publisher" name="n" '
    'args="0.1 -0.2 0.3 0.5 -0.25 0.1 base cam 100"/></launch>',
    "a.launch.xml": '<launch><node pkg="tf2_ros" exec="static_transform_publisher" '
    'args="--x 0.1 --y -0.2 --z 0.3 --yaw 0.5 --pitch -0.25 --roll 0.1 --frame-id base --child-frame-id cam"/>'
    "</launch>",
    "a.launch.py": "from launch import LaunchDescription\ndef generate_launch_description():\n"
    "    return LaunchDescription([Node(package='tf2_ros', executable='static_transform_publisher',\n"
    "        arguments=['0.1', '-0.2', '0.3', '0.5', '-0.25', '0.1', 'base', 'cam'])])\n",
    "a.urdf": '<robot name="r"><link name="base"/><link name="cam"/><joint name="j" type="fixed"><parent link="base"/>'
    '<child link="cam"/><origin xyz="0.1 -0.2 0.3" rpy="0.1 -0.25 0.5"/></joint></robot>',
    "joint.urdf": '<joint name="j" type="fixed"><parent link="base"/>'
    '<child link="cam"/><origin xyz="0.1 -0.2 0.3" rpy="0.1 -0.25 0.5"/></joint>',
    "a.xacro": '<robot xmlns:xacro="http://wiki.ros.org/xacro"><xacro:property name="h" value="${0.6/2}"/>'
    '<xacro:macro name="m" params="parent:=base *origin prefix:=\'\'"><joint name="${prefix}j" type="fixed">'
    '<parent link="${parent}"/><child link="cam"/><origin xyz="0.1 ${-2*0.1} ${h}" '
    'rpy="${radians(180)-pi+0.1} -0.25 ${pi/2 - pi/2 + 0.5}"/></joint></xacro:macro></robot>',
}


@pytest.mark.parametrize("name", LINES)
def test_what_people_have_is_read(tmp_path: Path, name: str) -> None:
    file = tmp_path / name
    file.write_text(LINES[name])
    found = cb.convert(file).transform("base", "cam").matrix
    np.testing.assert_allclose(found[:3, 3], [0.1, -0.2, 0.3], atol=1e-15)
    np.testing.assert_allclose(found[:3, :3], rotated(0.5, -0.25, 0.1), atol=1e-12)


HAND = (
    "robot_base_frame: base\n  robot_effector_frame: tool0\n  tracking_base_frame: cam\n  tracking_marker_frame: tag\n"
)
QUATERNION = (0.1, -0.5, 0.5, math.sqrt(0.49))
HANDEYE = {
    "second.calib": f"parameters:\n  name: n\n  calibration_type: eye_in_hand\n  {HAND}transform:\n"
    "  translation: {x: 0.1, y: -0.2, z: 0.3}\n  rotation: {x: 0.1, y: -0.5, z: 0.5, w: 0.7}\n",
    "first.yaml": f"parameters:\n  eye_on_hand: true\n  {HAND}transformation: "
    "{qw: 0.7, qx: 0.1, qy: -0.5, qz: 0.5, x: 0.1, y: -0.2, z: 0.3}\n",
    "oldest.yaml": "eye_on_hand: true\nbase_link_frame: base\ntool_frame: tool0\noptical_origin_frame: cam\n"
    "transformation: {qw: 0.7, qx: 0.1, qy: -0.5, qz: 0.5, x: 0.1, y: -0.2, z: 0.3}\n",
}


@pytest.mark.parametrize("name", HANDEYE)
def test_easy_handeye_of_all_ages(tmp_path: Path, name: str) -> None:
    file = tmp_path / name
    file.write_text(HANDEYE[name])
    found = cb.convert(file).transform("tool0", "cam").matrix
    np.testing.assert_allclose(found[:3, 3], [0.1, -0.2, 0.3], atol=1e-15)
    np.testing.assert_allclose(found[:3, :3], turned(*QUATERNION), atol=1e-12)
    file.write_text(
        HANDEYE[name].replace("eye_in_hand", "eye_on_base").replace("eye_on_hand: true", "eye_on_hand: false")
    )
    assert cb.convert(file).transform("base", "cam").matrix[0, 3] == pytest.approx(0.1)


def test_easy_handeye_knows_the_frames_and_the_setup(tmp_path: Path, hand_eye: Path) -> None:
    file = tmp_path / "x.calib"
    cb.convert(hand_eye, file, transform="gripper:camera")
    text = file.read_text()
    for line in (
        "calibration_type: eye_in_hand",
        "robot_base_frame: base",
        "robot_effector_frame: gripper",
        "tracking_base_frame: camera",
        "tracking_marker_frame: target",
    ):
        assert line in text
    with pytest.raises(InputError, match=r"is target -> base a camera in the hand .* choose setup=eye-in-hand"):
        cb.convert(hand_eye, tmp_path / "y.calib", transform="target:base")


MAKERS = ("ur", "franka", "kuka", "fanuc", "abb", "yaskawa", "staubli", "kawasaki")


@pytest.mark.parametrize("maker", MAKERS)
def test_poses_of_makers_are_read_by_our_readers_as_they_were(tmp_path: Path, hand_eye: Path, maker: str) -> None:
    from calibrant.formats.poses.notations import notations
    from calibrant.formats.poses.read import read_poses

    file = tmp_path / f"pose.{maker}.txt"
    cb.convert(hand_eye, file, transform="gripper:camera")
    (found,) = notations(read_poses(file, maker=maker))
    np.testing.assert_allclose(found.T_base_gripper[0], T_GRIPPER_CAMERA, atol=1e-12)


def test_poses_of_makers_by_hand(tmp_path: Path) -> None:
    """A quarter turn about z, 10, 20, 30 mm: the numbers that each manual's page gives."""
    places = (as_transform("base", "camera", se3.make(rotated(math.pi / 2, 0, 0), [0.01, 0.02, 0.03])),)
    source = read_cameras({}, transforms=places).write(tmp_path / "r.json")
    half = math.sqrt(0.5)
    expected = {
        "ur": [0.01, 0.02, 0.03, 0, 0, math.pi / 2],
        "franka": [0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0, 0.01, 0.02, 0.03, 1],
        "kuka": [10, 20, 30, 90, 0, 0],
        "fanuc": [10, 20, 30, 0, 0, 90],
        "abb": [10, 20, 30, half, 0, 0, half],
        "yaskawa": [10, 20, 30, 0, 0, 90],
        "staubli": [10, 20, 30, 0, 0, 90],
        "kawasaki": [10, 20, 30, 90, 0, 0],
    }
    for maker, numbers in expected.items():
        cb.convert(source, tmp_path / f"p.{maker}.txt")
        words = "".join(c if c in "+-.0123456789" else " " for c in (tmp_path / f"p.{maker}.txt").read_text()).split()
        found = [float(w) for w in words if w not in ("-", ".")]
        if maker == "kawasaki":  # the outer two of O, A, T turn about the same axis: their sum counts
            found[3:] = [found[3] + found[5], found[4], 0]
        np.testing.assert_allclose(found, numbers, atol=1e-12, err_msg=maker)


BAD = {
    "a.sh": ("rosrun tf static_transform_publisher 1 2 3 0 0 0 base\n", "expected x y z"),
    "b.sh": ("ros2 run tf2_ros static_transform_publisher --x 1 --frame-id a\n", "--child-frame-id is missing"),
    "c.sh": (
        "ros2 run tf2_ros static_transform_publisher --qx 1 --yaw 1 --frame-id a --child-frame-id b\n",
        "angles or a quaternion",
    ),
    "d.sh": ("rosrun tf static_transform_publisher 1 2 3 0 0 0.5 0.5 base cam 9\n", "has a norm of 0.7071"),
    "e.sh": ("rosrun tf static_transform_publisher 1 2 3 0 0 1e999 base cam 9\n", "expected"),
    "f.sh": ("ros2 run tf2_ros static_transform_publisher --yow 1 --frame-id a --child-frame-id b\n", "'--yow' is no"),
    "g.launch": ('<launch><node type="static_transform_publisher" args="$(arg x) 0 0"/></launch>', "roslaunch alone"),
    "h.launch.py": ("LaunchDescription(Node(executable='static_transform_publisher', arguments=x))", "not run"),
    "i.launch.py": ("LaunchDescription( 'static_transform_publisher'", "not Python"),
    "j.urdf": ('<robot><joint type="fixed"><parent link="a"/><child/></joint></robot>', "no <child link"),
    "k.urdf": (
        '<robot><joint type="fixed"><parent link="a"/><child link="b"/><origin xyz="1 2"/></joint></robot>',
        "expected 3 finite numbers",
    ),
    "l.urdf": ('<robot><joint type="revolute"><parent link="a"/><child link="b"/></joint></robot>', "no fixed joint"),
    "m.xacro": (
        '<robot><joint type="fixed"><parent link="a"/><child link="b"/><origin xyz="${9**9**9} 0 0"/></joint></robot>',
        "cannot be worked out",
    ),
    "n.calib": (HANDEYE["second.calib"].replace("eye_in_hand", "hand"), "calibration_type is 'hand'"),
    "o.calib": (HANDEYE["second.calib"].replace("w: 0.7", "w: 7"), "has a norm of"),
    "p.yaml": (HANDEYE["first.yaml"].replace("  eye_on_hand: true\n", ""), "found neither"),
    "q.yaml": (HANDEYE["first.yaml"].replace("qw: 0.7,", ""), "expected 4 finite numbers"),
    "r.calib": (HANDEYE["second.calib"].replace("  translation: {x: 0.1, y: -0.2, z: 0.3}\n", ""), "no translation"),
    "s.sh": (LINES["ros1.sh"] + LINES["ros1.sh"].replace("0.1 -0.2", "0.2 -0.2"), "stands there twice"),
}


@pytest.mark.parametrize("name", BAD)
def test_what_is_wrong_is_said_with_the_file(tmp_path: Path, name: str) -> None:
    text, words = BAD[name]
    file = tmp_path / name
    file.write_text(text)
    with pytest.raises(InputError) as caught:
        cb.convert(file)
    assert words in str(caught.value)
    assert str(caught.value).startswith(str(file))


def test_which_transform_is_asked(tmp_path: Path, hand_eye: Path) -> None:
    with pytest.raises(
        InputError, match=r"there are 2 \(gripper:camera, base:target\); name one: transform PARENT:CHILD"
    ):
        cb.convert(hand_eye, tmp_path / "x.urdf")
    with pytest.raises(InputError, match="no chain of transforms leads from"):
        cb.convert(hand_eye, tmp_path / "x.urdf", transform="base:camera")


def test_a_launch_files_own_arguments_are_filled_in(tmp_path: Path) -> None:
    file = tmp_path / "camera.launch"
    words = "0.1 0 0 0 0 0 $(arg base) $(arg cam)_link 9"
    node = f'<node pkg="tf" type="static_transform_publisher" name="n" args="{words}"/>'
    file.write_text(f'<launch><arg name="base" default="tool0"/><arg name="cam" value="left"/>{node}</launch>')
    with heard() as notes:
        (found,) = read_any(file).transforms
    assert (found.parent, found.child, found.matrix[0, 3]) == ("tool0", "left_link", 0.1)
    assert any("base = tool0, cam = left" in note for note in notes)
    file.write_text(f'<launch><arg name="base" default="tool0"/><arg name="cam"/>{node}</launch>')
    with pytest.raises(InputError, match="known to roslaunch alone"):
        read_any(file)
