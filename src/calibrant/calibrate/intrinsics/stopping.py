"""Solvers that are told when to stop: what was asked, and how far from the least error that leaves a result."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibrant.calibrate.intrinsics.fit import ORDINARY, Stopping
from calibrant.data import CalibrationResult, Check, verdict_of
from calibrant.errors import InputError

NEGLIGIBLE = 0.1
"""Of a sigma: what adds half a per cent to it."""


def stopping(max_iterations: int, epsilon_px: float) -> Stopping:
    """When solvers stop, as options say it. Raises: InputError for values that no solver can do with."""
    if max_iterations < 1 or not 0 <= epsilon_px < float("inf"):
        raise InputError(
            f"max_iterations is 1 or more and epsilon 0 px or more, got {max_iterations} and {epsilon_px} px"
        )
    return Stopping(max_iterations, epsilon_px)


def stopped(result: CalibrationResult, stop: Stopping) -> CalibrationResult:
    """The result with what was asked of the solver and, of an epsilon, how far from the least error it may be.

    A step that would lower the RMS error e of n points by eps has lowered their cost by no more than n e eps; in sigmas
    of the noise, e / sqrt(2) per axis, it is no longer than sqrt(4 n eps / e).
    """
    if stop == ORDINARY:
        return result
    options = {**result.options, "max_iterations": stop.max_iterations, "epsilon_px": stop.epsilon_px}
    done = replace(result, options=options)
    points = sum(v.points for v in result.views if v.used)
    if not stop.epsilon_px or not result.rms_px:
        return done
    sigmas = float(np.sqrt(4 * points * stop.epsilon_px / result.rms_px))
    text = f"stopped at epsilon {stop.epsilon_px:g} px, up to {sigmas:.2g} sigma from the least error"
    coarse = sigmas > NEGLIGIBLE
    check = Check(
        "termination", "warn" if coarse else "ok", text + (", which no sigma holds" if coarse else ""), sigmas
    )
    checks = (*result.checks, check)
    return replace(done, checks=checks, verdict=verdict_of(checks))
