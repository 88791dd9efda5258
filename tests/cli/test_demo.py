"""The demo from the outside: what it prints, writes and leaves alone."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.cli.conftest import Outcome

from calibrant.data.result_file import read_result

VIEWS = "8"


@pytest.fixture(scope="module")
def run(calibrant: Callable[..., Outcome]) -> Callable[..., Outcome]:
    return lambda *arguments: calibrant("demo", *arguments)


@pytest.fixture(scope="module")
def finished(run: Callable[..., Outcome], tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Outcome]:
    folder = tmp_path_factory.mktemp("demo") / "out"
    return folder, run("--seed", 5, "--views", VIEWS, "--out", folder)


def test_it_writes_what_a_user_would_have(finished: tuple[Path, Outcome]) -> None:
    folder, result = finished
    assert (result.status, result.err) == (0, "")
    assert len(list((folder / "images").glob("*.png"))) == int(VIEWS)
    assert read_result(folder / "camera.json").kind == "intrinsics"
    hand_eye = read_result(folder / "hand-eye.json")
    assert hand_eye.kind == "hand-eye"
    assert "<html" in (folder / "report.html").read_text().lower()
    assert json.loads((folder / "truth.json").read_text())["seed"] == 5


def test_it_ends_with_the_truth_beside_the_prediction(finished: tuple[Path, Outcome]) -> None:
    _, result = finished
    for words in ("Against the truth", "predicted 1σ", "T_gripper_camera is off by", "region", "Tool point"):
        assert words in result.out
    assert "calibrant hand-eye --images" in result.out
    for option in ("--poses", "--target charuco:8x6:30mm:22mm:DICT_5X5_100", "--setup eye-in-hand"):
        assert option in result.out


def test_again_with_fewer_views_leaves_no_old_picture(
    finished: tuple[Path, Outcome], run: Callable[..., Outcome]
) -> None:
    folder, _ = finished
    result = run("--seed", 6, "--views", "6", "--setup", "eye-to-hand", "--out", folder, "--json")
    data = json.loads(result.out)
    assert data["format"] == "calibrant/2"
    assert data["transforms"][0]["parent"] == "base"
    truth = data["truth"]
    assert truth["inside"] == (truth["normalised_error"] <= truth["limit"])
    # Arms good to 0.1 mm and 0.02 degrees, six views: a tenth of these figures in the mean, never ten times them.
    assert truth["error_translation_mm"] < 1.0
    assert truth["error_rotation_deg"] < 0.2
    assert len(list((folder / "images").glob("*.png"))) == 6


def test_a_folder_of_the_users_is_left_alone(tmp_path: Path, run: Callable[..., Outcome]) -> None:
    (tmp_path / "thesis.txt").write_text("mine")
    outcome = run("--out", tmp_path)
    assert outcome.status == 2
    assert "no demo wrote it" in outcome.err
    assert [p.name for p in tmp_path.iterdir()] == ["thesis.txt"]
    outcome = run("--out", tmp_path / "thesis.txt")
    assert outcome.status == 2
    assert "is a file" in outcome.err
