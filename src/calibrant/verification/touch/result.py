"""Touches as runs, and as a result: errors beside what was predicted, and the correction that they propose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calibrant.arrays import Array
from calibrant.data import CalibrationResult, Check, Measured, TransformEstimate, as_transform, verdict_of
from calibrant.data.details import TaskRun, TaskRuns
from calibrant.data.results import Status
from calibrant.data.verdicts import stamp
from calibrant.diagnose.movement import figure
from calibrant.geometry import se3
from calibrant.optimize.chances import chi2_tail
from calibrant.verification.runs import run_checks, run_figures, too_far
from calibrant.verification.touch.errors import Correction, Touch, correction_of, left_out

CONTRADICTS = 1e-3
"""Chance of errors as large, all touches together, from which on the calibration does not hold."""
ENOUGH = 3
"""Touches from which on a correction can be checked by leaving each out."""


def touch_run(
    touch: Touch, *, tolerance_mm: float | None, after: Touch | None = None, seed: int | None = None
) -> TaskRun:
    """A touch as a run, with the same after a correction."""
    error = 1e3 * float(np.linalg.norm(touch.error))
    reason = too_far(error, tolerance_mm)
    sigma = 1e3 * np.sqrt(np.diag(touch.covariance)[3:])
    run = TaskRun(
        touch.name,
        not reason,
        error,
        1e3 * touch.predicted_95,
        touch.inside,
        seed,
        _triple(1e3 * touch.error),
        _triple(sigma),
        None if touch.turn is None else float(np.rad2deg(np.linalg.norm(touch.turn))),
        None if touch.turn is None else float(np.rad2deg(touch.turn_95)),
        reason=reason,
    )
    if after is None:
        return run
    return replace(
        run,
        after_mm=1e3 * float(np.linalg.norm(after.error)),
        after_95_mm=1e3 * after.predicted_95,
        after_deg=None if after.turn is None else float(np.rad2deg(np.linalg.norm(after.turn))),
        after_inside=after.inside,
    )


def _triple(values: Array) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in values)
    return x, y, z


def touch_runs(touches: Sequence[Touch], *, tolerance_mm: float | None) -> tuple[TaskRun, ...]:
    """Every touch, and what it would be with the camera corrected by the others."""
    after = left_out(touches) if len(touches) >= ENOUGH else [None] * len(touches)
    return tuple(touch_run(t, tolerance_mm=tolerance_mm, after=a) for t, a in zip(touches, after))


def correction_words(found: Correction, camera: str, parent: str) -> str:
    """What the correction does to the camera, in words."""
    step = -1e3 * found.error[3:]
    sigma = 1e3 * np.sqrt(np.diag(found.covariance)[3:])
    turn = -np.rad2deg(found.error[:3])
    spread = np.rad2deg(np.sqrt(np.diag(found.covariance)[:3]))
    places = ", ".join(f"{a} {figure(v, s)}" for a, v, s in zip("xyz", step, sigma))
    turns = ", ".join(f"{a} {figure(v, s)}" for a, v, s in zip("xyz", turn, spread))
    return f"move camera {camera} in the {parent} by {places} mm and turn it by {turns} deg"


def corrected_transform(X: Array, found: Correction, *, parent: str, camera: str) -> TransformEstimate:
    """T_parent_camera after the correction, with its covariance."""
    return as_transform(parent, camera, se3.retract(X, -found.error), found.covariance)


def joint_chance(touches: Sequence[Touch]) -> float:
    """Chance of errors as large in all touches together, the calibration's error being one for all of them."""
    found = correction_of(touches)
    prior = np.mean([np.linalg.inv(t.of_move) @ t.calibration @ np.linalg.inv(t.of_move).T for t in touches], axis=0)
    scale = np.sqrt(np.diag(prior))
    white = found.error / scale
    total = float(white @ np.linalg.solve(prior / scale[:, None] / scale, white))
    count = 0
    for t in touches:
        rows = slice(3, 6) if t.turn is None else slice(0, 6)
        error = t.error if t.turn is None else np.concatenate([t.turn, t.error])
        left = error - t.of_move[rows] @ found.error
        total += float(left @ np.linalg.solve(t.drawn[rows, rows], left))
        count += len(error)
    return chi2_tail(count, total)


def task_checks(touches: Sequence[Touch], runs: TaskRuns) -> tuple[Check, ...]:
    """Pass or fail, and whether the errors are what the calibration predicts."""
    chance = joint_chance(touches)
    text = f"errors as large have a chance of {chance:.2g} by what the calibration states"
    status: Status = "warn" if chance < CONTRADICTS else "ok"
    if status == "warn":
        text += ": the camera has been moved, or the tip or the marker are not where they were said to be"
    return (*run_checks(runs), Check("chi-square", status, text, chance))


def touch_result(
    touches: Sequence[Touch], X: Array, *, parent: str, camera: str, tolerance_mm: float | None
) -> CalibrationResult:
    """The result of kind "touch"."""
    found = correction_of(touches)
    words = correction_words(found, camera, parent)
    runs = TaskRuns(
        "touch", "base", touch_runs(touches, tolerance_mm=tolerance_mm), tolerance_mm, _advice(words, touches)
    )
    checks = task_checks(touches, runs)
    return stamp(
        CalibrationResult(
            "touch",
            verdict_of(checks),
            checks=checks,
            transforms=(corrected_transform(X, found, parent=parent, camera=camera),),
            figures={**run_figures(runs.runs), **mean_offset(touches)},
            details=(runs,),
        )
    )


def mean_offset(touches: Sequence[Touch]) -> dict[str, Measured]:
    """The mean offset of all touches along the base's axes, with the sigma that is drawn anew."""
    mean = 1e3 * np.mean([t.error for t in touches], axis=0)
    drawn = np.mean([np.diag(t.drawn)[3:] for t in touches], axis=0) / len(touches)
    shared = np.mean([np.diag(t.calibration)[3:] for t in touches], axis=0)
    sigma = 1e3 * np.sqrt(drawn + shared)
    return {f"offset {a}": Measured(float(v), float(s), "mm") for a, v, s in zip("xyz", mean, sigma)}


def _advice(words: str, touches: Sequence[Touch]) -> str:
    if len(touches) < ENOUGH:
        return (
            f"By {len(touches)} touch{'es' * (len(touches) > 1)}: {words}. Three touches or more, apart from each "
            "other, "
            "tell rotations and check themselves."
        )
    return f"To correct the calibration by these {len(touches)} touches: {words} (the result holds that transform)."
