"""The verdict in words, and the views with their reasons."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from calibrant.data import CalibrationResult, Check
from calibrant.reports.parts.rows import view_rows
from calibrant.reports.words import sorted_checks, verdict_sentence


def test_a_warning_is_part_of_the_verdict(intrinsics_result: CalibrationResult) -> None:
    sentence = verdict_sentence(intrinsics_result)
    assert "fx is known to 0.029 %" in sentence
    assert "No points in the lower left corner: take a view with the board there." in sentence


def test_a_refusal_gives_its_reason_and_no_accuracy(intrinsics_result: CalibrationResult) -> None:
    checks = (Check("a", "warn", "w"), Check("b", "fail", "the board was never tilted"), Check("c", "fail", "x"))
    sentence = verdict_sentence(replace(intrinsics_result, verdict="refused", checks=checks))
    assert sentence == "The board was never tilted. (And 1 more failed check: see the checks.)"


def test_the_cause_stands_before_what_comes_of_it(intrinsics_result: CalibrationResult) -> None:
    """A print that is longer one way leaves points out and residuals with structure: neither is to be cured."""
    checks = (
        Check("outliers", "warn", "9 of 700 points left out"),
        Check("focal-length", "warn", "known to 3 %: cure that first"),
        Check("board-squares", "warn", "the squares are 4 % higher than wide"),
        Check("convergence", "ok", "converged"),
    )
    result = replace(intrinsics_result, checks=checks)
    assert "The squares are 4 % higher than wide. (And 2 more warnings" in verdict_sentence(result)
    assert [c.name for c in sorted_checks(result)] == ["board-squares", "outliers", "focal-length", "convergence"]
    failed = (*checks, Check("convergence", "fail", "it did not converge"))
    assert sorted_checks(replace(result, checks=failed))[0].status == "fail"


@pytest.mark.parametrize(("text", "first"), [("img_00.png: off", "img"), ("fx / fy = 1", "fx"), ("no views", "No")])
def test_names_keep_their_letters(intrinsics_result: CalibrationResult, text: str, first: str) -> None:
    checks = (Check("a", "fail", text),)
    assert verdict_sentence(replace(intrinsics_result, verdict="refused", checks=checks)).startswith(first)


def test_a_good_result_says_how_good(hand_eye_result: Callable[[str], CalibrationResult]) -> None:
    sentence = verdict_sentence(hand_eye_result("eye-to-hand"))
    assert sentence == (
        "base → camera is at (660.00, -250.00, 830.000) mm, known to 0.23 mm and 0.020 deg (1σ, worst axis), "
        "beside what this arm's own geometry errs by (--robot-accuracy, --identify). "
        "11 of 13 views used, every check passed."
    )


def test_a_bare_result_still_has_a_sentence() -> None:
    assert verdict_sentence(CalibrationResult("intrinsics", "ok")) == "Done."


def test_views_list_missed_images_once(intrinsics_result: CalibrationResult) -> None:
    rows = view_rows(intrinsics_result)
    assert [row.id for row in rows].count("99.png") == 1
    assert {row.status for row in rows} == {"used", "used, flagged", "left out"}
    again = replace(
        intrinsics_result, views=(*intrinsics_result.views, replace(intrinsics_result.views[0], id="99.png"))
    )
    assert [row.id for row in view_rows(again)].count("99.png") == 1


def test_the_worst_check_comes_first() -> None:
    checks = (Check("a", "ok", ""), Check("b", "warn", ""), Check("c", "fail", ""))
    assert [c.name for c in sorted_checks(CalibrationResult("x", "refused", checks=checks))] == ["c", "b", "a"]
