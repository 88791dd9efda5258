"""What programs are told: errors as JSON, warnings as an exit status, and warnings that --quiet still says."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from calibrant.cli.failure import failure_json
from calibrant.data import CalibrationResult, Check
from calibrant.errors import CancelledError, InputError, MissingExtraError, RefusedError


@pytest.fixture
def doubtful(tmp_path: Path) -> Path:
    """A result file that warns."""
    checks = (Check("target-size", "warn", "the board is\ntoo large: measure it"), Check("loop", "ok", "closes"))
    return CalibrationResult("intrinsics", "warn", checks=checks).write(tmp_path / "doubtful.json")


@pytest.mark.parametrize(
    ("given", "kind", "says"),
    [
        (["tool", "touch", "--json"], "usage", "--poses is missing"),
        (["hand-eye", "--json"], "input", "poses"),
        (["hand-eye", "--json", "--jsn"], "usage", "did you mean --json?"),
        (["tool", "touch", "--poses", "nowhere.csv", "--json"], "input", "nowhere.csv"),
    ],
)
def test_a_failure_is_one_document_under_json(calibrant, given: list[str], kind: str, says: str) -> None:
    outcome = calibrant(*given)
    error = json.loads(outcome.out)["error"]
    assert (error["kind"], error["exit_status"], outcome.status) == (kind, 2, 2)
    assert says in error["message"]
    assert outcome.err == f"calibrant: {error['message']}\n"


def test_kinds_tell_failures_apart() -> None:
    refused = RefusedError("no")
    refused.result = CalibrationResult("hand-eye", "refused", checks=(Check("a", "ok", ""), Check("b", "fail", "why")))
    cases = [
        (InputError("x"), 2, "input"),
        (MissingExtraError("x"), 2, "missing-extra"),
        (refused, 1, "refused"),
        (CancelledError("x"), 130, "interrupted"),
        (KeyboardInterrupt(), 130, "interrupted"),
        (ValueError("x"), 1, "internal"),
    ]
    for error, status, kind in cases:
        said = json.loads(failure_json(error, status, "words"))["error"]
        assert (said["kind"], said["message"], said["exit_status"]) == (kind, "words", status)
        assert said.get("checks") == ([{"name": "b", "status": "fail", "message": "why"}] if error is refused else None)


def test_strict_makes_warnings_an_exit_status(calibrant, doubtful: Path) -> None:
    assert calibrant("report", doubtful).status == 0
    outcome = calibrant("report", doubtful, "--strict", "--out", doubtful.with_suffix(".html"))
    assert outcome.status == 1
    assert outcome.err == "calibrant: not without warnings, which --strict asks for: target-size\n"
    assert "USE WITH CARE" in outcome.out
    assert doubtful.with_suffix(".html").exists()


def test_strict_says_nothing_of_a_good_result(calibrant, tmp_path: Path) -> None:
    good = CalibrationResult("intrinsics", "ok", checks=(Check("loop", "ok", "closes"),)).write(tmp_path / "good.json")
    outcome = calibrant("report", good, "--strict", "--quiet")
    assert (outcome.status, outcome.out, outcome.err) == (0, "", "")


def test_quiet_still_says_warnings_a_line_each(calibrant, doubtful: Path) -> None:
    outcome = calibrant("report", doubtful, "--quiet")
    assert (outcome.status, outcome.out) == (0, "")
    assert outcome.err == "calibrant: warning: target-size: the board is too large: measure it\n"
