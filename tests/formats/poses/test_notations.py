"""Which notations a file allows, in which order, and why others are dropped."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calibrant.errors import InputError
from calibrant.formats.poses.read import excluded, notations, read_poses
from calibrant.geometry import rotations, se3

ANGLES = np.array([[10.0, 20.0, 30.0], [-40.0, 15.0, 5.0]])


def write(path: Path, header: str, position: float, numbers: np.ndarray) -> Path:
    rows = [",".join([str(position), "0.25", "0.5", *(repr(float(v)) for v in row)]) for row in numbers]
    path.write_text("\n".join([header, *rows]))
    return path


def test_the_native_header_leaves_only_the_direction_and_the_quaternion_order_open(tmp_path: Path) -> None:
    path = write(tmp_path / "p.csv", "x,y,z,qx,qy,qz,qw", 0.5, np.array([[0.5, 0.5, 0.5, 0.5], [0, 0, 0, 1]]))
    found = notations(read_poses(path))
    assert [(r.units, r.rotation, r.direction, bool(r.contradicts)) for r in found] == [
        ("m", "quat-xyzw", "base-gripper", False),
        ("m", "quat-xyzw", "gripper-base", False),
        ("m", "quat-wxyz", "base-gripper", True),
        ("m", "quat-wxyz", "gripper-base", True),
    ]
    assert found[0].description == "positions in m, quaternions x y z w, T_base_gripper"
    assert found[2].contradicts == ("the file names its quaternions quat-xyzw",)
    np.testing.assert_allclose(found[1].T_base_gripper, se3.inverse(found[0].T_base_gripper), atol=1e-15)
    assert found[0].poses.ids == ("0", "1")


def test_options_leave_one_reading(tmp_path: Path) -> None:
    path = write(tmp_path / "p.csv", "x,y,z,rx,ry,rz", 500, ANGLES)
    raw = read_poses(path, units="mm", rotation="euler:XYZ", angle="deg", direction="gripper-base")
    (found,) = [r for r in notations(raw) if not r.contradicts]
    R = rotations.matrix_from_euler(ANGLES, order="XYZ", unit="deg")
    expected = se3.inverse(se3.make(R, np.array([0.5, 0.00025, 0.0005])))
    np.testing.assert_allclose(found.T_base_gripper, expected, atol=1e-15)


def test_options_given_later_count(tmp_path: Path) -> None:
    raw = read_poses(write(tmp_path / "p.csv", "x,y,z,rx,ry,rz", 0.5, ANGLES))
    assert {r.direction for r in notations(raw, direction="base-gripper")} == {"base-gripper"}
    assert {r.rotation for r in notations(raw, rotation="rotvec")} == {"rotvec"}


def test_named_axes_and_the_columns_order_are_two_readings_of_an_order(tmp_path: Path) -> None:
    raw = read_poses(
        write(tmp_path / "p.csv", "x,y,z,rx,ry,rz", 0.5, ANGLES), direction="base-gripper", rotation="euler:ZYX"
    )
    by_name, by_order = notations(raw)
    assert by_name.by_axis_names
    assert not by_name.contradicts
    assert by_order.contradicts == ("the columns are named after the axes x, y, z",)
    R = rotations.matrix_from_euler(ANGLES[:, ::-1], order="ZYX", unit="deg")
    np.testing.assert_allclose(by_name.T_base_gripper[:, :3, :3], R, atol=1e-15)
    R = rotations.matrix_from_euler(ANGLES, order="ZYX", unit="deg")
    np.testing.assert_allclose(by_order.T_base_gripper[:, :3, :3], R, atol=1e-15)


def test_every_euler_order_and_the_rotation_vector_are_tried_once(tmp_path: Path) -> None:
    raw = read_poses(write(tmp_path / "p.csv", "x,y,z,e1,e2,e3", 0.5, ANGLES), direction="base-gripper")
    assert sorted(r.rotation for r in notations(raw)) == sorted(
        ["rotvec", *(f"euler:{o}" for o in rotations.EULER_ORDERS)]
    )
    named = read_poses(write(tmp_path / "q.csv", "x,y,z,rx,ry,rz", 0.5, ANGLES), direction="base-gripper")
    T = np.array([r.T_base_gripper for r in notations(named)])
    # 24 orders of the columns, four more by their names (six by name, two of which are among the 24), the vector.
    assert len(T) == 29
    distance = np.abs(T[:, None] - T[None]).max(axis=(2, 3, 4)) + np.eye(len(T))
    assert distance.min() > 1e-3


def test_header_units_come_first_and_others_are_called_contradictions(tmp_path: Path) -> None:
    raw = read_poses(write(tmp_path / "p.csv", "X[mm],Y[mm],Z[mm],A,B,C", 30, ANGLES), direction="base-gripper")
    found = notations(raw)
    assert (found[0].units, found[0].rotation, found[0].angle) == ("mm", "euler:ZYX", "deg")
    assert not found[0].contradicts
    assert all(r.contradicts for r in found[1:])
    assert any("positions are in mm" in " ".join(r.contradicts) for r in found if r.units == "m")


def test_impossible_readings_are_dropped_with_the_reason(tmp_path: Path) -> None:
    raw = read_poses(write(tmp_path / "p.csv", "x,y,z,rx,ry,rz", 500, ANGLES))
    assert {(r.units, r.angle) for r in notations(raw)} == {("mm", "deg")}
    metres, radians = sorted(excluded(raw))
    assert metres == "positions in m: 500 m from the base is beyond any robot"
    assert radians == "rotations in radians: 40 is more than a full turn"


def test_a_row_in_another_unit_does_not_turn_the_unit_of_the_others(tmp_path: Path) -> None:
    path = write(tmp_path / "p.csv", "x,y,z,rx,ry,rz", 0.5, np.tile(ANGLES, (2, 1)))
    head, first, *rest = path.read_text().splitlines()
    cells = first.split(",")
    far = [f"{1000 * float(c):g}" for c in cells[:3]] + cells[3:]
    path.write_text("\n".join([head, ",".join(far), *rest]) + "\n")
    assert notations(read_poses(path))[0].units == "m"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"units": "km"}, "unknown units of poses 'km'; known: auto, m, mm"),
        ({"rotation": "euler"}, "unknown rotation of poses 'euler'; known: auto, quat-xyzw"),
        ({"rotation": "euler:xyw"}, "unknown rotation of poses 'euler:xyw'"),
        ({"angle": "gon"}, "unknown angle of poses 'gon'; known: auto, deg, rad"),
        ({"direction": "up"}, "unknown direction of poses 'up'; known: auto, base-gripper"),
    ],
)
def test_unknown_options_are_said(tmp_path: Path, options: dict[str, str], message: str) -> None:
    path = write(tmp_path / "p.csv", "x,y,z,rx,ry,rz", 0.5, ANGLES)
    with pytest.raises(InputError, match=message):
        read_poses(path, **options)


def test_an_option_that_the_file_cannot_mean_is_said(tmp_path: Path) -> None:
    three = write(tmp_path / "p.csv", "x,y,z,rx,ry,rz", 0.5, ANGLES)
    with pytest.raises(InputError, match=r"cannot be read with rotation quat-xyzw: .*three numbers a rotation"):
        notations(read_poses(three, rotation="quat-xyzw"))
    four = write(tmp_path / "q.csv", "x,y,z,qx,qy,qz,qw", 0.5, np.array([[0, 0, 0, 1.0]]))
    with pytest.raises(InputError, match="four numbers a rotation"):
        notations(read_poses(four, rotation="rotvec"))
