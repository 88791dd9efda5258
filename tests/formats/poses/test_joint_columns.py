"""Poses and measurements from joint values: columns, names, units, limits."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calibrant.errors import InputError
from calibrant.formats.measurements.read import read_measurements
from calibrant.formats.poses.read import notations, read_poses
from calibrant.robots.arms import arm

UR = arm("ur5e")
Q = np.random.default_rng(0).uniform(-2, 2, (4, 6))


def table(header: str, rows: np.ndarray, *, names: bool = True) -> str:
    lines = [",".join([f"{i}.png"] * names + [repr(float(v)) for v in row]) for i, row in enumerate(rows)]
    return "\n".join([("image," if names else "") + header, *lines]) + "\n"


def poses_of(path: Path, text: str, *, suffix: str = ".csv", joint_angle: str = "auto") -> np.ndarray:
    file = path / f"joints{suffix}"
    file.write_text(text)
    raw = read_poses(file, robot=UR, joint_angle=joint_angle)
    found = notations(raw)
    assert len(found) == 1
    return found[0].T_base_gripper


@pytest.mark.parametrize(
    "header",
    [
        "q1,q2,q3,q4,q5,q6",
        "j0,j1,j2,j3,j4,j5",
        "joint_1,joint_2,joint_3,joint_4,joint_5,joint_6",
        "shoulder_pan,shoulder_lift,elbow,wrist_1,wrist_2,wrist_3",
        "q1[rad],q2[rad],q3[rad],q4[rad],q5[rad],q6[rad]",
    ],
)
def test_joints_become_poses(header: str, tmp_path: Path) -> None:
    assert np.allclose(poses_of(tmp_path, table(header, Q)), UR.forward(Q), atol=1e-12)


def test_joints_in_any_column_order_by_name(tmp_path: Path) -> None:
    names = [j.name for j in UR.joints]
    order = [3, 1, 0, 5, 4, 2]
    text = table(",".join(names[i] for i in order), Q[:, order])
    assert np.allclose(poses_of(tmp_path, text), UR.forward(Q), atol=1e-12)


def test_degrees_by_header_by_option_and_by_limits(tmp_path: Path) -> None:
    header = "q1,q2,q3,q4,q5,q6"
    degrees = np.rad2deg(Q)
    stated = table(header.replace(",", "[deg],") + "[deg]", degrees)
    for text, option in ((stated, "auto"), (table(header, degrees), "deg"), (table(header, degrees), "auto")):
        assert np.allclose(poses_of(tmp_path, text, joint_angle=option), UR.forward(Q), atol=1e-12)


def test_documents_and_bare_numbers(tmp_path: Path) -> None:
    listed = ", ".join(f'{{"image": "{i}.png", "joints": {q.tolist()}}}' for i, q in enumerate(Q))
    assert np.allclose(poses_of(tmp_path, f"[{listed}]", suffix=".json"), UR.forward(Q), atol=1e-12)
    assert np.allclose(poses_of(tmp_path, f"{Q.tolist()}", suffix=".json"), UR.forward(Q), atol=1e-12)
    bare = "\n".join(" ".join(map(repr, q.tolist())) for q in Q)
    assert np.allclose(poses_of(tmp_path, bare, suffix=".txt"), UR.forward(Q), atol=1e-12)


def test_joints_beside_poses_do_not_hide_the_poses(tmp_path: Path) -> None:
    file = tmp_path / "poses.json"
    file.write_text('[{"position": [0.1, 0.2, 0.3], "quaternion_xyzw": [0, 0, 0, 1], "joints": [1, 2, 3, 4, 5, 6]}]')
    raw = read_poses(file)
    assert raw.translation.tolist() == [[0.1, 0.2, 0.3]]


@pytest.mark.parametrize(
    ("header", "message"),
    [
        ("q1,q2,q3,q4,q5,q7", "no column for joint shoulder_pan"),
        (
            "shoulder_pan,shoulder_lift,elbow,wrist_1,wrist_2,hand",
            "no column for joint wrist_3; the robot's joints are",
        ),
        ("x,y,z,qx,qy,qz", "no column for joint shoulder_pan"),
    ],
)
def test_wrong_columns_are_named(header: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=message):
        poses_of(tmp_path, table(header, Q))


def test_wrong_values_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"7 joint values .* for 6 joints"):
        poses_of(tmp_path, table("q1,q2,q3,q4,q5,q6,q7", np.column_stack([Q, Q[:, 0]])))
    far = Q + 10 * (np.arange(4)[:, None] == 2) * np.eye(6)[4]
    with pytest.raises(InputError, match=r"csv:4: joint wrist_2 is at .* deg, beyond its limits -360 to 360 deg"):
        poses_of(tmp_path, table("q1,q2,q3,q4,q5,q6", far), joint_angle="rad")
    with pytest.raises(InputError, match="unknown unit of joint angles 'gon'"):
        poses_of(tmp_path, table("q1,q2,q3,q4,q5,q6", Q), joint_angle="gon")


def test_joints_without_a_robot_say_what_is_missing(tmp_path: Path) -> None:
    file = tmp_path / "joints.csv"
    file.write_text(table("q1,q2,q3,q4,q5,q6", Q))
    with pytest.raises(InputError, match="--robot"):
        read_poses(file)


def test_measured_poses_and_positions(tmp_path: Path) -> None:
    T = UR.forward(Q)
    file = tmp_path / "m.csv"
    file.write_text(table("q1,q2,q3,q4,q5,q6,x[mm],y[mm],z[mm]", np.column_stack([Q, 1e3 * T[:, :3, 3]])))
    points = read_measurements(file, robot=UR)
    assert points.rotations is None
    assert np.allclose(points.positions, T[:, :3, 3], atol=1e-12)
    assert points.ids == ("0.png", "1.png", "2.png", "3.png")
    matrices = ",".join(f"r{i}{j}" for i in range(1, 4) for j in range(1, 4))
    file.write_text(
        table(f"q1,q2,q3,q4,q5,q6,x,y,z,{matrices}", np.column_stack([Q, T[:, :3, 3], T[:, :3, :3].reshape(4, 9)]))
    )
    full = read_measurements(file, robot=UR)
    assert full.rotations is not None
    assert np.allclose(full.rotations, T[:, :3, :3], atol=1e-12)
    file.write_text(table("q1,q2,q3,q4,q5,q6,x,y,z,rx,ry,rz", np.column_stack([Q, Q])))
    with pytest.raises(InputError, match="nothing says what they are"):
        read_measurements(file, robot=UR)
    file.write_text(table("x,y,z", Q[:, :3]))
    with pytest.raises(InputError, match="no joint values"):
        read_measurements(file)


def test_one_row_beyond_the_limits_does_not_turn_radians_into_degrees(tmp_path: Path) -> None:
    q = np.tile(Q, (4, 1))
    q[5, 2] = 7.5
    (tmp_path / "q.csv").write_text(table("q1,q2,q3,q4,q5,q6", q))
    with pytest.raises(InputError, match=r"csv:7: joint elbow is at 429.7.* deg, beyond its limits .*\(1 of 16 rows\)"):
        read_poses(tmp_path / "q.csv", robot=arm("ur5e"))
