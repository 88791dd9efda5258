"""Messages of the verbs name arguments, where the command's name options."""

from __future__ import annotations

from pathlib import Path

import pytest

import calibrant as cb
from calibrant.tasks.registry import TASKS
from calibrant.tasks.verbs import in_python


def test_options_become_arguments() -> None:
    task = TASKS["hand-eye"].load()
    said = in_python(
        "say --pose-units, or --setup eye-to-hand; a-b --not-one; calibrant intrinsics --target-shape", task
    )
    assert said == "say pose_units, or setup eye-to-hand; a-b --not-one; calibrant intrinsics --target-shape"


def test_an_error_in_python_names_its_argument(tmp_path: Path) -> None:
    with pytest.raises(cb.InputError, match="photos need the board they show: target, such as"):
        cb.intrinsics(tmp_path)
    (tmp_path / "board.pdf").touch()
    with pytest.raises(cb.InputError, match="force=True"):
        cb.target("chessboard:9x6:25mm", out=tmp_path / "board.pdf")


def test_warnings_of_a_board_are_warnings(tmp_path: Path) -> None:
    with pytest.warns(UserWarning, match="looks the same turned by 180 degrees"):
        cb.target("chessboard:7x7:20mm", out=tmp_path / "board.pdf")


def test_what_python_shows_of_a_result_names_arguments() -> None:
    said = "leave --sigma-px out (--confidence 0.9), or calibrant intrinsics --target-shape free"
    result = cb.CalibrationResult("pose", "warn", checks=(cb.Check("noise", "warn", said),))
    assert result.check("noise").message == said  # every door has the same result
    for text in (str(result), result.summary(), result._repr_html_()):
        words = " ".join(text.split())
        assert "leave sigma_px out (confidence 0.9), or calibrant" in words
        assert "--sigma-px" not in words
    assert "calibrant intrinsics --target-shape free" in " ".join(result.summary().split())
