"""Text tables of poses: every layout a person could hand in gives the same poses; what is wrong is named by line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calibrant.errors import InputError
from calibrant.formats.poses.read import notations, read_poses
from calibrant.geometry import rotations, se3, so3
from calibrant.reading.notes import heard

T = se3.make(so3.random(np.random.default_rng(5), 3), [[0.5, -0.25, 0.75], [0.4, 0.1, 0.6], [-0.3, 0.2, 0.9]])
POSITION = T[:, :3, 3]
XYZW = rotations.quaternion_xyzw_from_matrix(T[:, :3, :3])
WXYZ = rotations.quaternion_wxyz_from_matrix(T[:, :3, :3])
ZYX = rotations.euler_from_matrix(T[:, :3, :3], order="ZYX", unit="deg")
FIXED = rotations.euler_from_matrix(T[:, :3, :3], order="xyz", unit="deg")
NAMES = ["0.png", "1.png", "10.png"]


def table(*columns: np.ndarray, separator: str = ",", names: bool = False) -> str:
    """Rows of numbers with all their digits."""
    lines = []
    for i, row in enumerate(np.column_stack(columns)):
        cells = [repr(float(x)) for x in row]
        lines.append(separator.join([NAMES[i], *cells] if names else cells))
    return "\n".join(lines) + "\n"


def first(path: Path, text: str, **options: str) -> np.ndarray:
    """Poses by the most believable notation."""
    path.write_text(text, encoding="utf-8")
    return notations(read_poses(path, **options))[0].T_base_gripper


FLAT = T.reshape(3, 16)
ROS_PARTS = [*(f"position.{a}" for a in "xyz"), *(f"orientation.{a}" for a in "xyzw")]
LAYOUTS = {
    "native": "image,x,y,z,qx,qy,qz,qw\n" + table(POSITION, XYZW, names=True),
    "scalar first by name": "x,y,z,qw,qx,qy,qz\n" + table(POSITION, WXYZ),
    "semicolons": "x;y;z;qx;qy;qz;qw\n" + table(POSITION, XYZW, separator=";"),
    "decimal comma": "x;y;z;qx;qy;qz;qw\n" + table(POSITION, XYZW, separator=";").replace(".", ","),
    "tabs": "x\ty\tz\tqx\tqy\tqz\tqw\n" + table(POSITION, XYZW, separator="\t"),
    "blanks and comments": "# robot poses\n\nx y z qx qy qz qw\n% more\n" + table(POSITION, XYZW, separator="  "),
    "byte order mark": "\ufeffx,y,z,qx,qy,qz,qw\n" + table(POSITION, XYZW),
    "quoted": '"x","y","z","qx","qy","qz","qw"\n' + table(POSITION, XYZW),
    "separator at the end": "x,y,z,qx,qy,qz,qw\n" + table(POSITION, XYZW).replace("\n", ",\n"),
    "windows lines": ("x,y,z,qx,qy,qz,qw\n" + table(POSITION, XYZW)).replace("\n", "\r\n"),
    "TUM trajectory": "# timestamp tx ty tz qx qy qz qw\n"
    + table(np.array([1.5, 2.75, 9.0]), POSITION, XYZW, separator=" "),
    "no header, time stamp": table(np.array([1.5, 2.75, 9.0]), POSITION, XYZW, separator=" "),
    "no header, quaternion": table(POSITION, XYZW),
    "no header, quaternion first": table(WXYZ, POSITION),
    "no header, rotation vector first": table(so3.log(T[:, :3, :3]), 1e3 * POSITION),
    "no header, names": table(POSITION, XYZW, names=True),
    "ROS bag export": ",".join(["%time", *(f"field.pose.{part}" for part in ROS_PARTS)])
    + "\n"
    + table(np.array([1e9, 2e9, 3e9]), POSITION, XYZW),
    "millimetres by name": "X[mm],Y[mm],Z[mm],qx,qy,qz,qw\n" + table(1e3 * POSITION, XYZW),
    "millimetres by size": "x,y,z,qx,qy,qz,qw\n" + table(1e3 * POSITION, XYZW),
    "centimetres": "x (cm),y (cm),z (cm),qx,qy,qz,qw\n" + table(1e2 * POSITION, XYZW),
    "KUKA": "X,Y,Z,A,B,C\n" + table(1e3 * POSITION, ZYX),
    "Fanuc": "x,y,z,w,p,r\n" + table(1e3 * POSITION, FIXED),
    "roll pitch yaw, degrees": "x,y,z,roll_deg,pitch_deg,yaw_deg\n" + table(POSITION, FIXED),
    "yaw pitch roll, radians": "x,y,z,yaw,pitch,roll\n" + table(POSITION, np.deg2rad(ZYX)),
    "rotation vector by name": "x,y,z,rotvec_x,rotvec_y,rotvec_z\n" + table(POSITION, so3.log(T[:, :3, :3])),
    "Kawasaki": "x,y,z,o,a,t\n"
    + table(1e3 * POSITION, rotations.euler_from_matrix(T[:, :3, :3], order="ZYZ", unit="deg")),
    "16 numbers": table(FLAT, separator=" "),
    "16 numbers by columns": table(np.swapaxes(T, 1, 2).reshape(3, 16)),
    "12 numbers": table(FLAT[:, :12], separator=" "),
    "4x4 lines": "\n".join(table(m, separator=" ") for m in T),
    "named matrix": "name,r11,r12,r13,r21,r22,r23,r31,r32,r33,tx,ty,tz\n"
    + table(T[:, :3, :3].reshape(3, 9), POSITION, names=True),
    "matrix from 0": ",".join(f"T{i}{j}" for i in range(4) for j in range(4)) + "\n" + table(FLAT),
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_layout_gives_the_same_poses(tmp_path: Path, layout: str) -> None:
    # Rounding of degrees and quaternions is some 1e-16; 1e-12 leaves room for the conversions.
    np.testing.assert_allclose(first(tmp_path / "p.csv", LAYOUTS[layout]), T, atol=1e-12)


def test_names_come_from_the_best_column_and_are_none_without_one(tmp_path: Path) -> None:
    path = tmp_path / "p.csv"
    path.write_text("id,x,y,z,qx,qy,qz,qw,image\n7,0.5,0,0,0,0,0,1,a.png\n8,0.6,0,0,0,0,0,1,b.png\n")
    assert read_poses(path).names == ("a.png", "b.png")
    path.write_text(LAYOUTS["native"])
    assert read_poses(path).names == tuple(NAMES)
    path.write_text(LAYOUTS["no header, names"])
    assert read_poses(path).names == tuple(NAMES)
    path.write_text(LAYOUTS["no header, quaternion"])
    assert read_poses(path).names is None


def test_a_counter_before_six_numbers_is_not_a_coordinate(tmp_path: Path) -> None:
    path = tmp_path / "p.txt"
    path.write_text("1 500 0 0 0.1 0.2 0.3\n2 600 0 0 0.4 0.2 0.3\n")
    raw = read_poses(path)
    assert raw.names == ("1", "2")
    np.testing.assert_array_equal(raw.translation[:, 0], [500, 600])


def test_columns_that_are_not_used_are_noted(tmp_path: Path) -> None:
    path = tmp_path / "p.csv"
    path.write_text("image,x,y,z,qx,qy,qz,qw,gain\na,0.5,0,0,0,0,0,1,high\n")
    with heard() as notes:
        read_poses(path)
    assert notes == [f"{path}: not used: gain"]


def test_a_note_says_that_matrices_were_listed_by_columns(tmp_path: Path) -> None:
    path = tmp_path / "p.csv"
    path.write_text(LAYOUTS["16 numbers by columns"])
    assert "listed by columns" in read_poses(path).notes[0]


HEADER = "image,x,y,z,qx,qy,qz,qw\n"
GOOD = "a,0.5,0,0,0,0,0,1\n"
MATRIX = "r11,r12,r13,r21,r22,r23,r31,r32,r33,x,y,z\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "the file is empty"),
        ("# only a comment\n", "empty or holds comments only"),
        (HEADER, "a header but no poses"),
        (HEADER + GOOD + "b,nan,0,0,0,0,0,1\n", r"p\.csv:3: NaN or infinity"),
        (HEADER + GOOD + "b,inf,0,0,0,0,0,1\n", r"p\.csv:3: NaN or infinity"),
        (HEADER + GOOD + "b,1e300,0,0,0,0,0,1\n", r"p\.csv:3: column 'x' is 1e\+300, beyond any length or angle"),
        (HEADER + GOOD + "b,x7,0,0,0,0,0,1\n", r"p\.csv:3: column 'x' is 'x7', expected a number"),
        (HEADER + GOOD + "b,,0,0,0,0,0,1\n", r"p\.csv:3: column 'x' is empty, expected a number"),
        (HEADER + GOOD + "b,0,0,0,0,0,0,0\n", r"p\.csv:3: a quaternion of norm 0"),
        (HEADER + GOOD + "b,0,0,0,0,0,0,0.9\n", r"p\.csv:3: the quaternion's norm is 0\.9, expected 1"),
        (HEADER + GOOD + GOOD, r"p\.csv:3: the name 'a' occurs twice, first at .*p\.csv:2"),
        (HEADER + GOOD + "b,1,2,3\n", r"p\.csv:3: 4 cells, expected 8 as in the header"),
        (HEADER + ",0.5,0,0,0,0,0,1\n", r"p\.csv:2: the pose's name is empty"),
        (
            "image,x,y,z,qx,qy,qz\na,1,2,3,0,0,0\n",
            "no complete set of columns for the rotation; found .*'qz'; expected",
        ),
        ("image,x,y,qx,qy,qz,qw\na,1,2,0,0,0,1\n", "no column for the position's z; found the columns 'image', 'x'"),
        ("x,X,y,z,qx,qy,qz,qw\n1,1,2,3,0,0,0,1\n", "two columns mean the same: 'x' and 'X'"),
        ("x[mm],y[m],z[mm],a,b,c\n1,1,2,3,0,0\n", "have different units"),
        (
            "x[ly],y[ly],z[ly],a,b,c\n1,1,2,3,0,0\n",
            r"the unit 'ly' of column 'x\[ly\]' is not known here; known: m, mm",
        ),
        ("1 2 3 4 5\n", r"p\.csv:1: 5 numbers and no header; expected 6 or 7"),
        (MATRIX + "2,0,0,0,1,0,0,0,1,1,2,3\n", r"p\.csv:2: the upper left 3x3 block is not a rotation"),
        (MATRIX + "-1,0,0,0,1,0,0,0,1,1,2,3\n", r"p\.csv:2: the rotation has determinant -1: it mirrors"),
        (
            "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 2\n",
            r"p\.csv:1: the last row of the 4x4 matrix is \[0\.0, 0\.0, 0\.0, 2\.0\]",
        ),
        ("1 0 0 2 0 1 0 0 0 0 1 0 0 0 1 1\n", r"p\.csv:1: the last row of the 4x4 matrix"),
    ],
)
def test_what_is_wrong_is_named_by_file_and_line(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "p.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        read_poses(path)
    assert "p.csv" in str(caught.value)


def test_latin_1_and_utf_16_files_are_read(tmp_path: Path) -> None:
    text = "x [mm],y [mm],z [mm],A [°],B [°],C [°]\n" + table(1e3 * POSITION, ZYX)
    for encoding in ("latin-1", "utf-16"):
        path = tmp_path / f"{encoding}.csv"
        path.write_bytes(text.encode(encoding))
        np.testing.assert_allclose(notations(read_poses(path))[0].T_base_gripper, T, atol=1e-12)


def test_rows_that_say_whose_they_are_make_pairs(tmp_path: Path) -> None:
    path = tmp_path / "pairs.csv"
    path.write_text("hand,0.4,-0.2,0.1,174.1,11.5,56.8\neye,0.1,0.05,0.3,-81.7,8.2,-164.1\n" * 3)
    raw = read_poses(path)
    assert raw.target is not None
    np.testing.assert_array_equal(raw.translation, [[0.4, -0.2, 0.1]] * 3)
    np.testing.assert_array_equal(raw.target.rotation, [[-81.7, 8.2, -164.1]] * 3)


def test_a_short_row_of_a_pair_is_named_by_its_line(tmp_path: Path) -> None:
    path = tmp_path / "pairs.csv"
    path.write_text(
        "hand,0.4,-0.2,0.1,174.1,11.5,56.8\neye,0.1,0.05,0.3,-81.7,8.2,1\nhand,1,2,3,4,5,6\neye,1,2,3,4,5\n"
    )
    with pytest.raises(InputError, match=r"pairs\.csv:4"):
        read_poses(path)


def test_a_count_above_matrices_is_not_a_pose(tmp_path: Path) -> None:
    path = tmp_path / "robot_cali.txt"
    path.write_text("2\n" + "1 0 0 10\n0 1 0 20\n0 0 1 30\n0 0 0 1\n\n" * 2)
    np.testing.assert_array_equal(read_poses(path).translation, [[10.0, 20, 30]] * 2)


def test_a_pose_may_stand_one_number_a_line(tmp_path: Path) -> None:
    for i in range(3):
        (tmp_path / f"pos{i}.txt").write_text(f"300.5\n{i}\n400\n10\n20\n30\n")
    raw = read_poses(str(tmp_path / "pos*.txt"))
    np.testing.assert_array_equal(raw.translation, [[300.5, i, 400] for i in range(3)])
    np.testing.assert_array_equal(raw.rotation, [[10.0, 20, 30]] * 3)
