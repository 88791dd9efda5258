"""`calibrant hand-eye`: from photos and poses to a transform, and every way in which they do not fit together."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

import calibrant as cb
from calibrant.simulate.scenes import hand_eye_scene

TARGET = "chessboard:7x6:30mm"


def refused(outcome, status: int, *words: str, causes: int = 1) -> None:
    """One message for a person on standard error, a line for each cause, nothing on standard output, and the status
    promised."""
    assert outcome.status == status, outcome.err
    assert outcome.out == ""
    assert outcome.err.startswith("calibrant: ")
    assert outcome.err.count("\n") == causes
    assert "Traceback" not in outcome.err
    assert "internal error" not in outcome.err
    for word in words:
        assert word in outcome.err


def pose_pairs(path: Path, robot: Sequence, target: Sequence) -> Path:
    path.write_text(json.dumps([[np.asarray(a).tolist(), np.asarray(b).tolist()] for a, b in zip(robot, target)]))
    return path


@pytest.fixture
def rows(cell) -> list[str]:
    return cell.poses.read_text().splitlines()


@pytest.fixture
def attempt(calibrant, found: Path, tmp_path: Path) -> Callable:
    """The command on the cell's points with poses of these lines of CSV."""

    def run(lines: Sequence[str], *arguments: object):
        poses = tmp_path / "attempt.csv"
        poses.write_text("\n".join(lines) + "\n")
        return calibrant("hand-eye", "--observations", found, "--poses", poses, *arguments)

    return run


def test_photos_and_poses_to_the_camera_on_the_gripper(calibrant, cell, tmp_path: Path, untouched) -> None:
    out, page = tmp_path / "hand-eye.json", tmp_path / "hand-eye.html"
    outcome = calibrant(
        "hand-eye", "--images", *cell.photos, "--poses", cell.poses, "--target", TARGET, "--out", out, "--report", page
    )
    assert (outcome.status, outcome.err) == (0, "")
    assert "T_gripper_camera" in outcome.out
    assert "±" in outcome.out
    assert "left out: left out" not in outcome.out
    result = cb.read(out)
    T = result.transform("gripper", "camera")
    assert result.decided["setup"] == "eye-in-hand"
    assert result.options["setup"] == "auto"
    # 8 views of 0.05 mm and 0.01 degrees: 5 sigma and nothing on top.
    assert np.all(np.abs(1e3 * (T.matrix[:3, 3] - cell.X[:3, 3])) < 5 * T.sigma_translation_mm)
    assert np.linalg.norm(T.sigma_translation_mm) < 1.0
    assert {"park", "daniilidis", "shah", "li", "joint"} <= set(result.methods)
    assert result.held_out is not None
    assert page.stat().st_size > 10_000
    again = calibrant("report", out, "--out", tmp_path / "later.html", "-q")
    assert (again.status, again.out, again.err) == (0, "", "")
    untouched()


def test_poses_in_another_order_and_without_names(calibrant, found: Path, rows: list[str], attempt) -> None:
    named = json.loads(attempt([rows[0], *rows[:0:-1]], "--json").out)
    by_order = json.loads(attempt([r.split(",", 1)[1] for r in rows], "--json").out)
    assert by_order["transforms"][0]["matrix"] == pytest.approx(np.array(named["transforms"][0]["matrix"]), abs=1e-9)


def test_a_known_camera_is_used(calibrant, cell, found: Path, tmp_path: Path, attempt, rows: list[str]) -> None:
    camera = tmp_path / "camera.json"
    assert calibrant("intrinsics", "--observations", found, "--out", camera, "-q").status == 0
    result = json.loads(attempt(rows, "--camera", camera, "--json").out)
    assert result["decided"]["camera"] == "given with its covariance, refined jointly"
    assert str(camera) in {i["file"] for i in result["inputs"]}


def test_poses_of_images_that_are_not_there_are_left_out_and_said(rows: list[str], attempt) -> None:
    extra = rows[1].replace("00.png", "99.png")
    result = json.loads(attempt([*rows, extra], "--json").out)
    (pairing,) = [c for c in result["checks"] if c["name"] == "pairing"]
    assert "99.png" in pairing["message"]


def test_images_without_a_pose(calibrant, cell, rows: list[str], tmp_path: Path, untouched) -> None:
    poses = tmp_path / "short.csv"
    poses.write_text("\n".join(rows[:-2]))
    outcome = calibrant("hand-eye", "--images", cell.images, "--poses", poses, "--target", TARGET)
    refused(outcome, 2, "2 of 8 images have no robot pose: 06.png, 07.png", "--exclude")
    untouched()


def test_counts_that_differ_without_names(rows: list[str], attempt) -> None:
    refused(attempt([r.split(",", 1)[1] for r in rows[:-1]]), 2, "7 poses and 8 images", "paired by order")


