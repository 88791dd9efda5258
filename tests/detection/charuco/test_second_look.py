"""Looking again at ChArUco boards with the camera known: a wide lens keeps its corners."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from calibrant.cameras import Camera
from calibrant.cli.application import run
from calibrant.data.result_file import read_result as read
from calibrant.detection import detect
from calibrant.detection.charuco.second_look import look_again
from calibrant.geometry import se3, so3
from calibrant.simulate.render import Look, render
from calibrant.targets.registry import parse_target

SPEC = "charuco:9x7:40mm:30mm:DICT_5X5_100"
PARAMETERS = {"fx": 170.0, "fy": 170.0, "cx": 319.5, "cy": 239.5, "k1": 0.02, "k2": -0.01, "k3": 0.002, "k4": 0.0}
CAMERA = Camera.create("kannala_brandt", PARAMETERS, image_size=(640, 480))


@pytest.fixture(scope="module", name="photos")
def _photos(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, np.ndarray]]:
    """Photos of a near board through a fisheye lens, and the true pixels of its corners in each."""
    folder, truth = tmp_path_factory.mktemp("fisheye"), {}
    target, rng = parse_target(SPEC), np.random.default_rng(1)
    middle, size = target.points.mean(axis=0), np.ptp(target.points, axis=0).max()
    for k in range(8):
        off_axis, around = np.deg2rad(rng.uniform(0, 50)), rng.uniform(0, 2 * np.pi)
        towards = np.array([np.sin(off_axis) * np.cos(around), np.sin(off_axis) * np.sin(around), np.cos(off_axis)])
        axis = np.array([-np.sin(around), np.cos(around), 0.0])
        tilt = np.array([rng.uniform(-0.6, 0.6), rng.uniform(-0.6, 0.6), rng.uniform(-3, 3)])
        R = so3.exp(off_axis * axis) @ so3.exp(tilt)
        T = se3.make(R, size * rng.uniform(0.4, 0.8) * towards - R @ middle)
        image = render(target.artwork(), CAMERA, T, rng=rng, look=Look(noise_grey=3.0, clutter=20))
        cv2.imwrite(str(folder / f"{k}.png"), image)
        truth[f"{k}.png"] = CAMERA.project(se3.apply(T, target.points))
    return folder, truth


def test_a_wide_lens_keeps_its_corners(photos: tuple[Path, dict[str, np.ndarray]]) -> None:
    folder, truth = photos
    first = detect(folder, target=SPEC, workers=1)
    again = look_again(first, CAMERA, workers=1)
    before, after = (sum(len(v) for v in o.views) for o in (first, again))
    inside = sum(np.count_nonzero(((uv > 8) & (uv < np.array([631, 471]))).all(axis=1)) for uv in truth.values())
    assert before < 0.95 * inside
    assert after > 0.97 * inside
    assert f"{after - before} more corners" in again.notes[-1]
    assert all(len(new) >= len(old) for old, new in zip(first.views, again.views, strict=True))
    error = np.concatenate([np.linalg.norm(v.uv - truth[v.id][v.point_ids], axis=1) for v in again.views])
    # Corners that only the rough refinement could place are good to half a pixel per axis, and say so.
    assert np.median(error) < 0.1
    assert error.max() < 2.0
    assert look_again(again, CAMERA, workers=1) is again


def test_other_targets_and_lost_photos_stay_as_they_are(
    photos: tuple[Path, dict[str, np.ndarray]], tmp_path: Path
) -> None:
    folder, _ = photos
    copy = tmp_path / "0.png"
    copy.write_bytes((folder / "0.png").read_bytes())
    found = detect(copy, target=SPEC, workers=1)
    copy.unlink()
    assert look_again(found, CAMERA, workers=1) is found


def test_intrinsics_looks_again_by_itself(photos: tuple[Path, dict[str, np.ndarray]], tmp_path: Path) -> None:
    folder, _ = photos
    words = ["intrinsics", str(folder), "--target", SPEC, "--model", "kannala_brandt", "--cache", "none", "--quiet"]
    assert run([*words, "--out", str(tmp_path / "camera.json")]) == 0
    result = read(tmp_path / "camera.json")
    first = detect(folder, target=SPEC, workers=1)
    assert sum(len(v) for v in result.observations.views) > sum(len(v) for v in first.views)
    assert any("Looked at again" in note for note in result.observations.notes)
    assert abs(result.camera.parameters["fx"] - 170.0) < 5 * result.camera.sigma["fx"]
