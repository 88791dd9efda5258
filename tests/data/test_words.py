"""How results and data show themselves: short, and with the answer in it."""

from __future__ import annotations

from pathlib import Path

import pytest

from calibrant.data import CalibrationResult
from calibrant.data.result_file import read_result

FILES = sorted((Path(__file__).parent / "format_one").glob("*.json"))


@pytest.mark.parametrize("file", FILES, ids=lambda f: f.stem)
def test_a_result_says_its_answer_in_ten_lines(file: Path) -> None:
    result = read_result(file)
    text = str(result)
    assert len(text.splitlines()) <= 13
    assert max(map(len, text.splitlines())) <= 160
    verdict = {"ok": "GOOD", "warn": "USE WITH CARE", "refused": "DO NOT USE"}[result.verdict]
    assert verdict in text or result.kind == "doctor"
    for check in [c for c in result.checks if c.status != "ok"][:4]:
        assert check.name in text
    assert len(repr(result)) < 160
    summary = result.summary()
    assert "\x1b" not in summary
    assert max(map(len, summary.splitlines())) <= 80
    # The doctor's words end with what to do.
    assert f"Verdict: {verdict}." in summary or result.kind == "doctor"
    page = result._repr_html_()
    assert page.startswith("<div>")
    assert verdict in page or result.kind == "doctor"
    assert "<script" not in page


def test_parts_of_a_result_are_one_line_each() -> None:
    result = read_result(FILES[0].parent / "hand-eye.json")
    assert repr(result.observations) == (
        f"Observations(9 views, {sum(map(len, result.observations.views))} points; camera 1280 × 1024 px)"  # type: ignore[union-attr]
    )
    shown = [result.camera, result.robot_poses, *result.transforms, *result.views, *result.observations.views]  # type: ignore[union-attr]
    for part in [*shown, *result.methods.values()]:
        assert "\n" not in repr(part)
        assert "array(" not in repr(part)
        assert len(repr(part)) < 250
    assert repr(result.transform("gripper", "camera")).startswith("TransformEstimate(gripper → camera: [")


def test_what_a_result_shows_is_escaped() -> None:
    evil = CalibrationResult("<script>alert(1)</script>", "ok")
    assert "<script" not in evil._repr_html_()
