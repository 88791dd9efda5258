"""The same question gives the same digits by `project solve` and by the command for it, on real data."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import calibrant as cb
from calibrant.data import CalibrationResult

CHESSBOARD, MULTI = "chessboard:9x6:25mm", "charuco:4x5:54mm:40.5mm:DICT_4X4_1000:inverted"
STATIC = "charuco:5x7:36.195mm:18.256mm:DICT_6X6_250"


def assert_same(found: CalibrationResult, expected: CalibrationResult, names: dict[str, str] | None = None) -> None:
    """Every digit of transforms, covariances and lenses; names: what `expected` calls otherwise."""
    called = names or {}
    pairs = {(t.parent, t.child): t for t in found.transforms}
    assert len(pairs) == len(expected.transforms)
    for t in expected.transforms:
        mine = pairs[called.get(t.parent, t.parent), called.get(t.child, t.child)]
        np.testing.assert_array_equal(mine.matrix, t.matrix)
        np.testing.assert_array_equal(mine.covariance, t.covariance)
    for name, camera in expected.cameras.items():
        mine_camera = found.cameras[called.get(name, name)]
        np.testing.assert_array_equal(mine_camera.values, camera.values)
        np.testing.assert_array_equal(mine_camera.covariance, camera.covariance)
    assert [(v.id, v.points) for v in found.views if v.used] == [(v.id, v.points) for v in expected.views if v.used]
    assert found.verdict == expected.verdict


def rig_project(cell: Path, images: dict[str, str | Path], spec: str, **more: object) -> None:
    """A rig before one handheld board."""
    cb.project_new(cell)
    cb.project_add("target", "board", project=cell, spec=spec)
    for name in images:
        cb.project_add("camera", name, project=cell)
    cb.project_add("rig", "eyes", project=cell, cameras=",".join(images), **more)
    for name, files in images.items():
        cb.project_add("images", f"by {name}", project=cell, camera=name, target="board", images=files)


@pytest.mark.long
def test_a_rig_of_photos_has_the_digits_of_rig(shared_data: Callable[[str], Path], tmp_path: Path) -> None:
    folder = shared_data("opencv_stereo_9x6")
    images = {side: str(folder / f"{side}*.jpg") for side in ("left", "right")}
    rig_project(tmp_path / "cell", images, CHESSBOARD)
    solved = cb.project_solve(project=tmp_path / "cell")
    assert_same(solved.results["by left"], cb.rig(images=images, target=CHESSBOARD))


@pytest.mark.long
def test_a_rig_of_videos_and_its_clocks_have_the_digits_of_rig(
    shared_data: Callable[[str], Path], tmp_path: Path
) -> None:
    folder = shared_data("multicam_caliscope_charuco") / "post_optimization/calibration/extrinsic"
    images = {f"cam{k}": folder / f"cam_{k}.mp4" for k in range(4)}
    rig_project(tmp_path / "cell", images, MULTI, time_offsets=True)
    solved = cb.project_solve(project=tmp_path / "cell")
    expected = cb.rig(images=images, target=MULTI, time_offsets=True)
    assert_same(solved.results["by cam0"], expected)
    places = {p.name: p for p in cb.project_list(project=tmp_path / "cell", relative_to="cam0").places}
    np.testing.assert_allclose(places["cam3"].T, expected.transform("cam0", "cam3").matrix, atol=1e-12)


@pytest.mark.long
def test_a_camera_at_a_robot_has_the_digits_of_hand_eye(shared_data: Callable[[str], Path], tmp_path: Path) -> None:
    folder, cell = shared_data("handeye_rct_charuco_static"), tmp_path / "cell"
    cb.project_new(cell)
    cb.project_add("robot", "arm", project=cell, accuracy="0.1mm")
    cb.project_add("camera", "wrist", project=cell)
    cb.project_add("target", "board", project=cell, spec=STATIC)
    cb.project_add(
        "images", "hand", project=cell, camera="wrist", target="board", robot="arm", images=folder / "images",
        poses=folder / "poses",
    )  # fmt: skip
    found = cb.project_solve(project=cell).results["hand"]
    expected = cb.hand_eye(images=folder / "images", poses=folder / "poses", target=STATIC, robot_accuracy="0.1mm")
    assert_same(found, expected, {"camera": "wrist", "target": "board"})
    assert {c.name for c in expected.checks} == {c.name for c in found.checks}


@pytest.mark.long
def test_a_camera_alone_has_the_digits_of_intrinsics_with_its_second_look(
    shared_data: Callable[[str], Path], tmp_path: Path
) -> None:
    folder, cell = shared_data("handeye_rct_charuco_static") / "images", tmp_path / "cell"
    cb.project_new(cell)
    cb.project_add("camera", "wrist", project=cell)
    cb.project_add("target", "board", project=cell, spec=STATIC)
    cb.project_add("images", "front", project=cell, camera="wrist", target="board", images=folder)
    assert_same(
        cb.project_solve(project=cell).results["front"], cb.intrinsics(folder, target=STATIC), {"camera": "wrist"}
    )
