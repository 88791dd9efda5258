"""The doctor's command: findings on the screen, new files with --apply, the exit status."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from calibrant.cli.application import run
from calibrant.data import RobotPoses
from calibrant.formats.poses.read import notations, read_poses
from calibrant.simulate.noise import flipped_board
from calibrant.simulate.scenes import HandEyeScene, hand_eye_scene
from calibrant.tasks.robots.doctor import csv_text

Array = NDArray[np.float64]


def files(folder: Path, T: Array, B: Array) -> list[str]:
    """Arguments for poses and target poses written in the native form."""
    for name, poses in (("poses.csv", T), ("target.csv", B)):
        ids = tuple(f"{i}.png" for i in range(len(poses)))
        (folder / name).write_text(csv_text(RobotPoses(ids, poses)))
    return ["--poses", str(folder / "poses.csv"), "--target-poses", str(folder / "target.csv")]


@pytest.fixture(scope="module")
def scene() -> HandEyeScene:
    return hand_eye_scene("good", setup="eye-to-hand", views=12)


@pytest.fixture
def faulty(tmp_path: Path, scene: HandEyeScene) -> list[str]:
    """Poses one row late and one board flipped."""
    B = scene.measured_T_camera_target.copy()
    B[4] = flipped_board(scene.points, B[4])
    return files(tmp_path, np.roll(scene.robot_poses.T_base_gripper, 1, axis=0), B)


def test_clean_data(tmp_path: Path, scene: HandEyeScene, capsys: pytest.CaptureFixture[str]) -> None:
    given = files(tmp_path, scene.robot_poses.T_base_gripper, scene.measured_T_camera_target)
    assert run(["doctor", *given]) == 0
    text = capsys.readouterr().out
    assert "nothing wrong found" in text
    assert "Verdict: FIT." in text
    assert text.endswith("hand-eye.html\n")
    # What is to be run next can be copied as it stands.
    command = text.splitlines()[-1].split()
    assert command[:2] == ["calibrant", "hand-eye"]
    assert run([*command[1:-4], "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["kind"] == "hand-eye"


def test_faults_are_named_and_the_status_is_1(
    tmp_path: Path, faulty: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    out, report = tmp_path / "doctor.json", tmp_path / "doctor.html"
    before = {p: p.read_bytes() for p in tmp_path.iterdir()}
    assert run(["doctor", *faulty, "--out", str(out), "--report", str(report)]) == 1
    text = capsys.readouterr()
    assert "FAULT  poses-shifted" in text.out
    assert "board-flipped" in text.out
    assert "proposed: number its corners from the other end" in text.out
    assert text.err.startswith("calibrant: the data are not fit for calibration: poses-shifted")
    assert "--apply" in text.err
    assert "Verdict: REPAIR FIRST. poses-shifted, board-flipped." in text.out
    assert re.search(r"all views, as given +[\d.]+ mm", text.out)
    assert re.search(r"all views, repaired +[\d.]+ mm", text.out)
    assert re.search(r"the views that agree best +[\d.]+ mm", text.out)
    assert text.out.splitlines()[-1].endswith("--apply --out repaired.json --report repaired.html")
    found = json.loads(out.read_text())["details"]["faults"]["found"]
    assert [f["name"] for f in found] == ["poses-shifted", "board-flipped"]
    assert found[1]["views"] == ["4.png"]
    assert found[1]["loop_before"]["mm"] > 10 > found[1]["loop_after"]["mm"]
    page = report.read_text()
    assert "poses-shifted" in page
    assert "REPAIR FIRST" in page
    # The command to run next, with a button that copies it.
    assert re.search(r"data-copy hidden>Copy</button></div>\s*<pre class=\"code\">calibrant \S", page)
    assert page.count("<svg") == 2
    assert re.search(r"https?:", page) is None
    assert "default-src 'none'" in page
    assert {p: p.read_bytes() for p in before} == before  # nothing that was read is touched


def test_a_warning_with_a_cure_is_a_fault_that_stands(
    tmp_path: Path, scene: HandEyeScene, capsys: pytest.CaptureFixture[str]
) -> None:
    B = scene.measured_T_camera_target.copy()
    B[4] = flipped_board(scene.points, B[4])
    given = files(tmp_path, scene.robot_poses.T_base_gripper, B)
    assert run(["doctor", *given]) == 1
    text = capsys.readouterr()
    assert text.err == "calibrant: found and not repaired: board-flipped; --apply calibrates from repaired data\n"
    assert "Verdict: REPAIR FIRST." in text.out
    command = text.out.splitlines()[-1].split()
    assert run([*command[1:-4], "--quiet"]) == 0


def test_hand_eye_refuses_what_the_doctor_calls_a_fault(faulty: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["hand-eye", *faulty]) == 1
    message = capsys.readouterr().err
    assert "poses-shifted: the poses stand one row too late" in message
    assert "calibrant doctor with the same arguments and --apply" in message


def test_a_refused_hand_eye_writes_its_report(
    tmp_path: Path, faulty: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    report, out = tmp_path / "refused.html", tmp_path / "refused.json"
    assert run(["hand-eye", *faulty, "--report", str(report), "--out", str(out)]) == 1
    assert f"{report} shows the refused calibration" in capsys.readouterr().err
    assert "the poses stand one row too late" in report.read_text()
    assert not out.exists()
    scene = hand_eye_scene("parallel-axes")
    given = files(tmp_path, scene.robot_poses.T_base_gripper, scene.measured_T_camera_target)
    assert run(["hand-eye", *given, "--report", str(report), "--force"]) == 1
    page = report.read_text()
    assert "DO NOT USE" in page
    assert "all rotations turn about one axis" in page
    assert "poses.csv" in page


def test_hand_eye_says_a_flipped_board(tmp_path: Path, scene: HandEyeScene, capsys: pytest.CaptureFixture[str]) -> None:
    B = scene.measured_T_camera_target.copy()
    B[4] = flipped_board(scene.points, B[4])
    assert run(["hand-eye", *files(tmp_path, scene.robot_poses.T_base_gripper, B), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    check = next(c for c in result["checks"] if c["name"] == "board-flipped")
    assert check["status"] == "warn"
    assert "4.png" in check["message"]
    assert result["verdict"] == "warn"


def test_apply_calibrates_from_repaired_data(
    tmp_path: Path, scene: HandEyeScene, faulty: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    out, poses = tmp_path / "result.json", tmp_path / "repaired.csv"
    assert run(["doctor", *faulty, "--apply", "--out", str(out), "--repaired-poses", str(poses)]) == 0
    assert "repaired: the poses stand one row too late" in " ".join(capsys.readouterr().out.split())
    result = json.loads(out.read_text())
    assert result["kind"] == "hand-eye"
    matrix = np.array(result["transforms"][0]["matrix"])
    sigma = 1e-3 * np.array(result["transforms"][0]["sigma_translation_mm"])
    assert np.all(np.abs(matrix[:3, 3] - scene.X[:3, 3]) < 4 * sigma)
    again = notations(read_poses(poses))[0].T_base_gripper
    np.testing.assert_allclose(again, scene.robot_poses.T_base_gripper, atol=1e-12)
    assert {c["name"] for c in result["checks"]} >= {"poses-shifted", "board-flipped"}


def test_json_goes_alone_to_standard_output(faulty: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["doctor", *faulty, "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["kind"] == "doctor"


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--repaired-poses", "new.csv"], "--repaired-poses goes with --apply"),
        (["--setup", "eye"], "unknown setup 'eye'"),
    ],
)
def test_arguments_that_cannot_be_used(
    faulty: list[str], more: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["doctor", *faulty, *more]) == 2
    assert words in capsys.readouterr().err


def test_repaired_poses_never_replace_an_input(faulty: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["doctor", *faulty, "--apply", "--force", "--repaired-poses", faulty[1]]) == 2
    assert "is an input" in capsys.readouterr().err


def test_degenerate_motions_are_refused_by_name(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = hand_eye_scene("parallel-axes")
    assert run(["doctor", *files(tmp_path, scene.robot_poses.T_base_gripper, scene.measured_T_camera_target)]) == 1
    assert "parallel-axes: all rotations turn about one axis" in capsys.readouterr().err


def test_exchanged_files_are_asked_about(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = hand_eye_scene("good", setup="eye-to-hand", views=15)
    swapped = files(tmp_path, scene.measured_T_camera_target, scene.robot_poses.T_base_gripper)
    assert run(["doctor", *swapped]) == 0
    text = capsys.readouterr().out
    assert " ".join(text.split()).count("are robot poses and target poses exchanged") == 1


def test_files_that_may_be_exchanged_are_doubted(
    tmp_path: Path, scene: HandEyeScene, capsys: pytest.CaptureFixture[str]
) -> None:
    # Two thirds of these robot poses would pass for what a camera sees; a wide lens sees target poses like that.
    swapped = files(tmp_path, scene.measured_T_camera_target, scene.robot_poses.T_base_gripper)
    assert run(["doctor", *swapped]) == 0
    assert "unless the lens is a wide one" in " ".join(capsys.readouterr().out.split())
