"""Captures on disk as `calibrant projector` and `calibrant scan` read them: what does not go together is named."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from tests.detection.lit_captures import PAIR, SIZE, capture

import calibrant as cb
from calibrant.data import CalibrationResult, as_transform
from calibrant.errors import InputError, RefusedError
from calibrant.opencv import cv2

WxH = f"{SIZE[0]}x{SIZE[1]}"


def written(folder: Path, pictures: np.ndarray) -> Path:
    folder.mkdir(parents=True)
    for k, picture in enumerate(pictures):
        cv2.imwrite(str(folder / f"{k:02d}.png"), picture)
    return folder


@pytest.fixture(scope="module")
def calibration(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The true pair, as a result file."""
    place = as_transform("camera", "projector", PAIR.T_camera_projector, 1e-10 * np.eye(6))
    cameras = {"camera": PAIR.camera, "projector": PAIR.projector}
    path = tmp_path_factory.mktemp("pair") / "pair.json"
    CalibrationResult("projector", "ok", (), cameras=cameras, transforms=(place,)).write(path)
    return path


def test_captures_of_two_sizes_are_named(tmp_path: Path) -> None:
    pictures = capture().pictures
    written(tmp_path / "all" / "a", pictures)
    written(tmp_path / "all" / "b", np.stack([cv2.resize(p, (240, 180)) for p in pictures]))
    with pytest.raises(InputError, match="b has pictures of 240x180 px, a of 480x360 px: one camera takes one size"):
        cb.projector_calibrate(captures=tmp_path / "all", projector_size=WxH, target="chessboard:9x7:30mm")


def test_a_mirrored_capture_is_no_cloud(calibration: Path, tmp_path: Path) -> None:
    pictures = capture().pictures
    assert cb.scan(calibration, capture=written(tmp_path / "scene", pictures)).verdict != "refused"
    with pytest.raises(RefusedError, match="no depth is known as its sigma says"):
        cb.scan(calibration, capture=written(tmp_path / "mirrored", pictures[:, :, ::-1]))


def test_a_scene_without_light_is_said(calibration: Path, tmp_path: Path) -> None:
    dark = np.random.default_rng(0).integers(4, 9, size=capture().pictures.shape).astype(np.uint8)
    with pytest.raises(InputError, match="the projector's light does not reach what the camera sees"):
        cb.scan(calibration, capture=written(tmp_path / "dark", dark))


@pytest.mark.long
def test_figures_on_real_captures(shared_data: Callable[[str], Path]) -> None:
    """The public tool says 0.404 px with all terms, 645 mm and k3 = -68; its board is as flat as the camera says."""
    captures = shared_data("procam_kamino_graycode")
    result = cb.projector_calibrate(
        captures=captures / "capture_*", projector_size="1024x768", target="chessboard:7x9:75mm"
    )
    assert result.rms_px is not None
    assert result.rms_px < 0.311
    T = result.transform("camera", "projector")
    assert 1e3 * np.linalg.norm(T.matrix[:3, 3]) == pytest.approx(672, abs=8)
    flat = result.check("board-flatness")
    assert flat.status == "ok"
    assert flat.value is not None
    assert flat.value < 0.6  # the camera's own pictures bend it by 0.36 mm
