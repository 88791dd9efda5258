"""calibrant hand-eye --workspace: the figures, the map in the report, pass and fail."""

from __future__ import annotations

from pathlib import Path

import pytest

from calibrant.cli.application import run
from calibrant.data.result_file import read_result, write_observations
from calibrant.simulate.cell import Cell, make_cell, observe_cell, poses_csv

VOLUME = "400mm:700mm,-100mm:200mm,0mm:50mm"


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[str], Cell]:
    folder = tmp_path_factory.mktemp("workspace")
    cell = make_cell(2, views=12)
    points = write_observations(observe_cell(cell, sigma_px=0.1), folder / "points.json")
    poses = folder / "poses.csv"
    poses.write_text(poses_csv(cell.robot_poses))
    return ["hand-eye", "--observations", str(points), "--poses", str(poses)], cell


def test_within_the_tolerance(data: tuple[list[str], Cell], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, report = tmp_path / "he.json", tmp_path / "he.html"
    given = [*data[0], "--workspace", VOLUME, "--tolerance", "20mm", "--out", str(out), "--report", str(report)]
    assert run(given) == 0
    assert "within the tolerance of 20 mm" in " ".join(capsys.readouterr().out.split())
    check = read_result(out).check("workspace")
    assert check.status == "ok"
    assert check.value is not None
    assert 0 < check.value < 20
    page = report.read_text()
    assert "In the workspace" in page
    assert "Error budget at the worst place" in page


def test_beyond_the_tolerance(data: tuple[list[str], Cell], capsys: pytest.CaptureFixture[str]) -> None:
    given = [*data[0], "--workspace", VOLUME, "--tolerance", "0.01mm", "--target-sigma", "0.1%"]
    assert run(given) == 1
    assert "NOT within the tolerance of 0.01 mm" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--tolerance", "1mm"], "add --workspace"),
        (["--target-sigma", "1%"], "add --workspace"),
        (["--workspace", VOLUME, "--tolerance", "1"], "no unit"),
        (["--workspace", VOLUME, "--target-sigma", "1"], "percent"),
        (["--workspace", "everywhere"], "three ranges"),
    ],
)
def test_bad_arguments_are_named(
    data: tuple[list[str], Cell], arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run([*data[0], *arguments]) == 2
    assert message in capsys.readouterr().err
