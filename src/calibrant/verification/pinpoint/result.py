"""Pinpoints as a result: what is predicted before the arm moves, errors when they were measured, over seeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from calibrant.arrays import Array
from calibrant.data import CalibrationResult, Check, verdict_of
from calibrant.data.details import TaskRun, TaskRuns
from calibrant.data.verdicts import stamp
from calibrant.verification.runs import run_checks, run_figures, unreachable_tolerance
from calibrant.verification.touch.errors import Touch, correction_of
from calibrant.verification.touch.result import (
    corrected_transform,
    correction_words,
    mean_offset,
    task_checks,
    touch_runs,
)


def pinpoint_result(
    touches: Sequence[Touch], X: Array, *, parent: str, camera: str, tolerance_mm: float | None
) -> CalibrationResult:
    """The result of kind "pinpoint" of measured pinpoints of one calibration."""
    found = correction_of(touches)
    words = f"To correct the calibration: {correction_words(found, camera, parent)} (the result holds that transform)."
    runs = TaskRuns("pinpoint", "base", touch_runs(touches, tolerance_mm=tolerance_mm), tolerance_mm, words)
    checks = (*task_checks(touches, runs), *_tolerance(runs.runs, tolerance_mm))
    return stamp(
        CalibrationResult(
            "pinpoint",
            verdict_of(checks),
            checks=checks,
            transforms=(corrected_transform(X, found, parent=parent, camera=camera),),
            figures={**run_figures(runs.runs), **mean_offset(touches)},
            details=(runs,),
        )
    )


def planned_result(
    said: Sequence[tuple[str, str, float]], *, tolerance_mm: float | None, advice: str
) -> CalibrationResult:
    """The same before anything was measured: (name, the coordinate in words, predicted 95 % error in mm) of each."""
    rows = tuple(TaskRun(name, True, predicted_95_mm=p, reason=words) for name, words, p in said)
    runs = TaskRuns("pinpoint", "base", rows, tolerance_mm, advice)
    most = max(p for *_, p in said)
    text = f"{len(rows)} place{'s' * (len(rows) > 1)} to go to; predicted errors up to {most:.2f} mm (95 %)"
    checks = (Check("pinpoint", "ok", text), *_tolerance(rows, tolerance_mm))
    return stamp(CalibrationResult("pinpoint", verdict_of(checks), checks=checks, details=(runs,)))


def series_result(
    runs: Sequence[TaskRun], *, view: str, tolerance_mm: float | None, beside: Mapping[str, str] | None = None
) -> CalibrationResult:
    """The same over many cells, each calibrated by itself."""
    found = TaskRuns("pinpoint", "base", tuple(runs), tolerance_mm, "", beside or {})
    checks = (*run_checks(found), *_tolerance(runs, tolerance_mm))
    return stamp(
        CalibrationResult(
            "pinpoint",
            verdict_of(checks),
            checks=checks,
            figures=run_figures(runs),
            details=(found,),
            options={"view": view, "seeds": len(runs)},
        )
    )


def _tolerance(runs: Sequence[TaskRun], tolerance_mm: float | None) -> tuple[Check, ...]:
    known = [r.predicted_95_mm for r in runs if r.predicted_95_mm is not None]
    words = unreachable_tolerance(float(np.median(known)), tolerance_mm) if known else None
    return () if words is None else (Check("tolerance", "warn", words),)
