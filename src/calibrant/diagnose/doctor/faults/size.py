"""A target of another size than given: the robot's motion is a ruler.

The target's scale s is freed in A_i X B_i(s) = Z, with all sources of noise (`calibrate.cell.loop_noise`, the
estimate that the calibration states too); (s - 1) / sigma_s is Student's t when the size is right.
"""

from __future__ import annotations

from functools import partial

from calibrant.arrays import Array
from calibrant.calibrate.cell.loop.fit import fit_loop
from calibrant.calibrate.solvers.loop_errors import loop_consistency
from calibrant.data import Measured
from calibrant.diagnose.conventions.hypotheses import CONSISTENT
from calibrant.diagnose.doctor.evidence.case import Case
from calibrant.diagnose.doctor.evidence.finding import Finding
from calibrant.diagnose.doctor.evidence.loop import Evidence
from calibrant.diagnose.doctor.evidence.significance import CONVINCING, confidence, student_test
from calibrant.geometry import se3

MATTERS = 0.005
"""A printed board is off by up to 0.5 % (a printer's scaling, paper and humidity); more is a wrong size."""
UNITS = {1000.0: "mm instead of m", 0.001: "m instead of mm", 25.4: "inches instead of mm", 1 / 25.4: "mm for inches"}
UNIT_SHARE = 0.05
"""A scale within 5 % of the ratio of two units is a mistake of units."""
WRONG_UNIT = 2.0
"""A target twice or half as large as said: no calibration is handed out of it."""


def sensitivity(case: Case) -> tuple[Array, Array]:
    """Change (6,) of X and of Z for a target larger by its own size, tangents of se3.retract: rad and m."""
    step = 1e-3  # the loop is nearly linear in the scale
    used = ~case.robust.outlier
    fits = [fit_loop(c.A, c.B, case.robust.X, used=used, certainty=c.certainty) for c in (case, case.scaled(1 + step))]
    return se3.local(fits[0].X[0], fits[1].X[0]) / step, se3.local(fits[0].Z[0], fits[1].Z[0]) / step


def examine(case: Case) -> list[Finding]:
    """Does the target's size fit the robot's motion?"""
    fit = case.size
    if fit is None:
        return []
    value, sigma = fit.size.value, fit.size.sigma
    # Off by more than any print is: the test is of what lies beyond that.
    p = student_test(max(abs(value - 1) - MATTERS, 0.0), sigma, int(fit.freedom))
    if p > CONVINCING:
        return []
    repaired = case.scaled(value)
    if loop_consistency(repaired.A, repaired.B, fit.X).score > CONSISTENT:
        return []  # motions that have nothing in common have no scale either
    evidence = Evidence(case.loop, repaired.loop)
    unit = next((words for ratio, words in UNITS.items() if abs(value / ratio - 1) < UNIT_SHARE), None)
    text = f"{value:.4f} ± {sigma:.4f} times as large as given"
    cause = f" ({unit})" if unit else ""
    share = f"; at that size {evidence.text}"
    gross = max(value, 1 / value) > WRONG_UNIT
    return [
        Finding(
            "target-size",
            "fail" if gross else "warn",
            f"the target's size does not fit the robot's motion: the target is {text}{cause}{share}",
            confidence(p),
            evidence,
            measured=Measured(value * case.scale, sigma * case.scale),
            proposal="measure the target, and give its real size",
            repair=partial(Case.scaled, factor=value),
            gain=max(case.misfit - repaired.misfit, 0.0),
        )
    ]
