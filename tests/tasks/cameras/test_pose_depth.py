"""`calibrant pose --depth`: a board by colour and depth, from files."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from tests.perceive.boxes_on_a_table import d435

import calibrant as cb
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult
from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.simulate.render import render
from calibrant.targets.registry import parse_target

TARGET = "chessboard:7x5:20mm"
CAMERA = Camera.create("pinhole", {"fx": 617.0, "fy": 617.0, "cx": 320.0, "cy": 241.0}, image_size=(640, 480))


class Files:
    def __init__(self, folder: Path) -> None:
        board, rng = parse_target(TARGET), np.random.default_rng(0)
        R = so3.exp([0.3, -0.2, 0.1])
        self.T = se3.make(R, np.array([0.01, 0.0, 0.45]) - R @ np.asarray(board.points).mean(axis=0))
        self.photo, self.depth, self.array = folder / "photo.png", folder / "depth.png", folder / "depth.npy"
        cv2.imwrite(str(self.photo), render(board.artwork(), CAMERA, self.T, rng=rng))
        u, v = np.meshgrid(np.arange(640.0), np.arange(480.0))
        rays = CAMERA.unproject(np.stack([u, v], -1))
        n = self.T[:3, 2]
        z = d435((n @ self.T[:3, 3]) / (rays / rays[..., 2:] @ n), rng)
        cv2.imwrite(str(self.depth), np.rint(np.nan_to_num(1e3 * z)).astype(np.uint16))
        np.save(self.array, z)
        self.camera = CalibrationResult("intrinsics", "ok", cameras={"camera": CAMERA}).write(folder / "camera.json")


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Files:
    return Files(tmp_path_factory.mktemp("pose"))


def ask(files: Files, **more: object) -> CalibrationResult:
    return cb.pose(files.photo, camera=files.camera, target=TARGET, **more)  # type: ignore[arg-type]


@pytest.mark.parametrize("form", ["depth", "array"])
def test_depth_narrows_the_pose_and_the_result_says_so(files: Files, form: str, tmp_path: Path) -> None:
    alone, both = ask(files), ask(files, depth=getattr(files, form), sigma_scale="0.1%")
    before, after = (r.transform("camera", "target") for r in (alone, both))
    assert before.sigma_translation_mm is not None
    assert after.sigma_translation_mm is not None
    assert np.linalg.norm(after.sigma_translation_mm) < np.linalg.norm(before.sigma_translation_mm)
    e = se3.local(after.matrix, files.T)
    # 99.99 % of chi-square with six degrees of freedom.
    assert e @ np.linalg.solve(after.covariance, e) < 27.9
    assert "depths on the board" in both.check("depth").message
    assert both.options["sigma_scale"] == "0.1%"
    assert len(both.inputs) == len(alone.inputs) + 1
    assert cb.read(both.write(tmp_path / "pose.json")).kind == "pose"


def test_depth_that_does_not_fit_the_photos_is_named(files: Files) -> None:
    with pytest.raises(InputError, match="1 photos and 2 depth pictures"):
        ask(files, depth=[files.depth, files.array])
    with pytest.raises(InputError, match="no depth file"):
        ask(files, depth=files.array.with_name("none.npy"))
    with pytest.raises(InputError, match="8 bits a pixel"):
        ask(files, depth=files.photo)
    with pytest.raises(InputError, match="per cent"):
        ask(files, depth=files.depth, sigma_scale="2")
