"""Runs of a task as a result: the median error, how many are inside what was predicted, pass or fail."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from calibrant.data import CalibrationResult, Check, Measured
from calibrant.data.details import TaskRun, TaskRuns
from calibrant.errors import InputError

FEW_INSIDE = 1e-3
"""Chance of so few runs inside their predicted 95 % regions, from which on the prediction is called too small."""


def median_mm(runs: Sequence[TaskRun], *, after: bool = False) -> float | None:
    """Median error of the runs that have one, mm."""
    errors = [r.after_mm if after else r.error_mm for r in runs]
    known = [e for e in errors if e is not None]
    return float(np.median(known)) if known else None


def inside_95(runs: Sequence[TaskRun]) -> tuple[int, int]:
    """How many runs are inside their predicted 95 % region, and of how many."""
    known = [r.inside for r in runs if r.inside is not None]
    return sum(known), len(known)


def few_inside(inside: int, of: int) -> float:
    """Chance of as few of them, or fewer, where each is inside with 95 % (binomial).

    >>> round(few_inside(17, 20), 3)
    0.075
    """
    from math import comb

    return float(sum(comb(of, k) * 0.95**k * 0.05 ** (of - k) for k in range(inside + 1)))


def run_checks(found: TaskRuns) -> tuple[Check, ...]:
    """Whether all runs passed, and whether the predictions hold."""
    runs = found.runs
    bad = [r for r in runs if not r.passed]
    if bad:
        reasons = "; ".join(f"{r.name}: {r.reason}" for r in bad[:4] if r.reason)
        text = f"{len(bad)} of {len(runs)} failed" + (f" ({reasons})" if reasons else "")
        checks = [Check(found.task, "fail", text, float(len(bad)))]
    else:
        within = "" if found.tolerance_mm is None else f", each within {found.tolerance_mm:g} mm"
        checks = [Check(found.task, "ok", f"{len(runs)} of {len(runs)} passed{within}", 0.0)]
    inside, of = inside_95(runs)
    if of:
        chance = few_inside(inside, of)
        text = f"{inside} of {of} errors are inside the 95 % region that the calibration predicted"
        if chance < FEW_INSIDE:
            text += f": as few come by chance once in {1 / max(chance, 1e-12):.0f}; it is less certain than it says"
        checks.append(Check("predicted", "warn" if chance < FEW_INSIDE else "ok", text, inside / of))
    return tuple(checks)


def run_figures(runs: Sequence[TaskRun]) -> dict[str, Measured]:
    """Median errors, with the sigma of a median of as many."""
    kinds = (
        ("median error", "mm", [r.error_mm for r in runs]),
        ("median error after correction", "mm", [r.after_mm for r in runs]),
        ("median turn", "deg", [r.turned_deg for r in runs]),
        ("median turn after correction", "deg", [r.after_deg for r in runs]),
    )
    figures = {}
    for name, unit, values in kinds:
        known = np.array([v for v in values if v is not None])
        if len(known):
            spread = 1.2533 * float(known.std(ddof=1)) / np.sqrt(len(known)) if len(known) > 1 else float("nan")
            figures[name] = Measured(float(np.median(known)), spread, unit)
    return figures


def runs_json(result: CalibrationResult) -> dict[str, Any]:
    """The runs as data, as `--cell --json` prints them. Raises: InputError for a result without runs."""
    found = result.detail(TaskRuns)
    if found is None:
        raise InputError(f"a result of kind {result.kind!r} holds no runs")
    inside, of = inside_95(found.runs)
    out: dict[str, Any] = {
        "runs": [_row(r) for r in found.runs],
        "median_mm": median_mm(found.runs),
        "passed": all(r.passed for r in found.runs),
        "inside_95": inside,
        "inside_95_of": of,
    }
    after = median_mm(found.runs, after=True)
    if after is not None:
        out["median_after_mm"] = after
    return out | ({"beside": dict(found.beside)} if found.beside else {})


def runs_text(result: CalibrationResult) -> str:
    """The same as JSON."""
    return json.dumps(runs_json(result), indent=2, ensure_ascii=False) + "\n"


def _row(run: TaskRun) -> dict[str, Any]:
    first: Mapping[str, Any] = {
        "seed": run.seed,
        "error_mm": run.error_mm,
        "predicted_95_mm": run.predicted_95_mm,
        "passed": run.passed,
    }
    rest = {k: getattr(run, k) for k in run.__dataclass_fields__ if k not in first}
    return {**first, **{k: v for k, v in rest.items() if v not in (None, "")}}


def too_far(error_mm: float, tolerance_mm: float | None) -> str:
    """Why an error is no pass, empty where it is one."""
    if tolerance_mm is None or error_mm <= tolerance_mm:
        return ""
    return f"{error_mm:.2f} mm off, more than the tolerance of {tolerance_mm:g} mm"


def unreachable_tolerance(predicted_95_mm: float, tolerance_mm: float | None) -> str | None:
    """Words for a tolerance below what the calibration predicts; None where it can be met."""
    if tolerance_mm is None or predicted_95_mm <= tolerance_mm:
        return None
    return (
        f"a tolerance of {tolerance_mm:g} mm cannot be met with certainty: this calibration predicts errors up to "
        f"{predicted_95_mm:.2f} mm (95 %). Calibrate with more pictures, nearer, or correct the camera by touches"
    )
