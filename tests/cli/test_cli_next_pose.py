"""calibrant next-pose: plans from nothing and after a result, and what it refuses."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from calibrant.calibrate.cell.hand_eye import calibrate_hand_eye
from calibrant.cli.application import run
from calibrant.robots.arms import arm
from calibrant.simulate.cell import TARGET, make_cell, observe_cell

PLACES = ["--camera-at", "21mm,-64mm,47mm,0deg,0deg,23deg", "--target-at", "620mm,110mm,20mm,180deg,0deg,17deg"]
NEAR = ["--distance", "320mm:600mm"]


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    cell = make_cell(0, views=8)
    found = calibrate_hand_eye(cell.robot_poses, observe_cell(cell, sigma_px=0.1), setup="eye-in-hand")
    return found.write(tmp_path_factory.mktemp("next-pose") / "hand-eye.json")


def test_plan_from_nothing(result: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "plan.csv"
    given = ["next-pose", "--robot", "ur5e", "--camera", str(result), "--target", TARGET, *PLACES, *NEAR]
    assert run([*given, "-n", "4", "--out", str(out)]) == 0
    text = capsys.readouterr().out
    assert "nothing is known yet" in text
    rows = list(csv.DictReader(out.read_text().splitlines()))
    assert len(rows) == 4
    chain = arm("ur5e")
    for row in rows:
        T = chain.forward([float(row[j.name]) for j in chain.joints])
        # The tolerance of the inverse kinematics is a third of a micrometre.
        assert T[:3, 3] == pytest.approx([float(row[a]) for a in "xyz"], abs=1e-6)
    assert float(rows[3]["sigma_mm"]) < 1
    assert run([*given, "--out", str(out)]) == 2
    assert "exists already" in capsys.readouterr().err


def test_next_pose_after_a_result(result: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["next-pose", "--robot", "ur5e", "--result", str(result), "--target", TARGET, *NEAR, "--json"]) == 0
    plan = json.loads(capsys.readouterr().out)["details"]["plan"]
    assert len(plan["poses"]) == 1
    assert plan["poses"][0]["sigma_mm"] < plan["before"]["sigma_mm"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--robot", "ur99"], "no robot of that name"),
        (["--wanted", "peace"], "choose point or camera"),
        (["--distance", "600mm:300mm"], "smaller length comes first"),
        (["--tilt", "40"], "not an angle"),
        (["--in-view", "0%"], "above 0%"),
        (["--camera-at", "1mm,2mm"], "in the result already"),
        (["--workspace", "0mm:1mm,0mm:1mm,0mm:1mm"], "on the gripper"),
        (["--geometry", "nothing.yaml"], "nothing.yaml does not exist"),
        (["--result", "nothing.json"], "nothing.json does not exist"),
    ],
)
def test_bad_arguments_are_named(
    result: Path, arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["next-pose", "--robot", "ur5e", "--result", str(result), "--target", TARGET, *arguments]) == 2
    assert message in capsys.readouterr().err


def test_without_anything_known_it_says_what_it_needs(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["next-pose", "--robot", "ur5e"]) == 2
    assert "--camera-at" in capsys.readouterr().err
