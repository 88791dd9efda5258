"""Runs of a task: the table as data, medians, and whether predictions hold."""

from __future__ import annotations

import json

import pytest

from calibrant.data import CalibrationResult
from calibrant.data.details import TaskRun, TaskRuns
from calibrant.errors import InputError
from calibrant.verification.runs import few_inside, run_checks, run_figures, runs_json, runs_text, unreachable_tolerance

RUNS = (
    TaskRun("seed 0", True, 1.0, 2.0, True, 0, turned_deg=0.1),
    TaskRun("seed 1", True, 3.0, 2.0, False, 1, turned_deg=0.3),
    TaskRun("seed 2", False, seed=2, reason="the camera does not see the marker"),
)


def result(runs: tuple[TaskRun, ...]) -> CalibrationResult:
    return CalibrationResult("pinpoint", "ok", details=(TaskRuns("pinpoint", "base", runs),))


def test_the_table_is_as_promised() -> None:
    found = runs_json(result(RUNS))
    assert list(found["runs"][0])[:4] == ["seed", "error_mm", "predicted_95_mm", "passed"]
    assert found["median_mm"] == 2.0
    assert found["passed"] is False
    assert found["inside_95"] == 1
    assert found["runs"][2]["reason"] == "the camera does not see the marker"
    assert json.loads(runs_text(result(RUNS))) == found
    with pytest.raises(InputError, match="holds no runs"):
        runs_json(CalibrationResult("tool", "ok"))


def test_failures_are_named_and_predictions_that_are_too_small_warned_of() -> None:
    checks = {c.name: c for c in run_checks(TaskRuns("pinpoint", "base", RUNS))}
    assert checks["pinpoint"].status == "fail"
    assert "seed 2: the camera does not see the marker" in checks["pinpoint"].message
    outside = tuple(TaskRun(f"{i}", True, 1.0, 0.5, i < 10) for i in range(20))
    assert run_checks(TaskRuns("pinpoint", "base", outside))[1].status == "warn"
    assert few_inside(10, 20) < 1e-3
    assert few_inside(20, 20) == pytest.approx(1.0)


def test_medians_have_a_sigma() -> None:
    figures = run_figures(RUNS)
    assert figures["median error"].value == 2.0
    assert figures["median error"].sigma == pytest.approx(1.2533 * 2**0.5 / 2**0.5)
    assert figures["median turn"].unit == "deg"


def test_a_tolerance_below_the_prediction_cannot_be_met() -> None:
    assert unreachable_tolerance(2.0, None) is None
    assert unreachable_tolerance(0.9, 1.0) is None
    assert "cannot be met" in str(unreachable_tolerance(2.0, 1.0))
