"""calibrant vanishing: from a picture of a room to a rotation, a focal length and a picture."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calibrant.cameras import Camera
from calibrant.cli.application import run
from calibrant.data import CalibrationResult
from calibrant.data.result_file import read_result
from calibrant.geometry import so3
from calibrant.simulate.manhattan import render_room, room
from calibrant.simulate.truth import chi_square

CAMERA = Camera.create("pinhole", {"fx": 520.0, "fy": 520.0, "cx": 319.5, "cy": 239.5}, image_size=(640, 480))


@pytest.fixture(scope="module", name="scene")
def rendered(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, NDArray[np.float64]]:
    folder, rng = tmp_path_factory.mktemp("vanishing"), np.random.default_rng(7)
    R = so3.exp([0.25, 0.4, 0.05])
    cv2.imwrite(str(folder / "room.png"), render_room(room(rng), CAMERA, R, rng=rng))
    cv2.imwrite(str(folder / "blank.png"), np.full((480, 640), 99, np.uint8))
    CalibrationResult("intrinsics", "ok", cameras={"camera": CAMERA}).write(folder / "camera.json")
    return folder, R


def test_a_rotation_with_a_picture(
    scene: tuple[Path, NDArray[np.float64]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, R = scene
    out, lines, report = tmp_path / "r.json", tmp_path / "lines.png", tmp_path / "r.html"
    arguments = [str(folder / "room.png"), "--camera", str(folder / "camera.json"), "--out", str(out)]
    assert run(["vanishing", *arguments, "--overlay", str(lines), "--report", str(report)]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "Rotation from vanishing points" in printed
    assert "x and z by themselves are at 9" in printed or "x and z by themselves are at 8" in printed
    estimate = read_result(out).transform("camera", "scene")
    error = so3.log(R @ estimate.matrix[:3, :3].T)
    assert estimate.covariance is not None
    assert np.rad2deg(np.linalg.norm(error)) < 0.06
    assert chi_square(error, estimate.covariance[:3, :3]) < 16.3  # chi-square of 3, 0.999
    picture = cv2.imread(str(lines))
    assert picture.shape == (480, 640, 3)
    assert np.ptp(picture.astype(int), axis=2).max() > 100


def test_a_focal_length_without_a_camera(scene: tuple[Path, NDArray[np.float64]], tmp_path: Path) -> None:
    folder, _ = scene
    assert run(["vanishing", str(folder / "room.png"), "--out", str(tmp_path / "f.json"), "--quiet"]) == 0
    camera = read_result(tmp_path / "f.json").camera
    assert abs(camera.parameters["fx"] - 520.0) < 4 * camera.sigma["fx"]
    assert camera.sigma["fx"] < 10


def test_what_cannot_be_done_is_said(
    scene: tuple[Path, NDArray[np.float64]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, _ = scene
    photo, camera = str(folder / "room.png"), ["--camera", str(folder / "camera.json")]
    cases = (
        (["vanishing", str(folder / "blank.png"), *camera], 1, "0 straight edges found"),
        (["vanishing", photo, *camera, "--focal", "long"], 2, "known (the camera's) or unknown"),
        (["vanishing", str(tmp_path / "none.png"), *camera], 2, "does not exist"),
        (["vanishing", photo, *camera, "--overlay", photo, "--force"], 2, "is an input of this command"),
        (["vanishing", photo, *camera, "--overlay", str(tmp_path / "lines")], 2, "expected the name of a picture"),
    )
    for arguments, status, said in cases:
        assert run(arguments) == status, arguments
        assert said in capsys.readouterr().err
