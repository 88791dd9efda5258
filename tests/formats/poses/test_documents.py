"""JSON and YAML poses, matrices, pairs, one file a pose, and the real files of other projects."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml

from calibrant.errors import InputError
from calibrant.formats.poses.read import notations, read_poses
from calibrant.geometry import rotations, se3, so3

T = se3.make(so3.random(np.random.default_rng(8), 3), [[0.5, -0.25, 0.75], [0.4, 0.1, 0.6], [-0.3, 0.2, 0.9]])
XYZW = rotations.quaternion_xyzw_from_matrix(T[:, :3, :3]).tolist()
WXYZ = rotations.quaternion_wxyz_from_matrix(T[:, :3, :3]).tolist()
P = T[:, :3, 3].tolist()
RANGE = range(3)


def named(keys: str, values: list[float]) -> dict[str, float]:
    return dict(zip(keys.split(), values))


DOCUMENTS: dict[str, Any] = {
    "list of fields": [named("x y z qx qy qz qw", P[i] + XYZW[i]) for i in RANGE],
    "ROS pose": [{"position": named("x y z", P[i]), "orientation": named("x y z w", XYZW[i])} for i in RANGE],
    "ROS stamped": [
        {
            "header": {"frame_id": "base"},
            "pose": {"position": named("x y z", P[i]), "orientation": named("x y z w", XYZW[i])},
        }
        for i in RANGE
    ],
    "ROS transform": [
        {"transform": {"translation": named("x y z", P[i]), "rotation": named("x y z w", XYZW[i])}} for i in RANGE
    ],
    "lists": [{"translation": P[i], "rotation": XYZW[i]} for i in RANGE],
    "named order": [{"position": P[i], "quaternion_wxyz": WXYZ[i]} for i in RANGE],
    "R and t": [{"R": T[i, :3, :3].tolist(), "t": P[i]} for i in RANGE],
    "rvec and tvec": [{"rvec": so3.log(T[i, :3, :3]).tolist(), "tvec": P[i]} for i in RANGE],
    "rpy": [
        {"xyz": P[i], "rpy": rotations.euler_from_matrix(T[i, :3, :3], order="xyz", unit="rad").tolist()} for i in RANGE
    ],
    "under a key": {"robot": "arm", "poses": [named("x y z qx qy qz qw", P[i] + XYZW[i]) for i in RANGE]},
    "by name": {f"p{i}": {"pose": named("qw qx qy qz x y z", WXYZ[i] + P[i]), "joints": [1, 2]} for i in RANGE},
    "matrices": T.tolist(),
    "matrices under a key": {"T_base_gripper": T.tolist()},
    "matrix a field": [{"image": f"{i}.png", "T_base_gripper": T[i].tolist()} for i in RANGE],
    "16 numbers": T.reshape(3, 16).tolist(),
    "16 numbers by columns": np.swapaxes(T, 1, 2).reshape(3, 16).tolist(),
    "3x4": T[:, :3].tolist(),
    "7 numbers": [P[i] + XYZW[i] for i in RANGE],
    "numbers as texts": [named("x y z qx qy qz qw", [str(v) for v in P[i] + XYZW[i]]) for i in RANGE],  # type: ignore[misc]
}


@pytest.mark.parametrize("syntax", ["json", "yaml"])
@pytest.mark.parametrize("document", DOCUMENTS)
def test_every_document_gives_the_same_poses(tmp_path: Path, document: str, syntax: str) -> None:
    path = tmp_path / f"p.{syntax}"
    data = DOCUMENTS[document]
    path.write_text(json.dumps(data) if syntax == "json" else yaml.safe_dump(data))
    raw = read_poses(path)
    np.testing.assert_allclose(notations(raw)[0].T_base_gripper, T, atol=1e-12)


def test_what_keys_state_is_kept(tmp_path: Path) -> None:
    path = tmp_path / "p.json"
    for key, direction in (
        ("T_base_gripper", "base-gripper"),
        ("T_gripper_base", "gripper-base"),
        ("gripper2base", "base-gripper"),
    ):
        path.write_text(json.dumps([{"image": f"{i}.png", key: T[i].tolist()} for i in RANGE]))
        raw = read_poses(path)
        assert raw.stated.direction == direction
        assert raw.names == ("0.png", "1.png", "2.png")
        assert notations(raw)[0].direction == direction


def test_pairs_give_target_poses_too(tmp_path: Path) -> None:
    path = tmp_path / "p.json"
    B = se3.inverse(T)
    for data in (
        [[T[i].tolist(), B[i].tolist()] for i in RANGE],
        [{"effector_wrt_world": T[i].ravel().tolist(), "object_wrt_sensor": B[i].ravel().tolist()} for i in RANGE],
    ):
        path.write_text(json.dumps(data))
        raw = read_poses(path)
        assert raw.target is not None
        np.testing.assert_allclose(notations(raw)[0].T_base_gripper, T, atol=1e-12)
        np.testing.assert_allclose(notations(raw.target)[0].T_base_gripper, B, atol=1e-12)


def test_opencv_matrices_are_read(tmp_path: Path) -> None:
    for suffix in ("yml", "xml", "json"):
        path = tmp_path / f"p.{suffix}"
        storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
        for i in RANGE:
            storage.write(f"pose{i}", T[i])
        storage.release()
        raw = read_poses(path)
        assert raw.names == ("pose0", "pose1", "pose2")
        np.testing.assert_allclose(notations(raw)[0].T_base_gripper, T, atol=1e-12)


def test_one_file_a_pose_in_natural_order(tmp_path: Path) -> None:
    order = [2, 0, 1]
    for i, name in zip(order, ("10", "1", "2")):
        (tmp_path / f"{name}.yaml").write_text(yaml.safe_dump(named("x y z qx qy qz qw", P[i] + XYZW[i])))
    for given in (tmp_path, str(tmp_path / "*.yaml"), [tmp_path / "10.yaml", tmp_path / "1.yaml", tmp_path / "2.yaml"]):
        raw = read_poses(given)
        assert raw.names == ("1", "2", "10")
        np.testing.assert_allclose(notations(raw)[0].T_base_gripper, T, atol=1e-12)


def test_4x4_text_files_are_one_pose_each(tmp_path: Path) -> None:
    for i in RANGE:
        np.savetxt(tmp_path / f"pose_{i}.txt", T[i], fmt="%.17g")
    raw = read_poses(tmp_path)
    assert raw.names == ("pose_0", "pose_1", "pose_2")
    np.testing.assert_allclose(notations(raw)[0].T_base_gripper, T, atol=1e-12)


def test_a_list_that_names_pose_files_is_followed(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text(yaml.safe_dump(named("x y z qx qy qz qw", P[0] + XYZW[0])))
    (tmp_path / "list.yaml").write_text(yaml.safe_dump([{"pose": "a.yaml", "image": "images/a.png"}]))
    raw = read_poses(tmp_path / "list.yaml")
    assert raw.names == ("images/a.png",)
    np.testing.assert_allclose(notations(raw)[0].T_base_gripper, T[:1], atol=1e-12)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[", r"p\.json:1: not JSON"),
        ("[]", "the list is empty"),
        ("3", "expected a list of poses"),
        ('{"a": 1}', "no poses under the keys 'a'"),
        ('[{"x": 1, "y": 2, "z": 3}]', "no complete set of columns for the rotation; found the columns 'x', 'y', 'z'"),
        ('[{"x": "left", "y": 2, "z": 3, "qx": 0, "qy": 0, "qz": 0, "qw": 1}]', r"p\.json\[0\]: column 'x' is 'left'"),
        ('[[1, 2, 3, 0, 0, 0, {"w": 1}]]', r"p\.json\[0\]: column .* is \{'w': 1\}, expected a number"),
        ("[[1, 2, 3], [1, 2, 3]]", r"p\.json\[0\]: 3 numbers, expected 6 or 7"),
        ("[[[1, 0], [0, 1]]]", r"p\.json\[0\]: rows of \[2, 2\] numbers, expected a 4x4 matrix"),
        (
            '[{"position": [1,2,3], "rotation": [0,0,0,1]}, {"position": [1,2,3]}]',
            r"p\.json\[1\]: no .*; expected the fields of the first pose",
        ),
        ('[{"position": [1,2,3], "rotation": [0,0,0,0]}]', r"p\.json\[0\]: a quaternion of norm 0"),
        ('[{"position": [1,2,NaN], "rotation": [0,0,0,1]}]', r"p\.json\[0\]: NaN or infinity"),
        ("[[[1,0,0,0],[0,1,0,0],[0,0,-1,0],[0,0,0,1]]]", r"determinant -1: it mirrors"),
        ("[[[1,0,0,5],[0,1,0,0],[0,0,1,0],[1,0,0,1]]]", r"last row of the 4x4 matrix is \[1\.0, 0\.0, 0\.0, 1\.0\]"),
        ('[{"image": "a", "pose": "missing.yaml"}]', r"pose file .*missing\.yaml does not exist"),
    ],
)
def test_what_is_wrong_is_named_by_file_and_entry(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "p.json"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        read_poses(path)


def test_files_that_cannot_be_used_are_said(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file, and no file matches"):
        read_poses(tmp_path / "none.csv")
    with pytest.raises(InputError, match="a folder without pose files"):
        read_poses(tmp_path)
    with pytest.raises(InputError, match="no file of poses given"):
        read_poses([])
    (tmp_path / "a.bin").write_bytes(b"\0\1\2")
    with pytest.raises(InputError, match="a binary file"):
        read_poses(tmp_path / "a.bin")
    (tmp_path / "a.yaml").write_text("x: [1\ny: 2")
    with pytest.raises(InputError, match=r"a\.yaml:2: not YAML"):
        read_poses(tmp_path / "a.yaml")
    (tmp_path / "a.yaml").write_text("{x: 1, y: 2, z: 3, qx: 0, qy: 0, qz: 0, qw: 1}")
    (tmp_path / "b.csv").write_text("x,y,z,qx,qy,qz,qw\n1,2,3,0,0,0,1\n1,2,3,0,0,0,1\n")
    with pytest.raises(InputError, match=r"b\.csv: 2 poses; where several files are given, each holds one pose"):
        read_poses([tmp_path / "a.yaml", tmp_path / "b.csv"])
    (tmp_path / "b.csv").write_text("x,y,z,rx,ry,rz\n1,2,3,0,0,0\n")
    with pytest.raises(InputError, match=r"b\.csv: has x, y, z, rx, ry, rz; the first file"):
        read_poses([tmp_path / "a.yaml", tmp_path / "b.csv"])


def test_the_real_files_are_read(shared_data: Callable[[str], Path]) -> None:
    moveit = read_poses(shared_data("handeye_moveit_poses") / "pose_samples.json")
    assert len(moveit) == 50
    assert moveit.target is not None
    np.testing.assert_allclose(moveit.translation[0], [0.263275187959874, 0.11594185945790944, 0.03908420968284165])
    rct = read_poses(shared_data("handeye_rct_charuco_static") / "poses")
    assert rct.names == tuple(str(i) for i in range(16))
    np.testing.assert_allclose(rct.translation[6], [-0.1180929332711085, 0.8228186736370173, 0.5466667720320662])
    assert rct.stated.rotation == "quat-xyzw"
    listed = read_poses(shared_data("handeye_rct_circles_eih") / "cal_data.yaml")
    assert listed.names is not None
    assert set(listed.names) == {f"images/{i}.png" for i in range(15)}
    positioner = read_poses(shared_data("kinematic_rct_positioner") / "positioner_kinematic_measurements.yaml")
    assert len(positioner) == 205


def test_matrices_with_rows_and_columns_beside_their_numbers(tmp_path: Path) -> None:
    for i in range(3):
        numbers = "".join(f"  - [{v}]\n" for v in (0.4, -0.2, 0.3, 3.1, 0.1, i))
        (tmp_path / f"pose_{i}.yaml").write_text(f"rows: 6\ncols: 1\ndata:\n{numbers}")
    raw = read_poses(str(tmp_path / "pose_*.yaml"))
    np.testing.assert_array_equal(raw.rotation, [[3.1, 0.1, i] for i in range(3)])
    matrix = tmp_path / "one.yaml"
    matrix.write_text("rows: 4\ncols: 4\ndata: [1, 0, 0, 0.1, 0, 1, 0, 0.2, 0, 0, 1, 0.3, 0, 0, 0, 1]\n")
    np.testing.assert_array_equal(read_poses(matrix).translation, [[0.1, 0.2, 0.3]])


def test_a_folder_a_pose_with_what_solve_pnp_found_beside_it(tmp_path: Path) -> None:
    for i in RANGE:
        (tmp_path / str(i)).mkdir()
        entry = {
            "joint_pose": [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7],
            "O_T_EE": T[i].ravel().tolist(),
            "camera_intrinsics": np.eye(3).tolist(),
            "detected": True,
            "T_cam_target_rvec": so3.log(T[2 - i, :3, :3])[:, None].tolist(),
            "T_cam_target_tvec": T[2 - i, :3, 3:].tolist(),
        }
        (tmp_path / str(i) / "data.json").write_text(json.dumps(entry))
    raw = read_poses(str(tmp_path / "*" / "data.json"))
    assert raw.names == ("0/data", "1/data", "2/data")
    np.testing.assert_allclose(notations(raw)[0].T_base_gripper, T, atol=1e-12)
    assert raw.target is not None
    np.testing.assert_allclose(notations(raw.target)[0].T_base_gripper, T[::-1], atol=1e-12)
    (tmp_path / "1" / "data.json").write_text(json.dumps({"O_T_EE": T[1].ravel().tolist()}))
    with pytest.raises(InputError, match="without a target pose, which other files have; 1 of 3 files"):
        read_poses(str(tmp_path / "*" / "data.json"))


@pytest.mark.parametrize(
    "keys", [("gripper2base", "target2cam"), ("hand2base", "board2camera"), ("tool_pose", "tag_pose")]
)
def test_pairs_by_the_names_that_capture_programs_use(tmp_path: Path, keys: tuple[str, str]) -> None:
    def record(pose: np.ndarray) -> dict[str, Any]:
        return {"rotation_matrix": pose[:3, :3].tolist(), "translation": pose[:3, 3].tolist()}

    samples = [
        {"id": f"shot {i}", keys[0]: record(T[i]), "base2hand": record(se3.inverse(T[i])), keys[1]: record(T[2 - i])}
        for i in RANGE
    ]
    (tmp_path / "samples.json").write_text(json.dumps({"samples": samples, "method": "PARK"}))
    raw = read_poses(tmp_path / "samples.json")
    assert raw.target is not None
    np.testing.assert_allclose(notations(raw)[0].T_base_gripper, T, atol=1e-12)
    np.testing.assert_allclose(notations(raw.target)[0].T_base_gripper, T[::-1], atol=1e-12)


def test_pairs_as_numbered_matrices_of_one_file(tmp_path: Path) -> None:
    storage = cv2.FileStorage(str(tmp_path / "samples.yml"), cv2.FILE_STORAGE_WRITE)
    storage.write("count", 3)
    for i in RANGE:
        storage.write(f"gripper2base_{i}", T[i])
        storage.write(f"target2cam_{i}", T[2 - i])
    storage.release()
    raw = read_poses(tmp_path / "samples.yml")
    assert raw.target is not None
    np.testing.assert_allclose(notations(raw)[0].T_base_gripper, T, atol=1e-12)
    np.testing.assert_allclose(notations(raw.target)[0].T_base_gripper, T[::-1], atol=1e-12)
