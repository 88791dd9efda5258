"""Poses as programs print and save them: each is read as what it is, or refused with the place."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray

from calibrant.errors import InputError
from calibrant.formats.poses.read import notations, read_poses
from calibrant.geometry import rotations, so3
from calibrant.simulate.scenes import hand_eye_scene

Array = NDArray[np.float64]
T = hand_eye_scene("good", views=6).robot_poses.T_base_gripper
t, R = T[:, :3, 3], T[:, :3, :3]
XYZW = rotations.quaternion_xyzw_from_matrix(R)
WXYZ = np.roll(XYZW, 1, axis=1)


def degrees(order: str) -> Array:
    return rotations.euler_from_matrix(R, order=order, unit="deg")


def lines(pattern: str, *columns: Array) -> str:
    return "".join(pattern % tuple(row) for row in np.column_stack(columns))


ECHO = """header:
  seq: 7
  stamp:
    secs: 1700000000
    nsecs: 0
  frame_id: "base"
pose:
  position:
    x: %.9g
    y: %.9g
    z: %.9g
  orientation:
    x: %.9g
    y: %.9g
    z: %.9g
    w: %.9g
---
"""
POINT = """P[1]{
   GP1:
    UF : 0, UT : 1,
    X = %.5f mm, Y = %.5f mm, Z = %.5f mm,
    W = %.5f deg, P = %.5f deg, R = %.5f deg
};
"""
TARGET = "CONST robtarget p:=[[%.6f,%.6f,%.6f],[%.9f,%.9f,%.9f,%.9f],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];\n"
TF = "At time 1.0\n- Translation: [%.9g, %.9g, %.9g]\n- Rotation: in Quaternion [%.9g, %.9g, %.9g, %.9g]\n"
PRINTS: dict[str, str] = {
    "echo.txt": lines(ECHO, t, XYZW),
    "tf.txt": lines(TF, t, XYZW),
    "ur.txt": lines("p[%.9g, %.9g, %.9g, %.9g, %.9g, %.9g]\n", t, so3.log(R)),
    "list.txt": lines("[%.9g, %.9g, %.9g, %.9g, %.9g, %.9g, %.9g]\n", t, XYZW),
    "kuka.dat": lines("DECL E6POS XP={X %.6f,Y %.6f,Z %.6f,A %.6f,B %.6f,C %.6f,S 6,T 27}\n", 1e3 * t, degrees("ZYX")),
    "fanuc.ls": "/PROG P\n/POS\n" + lines(POINT, 1e3 * t, degrees("xyz")) + "/END\n",
    "abb.mod": "MODULE P\n" + lines(TARGET, 1e3 * t, WXYZ) + "ENDMODULE\n",
    "lines.jsonl": "".join(json.dumps({"id": k, "pose": M.tolist()}) + "\n" for k, M in enumerate(T)),
    "print.txt": "\n".join(str(M) for M in np.round(T, 8)),
    "repr.txt": "\n".join(repr(M) for M in T),
    "trailing.csv": "x,y,z,qx,qy,qz,qw,\n" + lines("%.9g,%.9g,%.9g,%.9g,%.9g,%.9g,%.9g,\n", t, XYZW),
}


def closest(path: Path) -> float:
    """Largest element by which the notation nearest to the truth differs from it."""
    found = notations(read_poses(path))
    return min(float(np.abs(r.T_base_gripper - T).max()) for r in found if r.T_base_gripper.shape == T.shape)


@pytest.mark.parametrize("name", PRINTS)
def test_prints_are_read(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text(PRINTS[name])
    with np.printoptions(precision=8):
        assert closest(tmp_path / name) < 1e-6  # what was printed was rounded to 1e-8 and 1e-5 mm or deg


@pytest.mark.parametrize("array", [T, T[:, :3], T.reshape(-1, 16), np.column_stack([t, XYZW])])
def test_numpy_files_are_read(tmp_path: Path, array: Array) -> None:
    np.save(tmp_path / "poses.npy", array)
    assert closest(tmp_path / "poses.npy") < 1e-12
    np.savez(tmp_path / "poses.npz", T_base_gripper=array)
    assert closest(tmp_path / "poses.npz") < 1e-12


def test_pairs_of_arrays_and_of_easy_handeye(tmp_path: Path) -> None:
    np.savez(tmp_path / "pairs.npz", T_base_gripper=T, T_camera_target=T[::-1])

    def fields(k: int) -> dict:
        position = dict(zip("xyz", map(float, t[k])))
        return {"translation": position, "rotation": dict(zip("xyzw", map(float, XYZW[k])))}

    samples = [{"robot": fields(k), "tracking": fields(5 - k)} for k in range(6)]
    (tmp_path / "samples.yaml").write_text(yaml.safe_dump({"samples": samples}))
    for name in ("pairs.npz", "samples.yaml"):
        raw = read_poses(tmp_path / name)
        assert raw.target is not None
        np.testing.assert_allclose(notations(raw)[0].T_base_gripper, T, atol=1e-12)
        np.testing.assert_allclose(notations(raw.target)[0].T_base_gripper, T[::-1], atol=1e-12)


def broken_print(path: Path) -> None:
    path.write_text(PRINTS["ur.txt"].replace("p[", "p[oops ", 1))


def broken_json(path: Path) -> None:
    rows = PRINTS["lines.jsonl"].splitlines()
    rows[2] = rows[2].replace("[[", "[[,")
    path.write_text("\n".join(rows))


def an_object(path: Path) -> None:
    np.save(path, np.array([{"a": 1}], dtype=object))


def damaged_header(path: Path) -> None:
    np.save(path, T)
    path.write_bytes(path.read_bytes().replace(b"}", b" ", 1))


def text_of_no_poses(path: Path) -> None:
    path.write_text("[[ 1.0 2.0 ]\n [ 3.0 4.0 ]]\n")


@pytest.mark.parametrize(
    ("name", "write", "words"),
    [
        ("ur.txt", broken_print, "ur.txt:1"),
        ("lines.jsonl", broken_json, "lines.jsonl:3: not JSON"),
        ("object.npy", an_object, "holds Python objects, a pickle"),
        ("flat.npy", lambda p: np.save(p, np.arange(7.0)), r"shape \(7,\)"),
        ("words.npy", lambda p: np.save(p, np.array([["a", "b"]])), "expected numbers"),
        ("cut.npz", lambda p: p.write_bytes(b"PK\x03\x04 and no more"), "cannot be read as NumPy"),
        ("header.npy", damaged_header, "header.npy cannot be read .*: its header is damaged"),
        ("uneven.npz", lambda p: np.savez(p, robot=T, target=T[:4]), "arrays of different lengths"),
        ("small.txt", text_of_no_poses, r"small\.txt\[0\]: 2 numbers, expected 6 or 7"),
    ],
)
def test_what_is_no_print_is_refused_with_the_place(
    tmp_path: Path, name: str, write: Callable[[Path], object], words: str
) -> None:
    write(tmp_path / name)
    with pytest.raises(InputError, match=words):
        read_poses(tmp_path / name)
