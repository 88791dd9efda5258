"""calibrant compare: files of any program, pairs of names, what the two are called."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.made_results import camera

import calibrant as cb
from calibrant.data import CalibrationResult
from calibrant.data.details import Comparison
from calibrant.tasks.results.compare import names_of


def test_a_result_against_another_programs_file(tmp_path: Path) -> None:
    CalibrationResult("intrinsics", "ok", cameras={"camera": camera()}).write(tmp_path / "camera.json")
    cb.convert(tmp_path / "camera.json", tmp_path / "Intr.yml", to="opencv", force=True)
    found = cb.compare(tmp_path / "camera.json", tmp_path / "Intr.yml")
    record = found.detail(Comparison)
    assert record is not None
    assert (record.first, record.second) == ("camera.json", "Intr.yml")
    assert record.cameras[0].rotated_most_px < 1e-6
    assert found.verdict == "ok"
    assert "ALIKE" in found.summary()


def test_a_file_without_an_image_size_is_for_the_others_images(tmp_path: Path) -> None:
    CalibrationResult("intrinsics", "ok", cameras={"camera": camera()}).write(tmp_path / "camera.json")
    (tmp_path / "old.yml").write_text(
        "%YAML:1.0\n---\nK: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n"
        "   data: [ 905.2, 0., 641.7, 0., 904.1, 509.3, 0., 0., 1. ]\n"
    )
    for files in (("camera.json", "old.yml"), ("old.yml", "camera.json")):
        record = cb.compare(*(tmp_path / f for f in files)).detail(Comparison)
        assert record is not None
        assert record.cameras[0].first_size == record.cameras[0].second_size == (1280, 1024)


def test_a_file_that_is_none_is_named(tmp_path: Path) -> None:
    CalibrationResult("intrinsics", "ok", cameras={"camera": camera()}).write(tmp_path / "camera.json")
    (tmp_path / "garbage.txt").write_text("garbage")
    with pytest.raises(cb.InputError, match=r"garbage\.txt"):
        cb.compare(tmp_path / "camera.json", tmp_path / "garbage.txt")


def test_files_of_one_name_go_by_their_folders(tmp_path: Path) -> None:
    a, b = tmp_path / "monday" / "camera.json", tmp_path / "friday" / "camera.json"
    assert names_of((a, b)) == ("monday/camera.json", "friday/camera.json")
    assert names_of((a, a)) == ("monday/camera.json (1)", "monday/camera.json (2)")


def test_a_pair_of_cameras_that_is_none() -> None:
    with pytest.raises(cb.InputError, match="camera takes NAME or FIRST:SECOND"):
        cb.compare("a.json", "b.json", camera=["left:"])
