"""calibrant dynamic: from photos of two cameras to where the external one is."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from calibrant.calibrate.cell.hand_eye import calibrate_hand_eye
from calibrant.cli.application import run
from calibrant.data import CalibrationResult, RobotPoses
from calibrant.data.result_file import read_result
from calibrant.geometry import se3, so3
from calibrant.simulate.cell import TARGET, Cell, make_cell, observe_cell, poses_csv
from calibrant.simulate.render import render
from calibrant.simulate.truth import normalised

EXTERNAL_IN_TARGET = se3.inverse(se3.make(so3.exp([0.5, 0.2, 0.3]), [-0.1, -0.05, 0.6]))


@pytest.fixture(scope="module")
def photos(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Cell]:
    """A folder with the wrist's result, the external camera, photos of both and the poses."""
    folder = tmp_path_factory.mktemp("dynamic")
    cell = make_cell(1, views=12)
    calibrate_hand_eye(cell.robot_poses, observe_cell(cell, sigma_px=0.1), setup="eye-in-hand").write(
        folder / "he.json"
    )
    CalibrationResult("intrinsics", "ok", cameras={"camera": cell.camera}).write(folder / "front.json")
    artwork = cell.target.artwork()
    for i in range(3):
        image = render(artwork, cell.camera, cell.T_camera_target[i], rng=np.random.default_rng(i))
        cv2.imwrite(str(folder / f"wrist{i}.png"), image)
    image = render(artwork, cell.camera, se3.inverse(EXTERNAL_IN_TARGET), rng=np.random.default_rng(9))
    cv2.imwrite(str(folder / "front0.png"), image)
    poses = RobotPoses.from_matrices(cell.robot_poses.T_base_gripper[:3], ids=[f"wrist{i}.png" for i in range(3)])
    (folder / "poses.csv").write_text(poses_csv(poses))
    return folder, cell


def arguments(folder: Path) -> list[str]:
    return [
        "dynamic", "--wrist", str(folder / "he.json"), "--camera", str(folder / "front.json"),
        "--wrist-images", *(str(folder / f"wrist{i}.png") for i in range(3)),
        "--external-images", str(folder / "front0.png"), "--poses", str(folder / "poses.csv"),
    ]  # fmt: skip


def test_the_external_camera_is_where_it_says(
    photos: tuple[Path, Cell], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, cell = photos
    out = tmp_path / "dynamic.json"
    assert run([*arguments(folder), "--target", TARGET, "--out", str(out), "--verbose"]) == 0
    text = capsys.readouterr().out
    assert "Dynamic calibration" in text
    assert "Of its variance" in text
    assert "agree within their noise" in text
    # Its corners are told by its own views: clean pictures, a tenth of the wrist's noise.
    noise = next(c for c in read_result(out).checks if c.name == "noise")
    assert noise.status == "ok"
    assert noise.value is not None
    assert 0.001 < noise.value < 0.1
    estimate = read_result(out).transform("base", "external")
    # 6 degrees of freedom: beyond 30 once in 25,000. Target size and lens are exact here, so it is on the safe side.
    assert normalised(estimate, cell.Z @ EXTERNAL_IN_TARGET) < 30


def test_bad_arguments_are_named(photos: tuple[Path, Cell], capsys: pytest.CaptureFixture[str]) -> None:
    folder, _ = photos
    assert run(arguments(folder)) == 2
    assert "--target" in capsys.readouterr().err
    assert run([*arguments(folder), "--target", TARGET, "--target-stands", "up"]) == 2
    assert "choose still or moves" in capsys.readouterr().err
    assert run([*arguments(folder), "--target", TARGET, "--target-stands", "moves"]) == 2
    assert "3 photos of the wrist camera and 1" in capsys.readouterr().err
