"""Stitched clouds as a result: a run a pair, pass or fail, the predicted distance beside the measured one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calibrant.data import CalibrationResult, Check, Measured, verdict_of
from calibrant.data.details import TaskRun, TaskRuns
from calibrant.data.verdicts import stamp
from calibrant.verification.runs import run_checks, too_far
from calibrant.verification.stitch.clouds import Pair
from calibrant.verification.touch.errors import chi2_at

FREE = 6.0
"""Degrees of freedom of how two clouds lie to each other: the blocks of a pair err by no more than that together."""


def pair_run(pair: Pair, *, tolerance_mm: float | None, seed: int | None = None) -> TaskRun:
    """A pair as a run: RMS distance of its blocks, and what 95 % of pairs stay below."""
    error = 1e3 * pair.rms
    reason = too_far(error, tolerance_mm)
    limit = 1e3 * pair.expected * float(np.sqrt(chi2_at(0.95, FREE) / FREE))
    return TaskRun(pair.name, not reason, error, limit, error <= limit, seed, reason=reason)


def stitch_result(pairs: Sequence[Pair], *, tolerance_mm: float | None, seeds: Sequence[int] = ()) -> CalibrationResult:
    """The result of kind "stitch"."""
    drawn: list[int | None] = [*seeds] or [None] * len(pairs)
    runs = tuple(pair_run(p, tolerance_mm=tolerance_mm, seed=s) for p, s in zip(pairs, drawn))
    found = TaskRuns("stitch", "base", runs, tolerance_mm)
    every = np.concatenate([p.distances for p in pairs])
    rms = 1e3 * float(np.sqrt(np.mean(every**2)))
    expected = 1e3 * float(np.sqrt(np.mean(np.concatenate([p.variance for p in pairs]))))
    ratio = rms / max(expected, 1e-9)
    text = f"clouds are {rms:.2f} mm apart (rms of {len(every)} blocks), {expected:.2f} mm are predicted"
    wide = ratio > np.sqrt(chi2_at(0.999, FREE) / FREE)
    if wide:
        text += ": the camera has been moved, the poses belong to other pictures, or depth has another scale"
    checks = (*run_checks(found), Check("agreement", "warn" if wide else "ok", text, ratio))
    figures = {"distance": Measured(rms, unit="mm"), "predicted distance": Measured(expected, unit="mm")}
    return stamp(CalibrationResult("stitch", verdict_of(checks), checks=checks, figures=figures, details=(found,)))
