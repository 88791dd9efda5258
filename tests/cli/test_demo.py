"""The demo from the outside: what it prints, writes and leaves alone."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner, Result

from calibrant.cli.demo import demo
from calibrant.data.result_file import read_result
from calibrant.errors import InputError

VIEWS = "8"


@pytest.fixture(scope="module")
def run() -> Callable[..., Result]:
    app = typer.Typer()
    app.command()(demo)
    return lambda *arguments: CliRunner().invoke(app, [str(a) for a in arguments], catch_exceptions=False)


@pytest.fixture(scope="module")
def finished(run: Callable[..., Result], tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Result]:
    folder = tmp_path_factory.mktemp("demo") / "out"
    return folder, run("--seed", 5, "--views", VIEWS, "--out", folder)


def test_it_writes_what_a_user_would_have(finished: tuple[Path, Result]) -> None:
    folder, result = finished
    assert result.exit_code == 0
    assert len(list((folder / "images").glob("*.png"))) == int(VIEWS)
    assert read_result(folder / "camera.json").kind == "intrinsics"
    hand_eye = read_result(folder / "hand-eye.json")
    assert hand_eye.kind == "hand-eye"
    assert "<html" in (folder / "report.html").read_text().lower()
    assert json.loads((folder / "truth.json").read_text())["seed"] == 5


def test_it_ends_with_the_truth_beside_the_prediction(finished: tuple[Path, Result]) -> None:
    _, result = finished
    for words in ("Against the truth", "predicted 1σ", "T_gripper_camera is off by", "region", "Tool point"):
        assert words in result.stdout
    assert "calibrant hand-eye --images" in result.stdout


def test_again_with_fewer_views_leaves_no_old_picture(
    finished: tuple[Path, Result], run: Callable[..., Result]
) -> None:
    folder, _ = finished
    result = run("--seed", 6, "--views", "6", "--setup", "eye-to-hand", "--out", folder, "--json")
    data = json.loads(result.stdout)
    assert data["format"] == "calibrant/2"
    assert data["transforms"][0]["parent"] == "base"
    truth = data["truth"]
    assert truth["inside"] == (truth["normalised_error"] <= truth["limit"])
    # Arms good to 0.1 mm and 0.02 degrees, six views: a tenth of these figures in the mean, never ten times them.
    assert truth["error_translation_mm"] < 1.0
    assert truth["error_rotation_deg"] < 0.2
    assert len(list((folder / "images").glob("*.png"))) == 6


def test_a_folder_of_the_users_is_left_alone(tmp_path: Path, run: Callable[..., Result]) -> None:
    (tmp_path / "thesis.txt").write_text("mine")
    with pytest.raises(InputError, match="no demo wrote it"):
        run("--out", tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["thesis.txt"]
    with pytest.raises(InputError, match="is a file"):
        run("--out", tmp_path / "thesis.txt")