def edited(line: str, **values: str) -> str:
    fields = dict(zip(["image", "x", "y", "z", "qx", "qy", "qz", "qw"], line.split(",")))
    return ",".join((fields | values).values())


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"x": "nan"}, (":2", "NaN")),
        ({"x": "inf"}, (":2", "infinity")),
        ({"y": "abc"}, (":2", "column 'y'", "'abc'")),
        ({"qx": "0", "qy": "0", "qz": "0", "qw": "0"}, (":2", "norm 0")),
        ({"qx": "1", "qy": "1", "qz": "1", "qw": "1"}, (":2", "norm is 2", "expected 1")),
        ({"image": "01.png"}, ("'01.png' occurs twice",)),
    ],
)
def test_poses_that_are_no_poses(rows: list[str], attempt, values: dict[str, str], words: tuple[str, ...]) -> None:
    refused(attempt([rows[0], edited(rows[1], **values), *rows[2:]]), 2, *words)


@pytest.mark.parametrize(
    ("block", "words"),
    [
        (np.diag([2.0, 1, 1]), ("[3]", "not a rotation")),
        (np.diag([-1.0, 1, 1]), ("[3]", "mirrors")),
        (np.full((3, 3), np.nan), ("NaN",)),
        (np.zeros((3, 3)), ("not a rotation",)),
    ],
)
def test_matrices_that_are_no_rotations(calibrant, tmp_path: Path, block: np.ndarray, words: tuple[str, ...]) -> None:
    scene = hand_eye_scene()
    robot = scene.robot_poses.T_base_gripper.copy()
    robot[3, :3, :3] = block
    path = pose_pairs(tmp_path / "pairs.json", robot, scene.measured_T_camera_target)
    refused(calibrant("hand-eye", "--poses", path), 2, *words)


@pytest.mark.parametrize(
    ("scene", "name"),
    [("parallel-axes", "parallel-axes"), ("pure-translation", "pure-translation"), ("two-poses", "poses: 2")],
)
@pytest.mark.parametrize("setup", ["auto", "eye-in-hand"])
def test_motions_that_determine_nothing_are_refused_by_name(
    calibrant, tmp_path: Path, scene: str, name: str, setup: str
) -> None:
    data = hand_eye_scene(scene)
    path = pose_pairs(tmp_path / "pairs.json", data.robot_poses.T_base_gripper, data.measured_T_camera_target)
    out = tmp_path / "result.json"
    refused(calibrant("hand-eye", "--poses", path, "--setup", setup, "--out", out), 1, f"calibrant: {name}")
    assert not out.exists()


def test_fewer_than_three_photos(calibrant, cell, found: Path, tmp_path: Path) -> None:
    camera = tmp_path / "camera.json"
    assert calibrant("intrinsics", "--observations", found, "--out", camera, "-q").status == 0
    outcome = calibrant(
        "hand-eye", "--images", *cell.photos[:2], "--poses", cell.poses, "--target", TARGET, "--camera", camera
    )
    refused(outcome, 1, "at least 3")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], ("--images with --target", "--target-poses")),
        (["--target", TARGET], ("no photos", "--images")),
        (["--camera", "camera.json"], ("--camera goes with photos",)),
        (["--images", "none", "--target", TARGET], ("none does not exist",)),
        (["--setup", "static"], ("unknown setup 'static'", "eye-to-hand")),
        (["--pose-rotation", "euler"], ("unknown rotation", "euler:ZYX")),
        (["--pose-units", "parsec"], ("parsec",)),
    ],
)
def test_arguments_that_do_not_go_together(calibrant, cell, arguments: list[str], words: tuple[str, ...]) -> None:
    refused(calibrant("hand-eye", "--poses", cell.poses, *arguments), 2, *words)


def test_photos_without_the_board_they_show(calibrant, cell) -> None:
    refused(calibrant("hand-eye", "--images", cell.images, "--poses", cell.poses), 2, "--target")


@pytest.mark.parametrize("content", ["", "image,x,y,z,qx,qy,qz,qw\n", "{", "\x00\x01\x02"])
def test_files_without_poses(calibrant, found: Path, tmp_path: Path, content: str) -> None:
    poses = tmp_path / "poses.csv"
    poses.write_text(content)
    refused(calibrant("hand-eye", "--observations", found, "--poses", poses), 2, "poses.csv")
    refused(calibrant("hand-eye", "--observations", found, "--poses", tmp_path / "none.csv"), 2, "none.csv")


def test_inputs_are_never_written_over(calibrant, cell, found: Path, untouched: Callable[[], None]) -> None:
    for arguments in (("--observations", found), ("--images", cell.images, "--target", TARGET)):
        outcome = calibrant("hand-eye", *arguments, "--poses", cell.poses, "--out", cell.poses, "--force")
        refused(outcome, 2, "poses.csv is an input")
    untouched()


def test_shifted_pairs_are_refused(rows: list[str], attempt) -> None:
    names, poses = [r.split(",", 1)[0] for r in rows[1:]], [r.split(",", 1)[1] for r in rows[1:]]
    shifted = [f"{name},{pose}" for name, pose in zip(names, [*poses[1:], poses[0]])]
    refused(attempt([rows[0], *shifted]), 1, "one row too early", "--apply", causes=2)


