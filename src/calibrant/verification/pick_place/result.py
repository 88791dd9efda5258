"""Cubes picked and placed as a result: how many, the errors of where they were said to be, other ways beside."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from calibrant.data import CalibrationResult, Measured, verdict_of
from calibrant.data.details import TaskRun, TaskRuns
from calibrant.data.verdicts import stamp
from calibrant.verification.runs import run_checks, run_figures


def pick_place_result(runs: Sequence[TaskRun], *, view: str, beside: Mapping[str, str]) -> CalibrationResult:
    """The result of kind "pick-place"; `after_mm` of a run is how far aside the cube lies on the other one."""
    found = TaskRuns("pick-place", "base", tuple(runs), None, "", beside, "aside on the other cube")
    checks = run_checks(found)
    done = sum(r.passed for r in runs)
    figures = run_figures(runs)
    aside = figures.pop("median error after correction", None)
    share = {"set on the other cube": Measured(100 * done / max(len(runs), 1), unit="%")}
    if aside is not None:
        share["median distance aside"] = aside
    return stamp(
        CalibrationResult(
            "pick-place",
            verdict_of(checks),
            checks=checks,
            figures={**share, **figures},
            details=(found,),
            options={"view": view},
        )
    )
