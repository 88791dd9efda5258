"""Poses as NumPy 2 prints them, under labels, in parts, as result files: the same numbers come back."""

from __future__ import annotations

import json
import pickle
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from calibrant.data import CalibrationResult, ViewResult
from calibrant.errors import InputError
from calibrant.formats.poses.notations import notations
from calibrant.formats.poses.read import RawPoses, read_poses
from calibrant.geometry import rotations, se3, so3
from calibrant.reading.notes import heard

RNG = np.random.default_rng(5)
T = np.array([se3.make(so3.exp(RNG.normal(0, 0.8, 3)), RNG.normal(0, 0.3, 3)) for _ in range(6)])
S = np.array([se3.make(so3.exp(RNG.normal(0, 0.8, 3)), RNG.normal(0, 0.3, 3)) for _ in range(6)])
ROWS = np.column_stack([T[:, :3, 3], rotations.quaternion_xyzw_from_matrix(T[:, :3, :3])])
TARGETS = np.column_stack([S[:, :3, 3], rotations.quaternion_xyzw_from_matrix(S[:, :3, :3])])


def has(raw: RawPoses | None, expected: np.ndarray) -> bool:
    assert raw is not None
    return any(np.allclose(n.T_base_gripper, expected, atol=1e-9) for n in notations(raw))


def numpy2(rows: np.ndarray) -> str:
    return "[" + ", ".join("[" + ", ".join(f"np.float64({v!r})" for v in row) + "]" for row in rows.tolist()) + "]"


def lines(M: np.ndarray) -> str:
    return "\n".join(" ".join(map(repr, row)) for row in M.tolist())


PRINTS = {
    "scalars": numpy2(ROWS),
    "named": f"robot_poses = {ROWS.tolist()}",
    "typed": f"import numpy as np\nposes: list[list[float]] = np.array({ROWS.tolist()}, dtype=np.float32)  # one\n",
    "array": f"array({np.array2string(T, separator=', ', floatmode='unique')}, dtype=float64)",
    "blanks": f"{np.array2string(T, floatmode='unique', max_line_width=200)}\n",
    "tuples": f"({', '.join(str(tuple(row)) for row in ROWS.tolist())},)",
    "tensor": f"tensor({T.tolist()}, device='cuda:0')",
    "apart": "\n".join(",".join(map(repr, [*M[:3, :3].ravel().tolist(), *M[:3, 3].tolist()])) for M in T),
    "behind": "\n".join(" ".join(map(repr, [*M[:3, 3].tolist(), *M[:3, :3].ravel().tolist()])) for M in T),
    "stamped": "\n".join(
        " ".join(map(repr, [17.25 + i / 7, *M[:3, :3].ravel().tolist(), *M[:3, 3].tolist()])) for i, M in enumerate(T)
    ),
    "labels": "".join(
        f"Pose {i}:\n" + "\n".join(" ".join(map(repr, r)) for r in M.tolist()) + "\n" for i, M in enumerate(T)
    ),
}