def test_pose_pairs_given_in_two_files(calibrant, tmp_path: Path) -> None:
    scene = hand_eye_scene(setup="eye-to-hand")
    robot, target = tmp_path / "robot.json", tmp_path / "target.json"
    robot.write_text(json.dumps(scene.robot_poses.T_base_gripper.tolist()))
    target.write_text(json.dumps(scene.measured_T_camera_target.tolist()))
    result = json.loads(calibrant("hand-eye", "--poses", robot, "--target-poses", target, "--json").out)
    (pairing,) = [c["message"] for c in result["checks"] if c["name"] == "pairing"]
    assert pairing == "15 robot poses and 15 target poses paired by order"
    assert result["transforms"][0]["child"] == "camera"
    target.write_text(json.dumps(scene.measured_T_camera_target[:-1].tolist()))
    refused(calibrant("hand-eye", "--poses", robot, "--target-poses", target), 2, "15 robot poses and 14 target poses")


def test_a_static_camera_and_a_charuco_board_by_one_command(
    calibrant, shared_data: Callable[[str], Path], tmp_path: Path
) -> None:
    folder = shared_data("handeye_rct_charuco_static")
    images, poses = sorted((folder / "images").iterdir()), sorted((folder / "poses").iterdir())
    outcome = calibrant(
        "hand-eye", "--images", *images, "--poses", *poses,
        "--target", "charuco:5x7:36.195mm:18.256mm:DICT_6X6_250", "--json",
    )  # fmt: skip
    assert outcome.status == 0, outcome.err
    result = json.loads(outcome.out)
    position = 1e3 * np.array(result["transforms"][0]["matrix"])[:3, 3]
    assert (result["transforms"][0]["parent"], result["transforms"][0]["child"]) == ("base", "camera")
    assert np.linalg.norm(position - [-18.9, 1265.7, 287.8]) < 5
    joint = result["methods"]["joint"]
    assert joint["loop_rms_mm"] <= 1.5
    assert joint["loop_rms_deg"] <= 0.2
    flagged = {v["id"] for v in result["views"] if v["reason"]}
    assert {"2.png", "15.png"} <= flagged  # overexposed; far away and facing the camera
    (pairing,) = [c["message"] for c in result["checks"] if c["name"] == "pairing"]
    assert "4 poses have no image" in pairing


@pytest.mark.long
def test_pose_pairs_of_a_real_cell_in_the_right_setup_and_the_wrong(
    calibrant, shared_data: Callable[[str], Path]
) -> None:
    pairs = shared_data("handeye_moveit_poses") / "pose_samples.json"
    result = json.loads(calibrant("hand-eye", "--poses", pairs, "--json").out)
    assert result["decided"]["setup"] == "eye-to-hand"
    position = 1e3 * np.array(result["transforms"][0]["matrix"])[:3, 3]
    assert np.linalg.norm(position - [659.5, -250.1, 830.3]) < 1.5
    refused(calibrant("hand-eye", "--poses", pairs, "--setup", "eye-in-hand"), 1, "--setup eye-to-hand")


def test_a_closed_form_by_name(calibrant, tmp_path: Path) -> None:
    scene = hand_eye_scene("good", setup="eye-to-hand", seed=5)
    path = pose_pairs(tmp_path / "pairs.json", scene.robot_poses.T_base_gripper, scene.measured_T_camera_target)
    joint = json.loads(calibrant("hand-eye", "--poses", path, "--json").out)
    for method in ("park", "tsai", "mean"):
        result = json.loads(calibrant("hand-eye", "--poses", path, "--method", method, "--json").out)
        assert result["transforms"][0]["matrix"] == joint["methods"][method]["matrix"]
        assert result["transforms"][0].get("covariance") is None
        assert result["verdict"] == "warn"
        assert any(c["name"] == "method" and method in c["message"] for c in result["checks"])


def test_a_file_named_twice_is_no_calibration(calibrant, tmp_path: Path) -> None:
    scene = hand_eye_scene("good", setup="eye-to-hand", seed=5)
    pairs = pose_pairs(tmp_path / "pairs.json", scene.robot_poses.T_base_gripper, scene.measured_T_camera_target)
    robot = tmp_path / "robot.json"
    robot.write_text(json.dumps(scene.robot_poses.T_base_gripper.tolist()))
    refused(calibrant("hand-eye", "--poses", pairs, "--target-poses", pairs), 2, "holds pairs")
    refused(calibrant("hand-eye", "--poses", robot, "--target-poses", pairs), 2, "--target-poses")
    refused(calibrant("hand-eye", "--poses", robot, "--target-poses", robot), 1, "same-poses", "T_camera_target")


def test_methods_that_cannot_be(calibrant, tmp_path: Path) -> None:
    scene = hand_eye_scene("good", setup="eye-to-hand", seed=5)
    path = pose_pairs(tmp_path / "pairs.json", scene.robot_poses.T_base_gripper, scene.measured_T_camera_target)
    refused(
        calibrant("hand-eye", "--poses", path, "--method", "ransack"), 2, "unknown method 'ransack'; known: joint, tsai"
    )
    volume = ("--workspace", "100mm:200mm,100mm:200mm,100mm:200mm")
    refused(calibrant("hand-eye", "--poses", path, "--method", "park", *volume), 2, "--workspace")
