"""Makers' pose formats, each on numbers that follow from its documentation."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calibrant.errors import InputError
from calibrant.formats.poses.read import notations, read_poses
from calibrant.geometry import rotations, so3


def pose(path: Path, text: str, maker: str, *, suffix: str = ".txt") -> np.ndarray:
    file = path / f"poses{suffix}"
    file.write_text(text)
    found = notations(read_poses(file, maker=maker))
    assert len(found) == 1, "a maker's format leaves one notation"
    return found[0].T_base_gripper


def test_universal_robots_rotation_vector(tmp_path: Path) -> None:
    # A tool that points straight down: half a turn about the y axis, [0, pi, 0], flips x and z.
    T = pose(tmp_path, "-0.4 0.2 0.5 0 3.141592653589793 0\n", "ur")[0]
    assert np.allclose(T, [[-1, 0, 0, -0.4], [0, 1, 0, 0.2], [0, 0, -1, 0.5], [0, 0, 0, 1]], atol=1e-12)
    script = "movej(home)\nhere = p[0.1, -0.2, 0.3, 1.5707963267948966, 0.0, 0]\nmovel(p[.1,0,0,0,0,0], a=1)\n"
    T = pose(tmp_path, script, "ur", suffix=".script")
    assert np.allclose(T[0, :3, :3], [[1, 0, 0], [0, 0, -1], [0, 1, 0]], atol=1e-12)
    assert np.allclose(T[:, :3, 3], [[0.1, -0.2, 0.3], [0.1, 0, 0]])


def test_franka_sixteen_numbers_by_columns(tmp_path: Path) -> None:
    # O_T_EE as a Panda's state prints it in its ready posture: tool down, 0.307 m ahead, 0.487 m up.
    T = pose(tmp_path, "[[1, 0, 0, 0, 0, -1, 0, 0, 0, 0, -1, 0, 0.306891, 0, 0.486882, 1]]", "franka", suffix=".json")[
        0
    ]
    assert np.allclose(T[:3, 3], [0.306891, 0, 0.486882])
    assert np.allclose(T[:3, :3], np.diag([1, -1, -1]))
    # A quarter turn about z has its sine in the second number when listed by columns.
    T = pose(tmp_path, "0,1,0,0,-1,0,0,0,0,0,1,0,0.1,0.2,0.3,1\n", "franka", suffix=".csv")[0]
    assert np.allclose(T[:3, :3] @ [1, 0, 0], [0, 1, 0])
    assert np.allclose(T[:3, 3], [0.1, 0.2, 0.3])


def test_kuka_abc(tmp_path: Path) -> None:
    # R = Rz(A) Ry(B) Rx(C): with B = 90 the tool's z is the base's x turned by A about z.
    expected = rotations.matrix_from_euler([10, 20, 30], order="ZYX", unit="deg")
    for text in (
        "X,Y,Z,A,B,C\n500,0,800,10,20,30\n",
        "500 0 800 10 20 30\n",
        "DECL E6POS XP1={X 500.0,Y 0.0,Z 800.0,A 10.0,B 20.0,C 30.0,S 2,T 35,E1 0.0}\n",
        "{FRAME: X 500, Y 0, Z 800, A 10, B 20, C 30}\n",
    ):
        T = pose(tmp_path, text, "kuka", suffix=".csv")[0]
        assert np.allclose(T[:3, 3], [0.5, 0, 0.8])
        assert np.allclose(T[:3, :3], expected)
    z = pose(tmp_path, "0 0 1000 30 90 0\n", "kuka")[0][:3, 2]
    assert np.allclose(z, [np.cos(np.pi / 6), 0.5, 0])


def test_fanuc_wpr(tmp_path: Path) -> None:
    text = """/POS
P[1:"approach"]{
   GP1:
	UF : 0, UT : 1,		CONFIG : 'N U T, 0, 0, 0',
	X =   807.000  mm,	Y =   -12.500  mm,	Z =   330.000  mm,
	W =  -180.000 deg,	P =    15.000 deg,	R =    90.000 deg
};
P[2]{
   GP1:
	UF : 0, UT : 1,		CONFIG : 'N U T, 0, 0, 0',
	X =   800.000  mm,	Y =     0.000  mm,	Z =   300.000  mm,
	W =    10.000 deg,	P =    20.000 deg,	R =    30.000 deg
};
"""
    file = tmp_path / "weld.ls"
    file.write_text(text)
    raw = read_poses(file, maker="fanuc")
    assert raw.names == ("P1", "P2")
    T = notations(raw)[0].T_base_gripper
    assert np.allclose(T[0, :3, 3], [0.807, -0.0125, 0.33])
    # W first about the fixed x, then P about the fixed y, then R about the fixed z: R = Rz(R) Ry(P) Rx(W).
    turns = [rotations.matrix_from_axis_angle(np.eye(3)[k], a, unit="deg") for k, a in enumerate((10, 20, 30))]
    assert np.allclose(T[1, :3, :3], turns[2] @ turns[1] @ turns[0])


def test_abb_robtarget(tmp_path: Path) -> None:
    # The RAPID manual's orient example: 45 degrees about x is [0.924, 0.383, 0, 0], the scalar first.
    text = "CONST robtarget p10:=[[600,500,225.3],[0.92388,0.38268,0,0],[1,1,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];\n"
    T = pose(tmp_path, text, "abb", suffix=".mod")[0]
    assert np.allclose(T[:3, 3], [0.6, 0.5, 0.2253])
    assert np.allclose(so3.log(T[:3, :3]), [np.pi / 4, 0, 0], atol=1e-5)
    bare = pose(tmp_path, "600 500 225.3 0.92388 0.38268 0 0\n", "abb")[0]
    assert np.allclose(bare, T)


@pytest.mark.parametrize(("maker", "order"), [("yaskawa", "xyz"), ("staubli", "XYZ"), ("kawasaki", "ZYZ")])
def test_other_makers(maker: str, order: str, tmp_path: Path) -> None:
    T = pose(tmp_path, "100 200 300 10 20 30\n", maker)[0]
    assert np.allclose(T[:3, :3], rotations.matrix_from_euler([10, 20, 30], order=order, unit="deg"))
    assert np.allclose(T[:3, 3], [0.1, 0.2, 0.3])


def test_named_rotations_follow_the_maker(tmp_path: Path) -> None:
    fixed = pose(tmp_path, "x,y,z,rx,ry,rz\n100,0,0,10,20,30\n", "yaskawa", suffix=".csv")[0]
    moving = pose(tmp_path, "x,y,z,rx,ry,rz\n100,0,0,10,20,30\n", "staubli", suffix=".csv")[0]
    x, y, z = (rotations.matrix_from_axis_angle(np.eye(3)[k], a, unit="deg") for k, a in enumerate((10, 20, 30)))
    assert np.allclose(fixed[:3, :3], z @ y @ x)
    assert np.allclose(moving[:3, :3], x @ y @ z)


def test_unknown_makers_and_explicit_options(tmp_path: Path) -> None:
    file = tmp_path / "p.csv"
    file.write_text("0.5 0 0.8 10 20 30\n")
    with pytest.raises(InputError, match="unknown robot format 'kuca'; known: ur, franka, kuka"):
        read_poses(file, maker="kuca")
    T = notations(read_poses(file, maker="kuka", units="m"))[0].T_base_gripper[0]
    assert np.allclose(T[:3, 3], [0.5, 0, 0.8])