@pytest.mark.parametrize("kind", PRINTS)
def test_what_programs_print_is_read(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "poses.txt"
    path.write_text(PRINTS[kind])
    raw = read_poses(path)
    assert has(raw, T)
    assert raw.target is None


def test_pairs_as_programs_print_them(tmp_path: Path) -> None:
    path = tmp_path / "poses.log"
    block = "{} transform:\n{}\n"
    lines = ["starting"]
    for i in range(6):
        for label, M in (("Cam", S[i]), ("EE", T[i])):
            lines.append(block.format(label, "\n".join(" ".join(map(repr, row)) for row in M.tolist())))
    matrix = {
        "R_gripper2base": T[:, :3, :3].tolist(), "t_gripper2base": T[:, :3, 3].tolist(),
        "R_target2cam": S[:, :3, :3].tolist(), "t_target2cam": S[:, :3, 3].tolist(),
    }  # fmt: skip
    texts = {
        "log": "\n".join(lines),
        "py": f"robot_poses = {numpy2(ROWS)}\ncam_poses = {numpy2(TARGETS)}\n",
        "json": json.dumps({"robot_poses": ROWS.tolist(), "cam_poses": TARGETS.tolist(), "board": "a4"}),
        "opencv.json": json.dumps(matrix),
        "numbered.json": json.dumps({f"T{k}_{i}": M[i].tolist() for i in range(6) for k, M in ((1, T), (2, S))}),
    }
    for name, text in texts.items():
        path = tmp_path / f"poses.{name}"
        path.write_text(text)
        with heard() as notes:
            raw = read_poses(path)
        assert has(raw, T), name
        assert has(raw.target, S), name
        said = {
            "json": [f"{path}: not used: board"],
            "numbered.json": [f"{path}: T1 is read as the robot's pose, T2 as the target's"],
        }
        assert notes == said.get(name, []), name
    (tmp_path / "two.log").write_text(texts["log"].replace("EE", "Left").replace("Cam", "Right"))
    with pytest.raises(InputError, match=r"blocks of two kinds, 'Right transform:' and 'Left transform:'"):
        read_poses(tmp_path / "two.log")


def test_an_archive_of_a_matrix_a_pose(tmp_path: Path) -> None:
    path = tmp_path / "poses.npz"
    np.savez(path, **{f"T{k}_{i}": M[i] for i in range(6) for k, M in ((1, T), (2, S))})
    with heard() as notes:
        raw = read_poses(path)
    assert has(raw, T)
    assert has(raw.target, S)
    assert notes == [f"{path}: T1 is read as the robot's pose, T2 as the target's"]
    np.savez(path, **{f"p{i}": M for i, M in enumerate(T)})
    assert has(read_poses(path), T)


def test_a_camera_matrix_beside_poses_is_said(tmp_path: Path) -> None:
    path = tmp_path / "camera.json"
    entries = [{"idx": i, "rvec": so3.log(M[:3, :3]).tolist(), "tvec": M[:3, 3].tolist()} for i, M in enumerate(S)]
    path.write_text(json.dumps({"camera_matrix": np.eye(3).tolist(), "dist_coeffs": [0.0] * 5, "poses": entries}))
    with heard() as notes:
        assert has(read_poses(path), S)
    assert notes == [f"{path}: not used: camera_matrix, dist_coeffs"]


def test_a_pose_in_parts_in_each_of_many_files(tmp_path: Path) -> None:
    for i, M in enumerate(T):
        np.savez(tmp_path / f"p{i}.npz", rvec=so3.log(M[:3, :3])[:, None], tvec=M[:3, 3][:, None])
    assert has(read_poses(tmp_path), T)
    one = tmp_path / "all"
    one.mkdir()
    np.savez(one / "a.npz", rvec=np.array([so3.log(M[:3, :3])[:, None] for M in T]), tvec=T[:, :3, 3][:, :, None])
    assert has(read_poses(one / "a.npz"), T)
    np.savez(one / "b.npz", R=T[0, :3, :3], t=T[0, :3, 3])
    assert has(read_poses(one / "b.npz"), T[:1])


def test_poses_of_a_target_as_pose_writes_them(tmp_path: Path) -> None:
    views = tuple(ViewResult(f"{i}.png", i != 2, 20, T_camera_target=M if i != 2 else None) for i, M in enumerate(S))
    path = CalibrationResult("pose", "ok", views=views).write(tmp_path / "seen.json")
    raw = read_poses(path)
    assert raw.names == ("0.png", "1.png", "3.png", "4.png", "5.png")
    np.testing.assert_allclose(notations(raw)[0].T_base_gripper, np.delete(S, 2, axis=0), atol=1e-12)
    with pytest.raises(InputError, match="the intrinsics result holds no poses"):
        read_poses(CalibrationResult("intrinsics", "ok").write(tmp_path / "camera.json"))


def test_other_programs_files_are_refused_by_name(tmp_path: Path) -> None:
    (tmp_path / "poses.pkl").write_bytes(pickle.dumps(ROWS.tolist()))
    (tmp_path / "poses.txt").write_bytes(pickle.dumps(ROWS))
    for name in ("poses.pkl", "poses.txt"):
        with pytest.raises(InputError, match=rf"{name} is a Python pickle: reading one can run any program"):
            read_poses(tmp_path / name)
    (tmp_path / "poses.mat").write_bytes(b"MATLAB 5.0 MAT-file, Platform: GLNXA64" + bytes(200))
    with pytest.raises(InputError, match=r"is a MATLAB file: write the numbers as text"):
        read_poses(tmp_path / "poses.mat")


def test_the_cases_from_the_field(shared_case: Callable[[str], Path]) -> None:
    folder = shared_case("08-pose-texts")
    tables = [read_poses(folder / f"robot.{end}") for end in ("csv", "npq.txt", "npq_assign.txt")]
    for table in tables[1:]:
        np.testing.assert_allclose(
            notations(table)[0].T_base_gripper, notations(tables[0])[0].T_base_gripper, atol=2e-3
        )
    pairs = read_poses(folder / "clean.log")
    assert pairs.target is not None
    assert (len(pairs), len(pairs.target)) == (12, 12)
