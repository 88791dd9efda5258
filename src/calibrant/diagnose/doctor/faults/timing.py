"""Robot poses that were read earlier or later than the pictures: a constant delay, where the times are known.

With the robot's velocity xi_i at moment i, a delay dt moves the loop by d_i = dt * (change of A_i X B_i along xi_i):
one number for all views, by linear least squares with X and Z.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.cell.loop.fit import LoopFit, fit_loop
from calibrant.data import Measured
from calibrant.diagnose.doctor.evidence.case import Case, loop_of
from calibrant.diagnose.doctor.evidence.finding import Finding
from calibrant.diagnose.doctor.evidence.loop import Evidence
from calibrant.diagnose.doctor.evidence.significance import CONVINCING, confidence, nested_test
from calibrant.formats.poses.notations import PoseNotation
from calibrant.geometry import se3

LEAST_VIEWS = 8
"""One more unknown and a velocity from neighbours need some views."""
BETTER = 1.3
"""The loop must become 1.3 times narrower: velocities from differences explain a little of anything."""


def times_of(notation: PoseNotation) -> Array | None:
    """Seconds (n,) of a file's own column of times, or of names that are time stamps; None where they do not grow."""
    if notation.times is None:
        return times_of_names(notation.ids)
    grows = len(notation.times) > 1 and bool(np.all(np.diff(notation.times) > 0))
    return notation.times - notation.times[0] if grows else None


def times_of_names(names: tuple[str, ...]) -> Array | None:
    """Seconds, where every name is a time stamp: numbers that grow and are not a plain count. (n,) or None."""
    stems = [n.rsplit("/", 1)[-1] for n in names]
    for suffix in (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm"):
        stems = [s.removesuffix(suffix) for s in stems]
    try:
        values = np.array([float(s) for s in stems])
    except ValueError:
        return None
    if len(values) < 2 or not np.all(np.isfinite(values)) or np.any(np.diff(values) <= 0):
        return None
    if np.all(values == np.round(values)) and values[0] < 1e9:
        return None  # 0, 1, 2 … are numbers of pictures; seconds since 1970 are beyond 1e9
    for unit in (1e9, 1e6, 1e3):  # nano-, micro-, milliseconds since 1970
        if values[0] > 1e9 * unit / 2:
            return (values - values[0]) / unit
    return values - values[0]


def examine(case: Case) -> list[Finding]:
    """Does a constant delay between robot and camera narrow the loop?"""
    if case.times is None or len(case.index) < LEAST_VIEWS:
        return []
    used = ~case.robust.outlier
    single = fit_loop(case.A, case.B, case.robust.X, used=used, certainty=case.certainty)
    delay, sigma = _delay(single, _motion(case))
    repaired = _later(case, delay)
    again = fit_loop(repaired.A, case.B, case.robust.X, used=used, certainty=case.certainty)
    levels = again.sigma_rotation, again.sigma_translation
    before, after = single.squares(*levels), again.squares(*levels)
    p = nested_test(before, after, 1, again.freedom - 1)
    if p > CONVINCING or before < BETTER**2 * after:
        return []
    evidence = Evidence(loop_of(single.deviation), loop_of(again.deviation))
    message = (
        f"the robot poses were read {abs(1e3 * delay):.3g} ± {1e3 * sigma:.2g} ms "
        f"{'earlier' if delay > 0 else 'later'} than the pictures: taken at the same time, {evidence.text}"
    )
    return [
        Finding(
            "unsynchronised",
            "fail",
            message,
            confidence(p),
            evidence,
            measured=Measured(delay, sigma),
            proposal="stand still for every picture, or move the poses by that time",
            repair=partial(_later, seconds=delay),
            gain=max(case.misfit - repaired.misfit, 0.0),
        )
    ]


def _motion(case: Case) -> Array:
    """(m, 6) change of the loop a second that the robot's motion makes."""
    step = 1e-4
    moved = case.setup.normal_form(_poses_at(case, step)[case.index])
    Z = case.A @ case.robust.X @ case.B
    return se3.local(Z, moved @ case.robust.X @ case.B) / step


def _delay(fit: LoopFit, motion: Array) -> tuple[float, float]:
    """dt with d + dt motion as small as X and Z allow, and its sigma."""
    weight = 1 / fit.sigmas[fit.used]
    rows = np.concatenate([fit.rows[fit.used], motion[fit.used][..., None]], axis=2) * weight[..., None]
    J, r = rows.reshape(-1, rows.shape[2]), (fit.deviation[fit.used] * weight).reshape(-1)
    solution, *_ = np.linalg.lstsq(J, -r, rcond=None)
    left = r + J @ solution
    variance = float(left @ left) / max(len(r) - J.shape[1], 1)
    return float(solution[-1]), float(np.sqrt(variance * np.linalg.pinv(J.T @ J)[-1, -1]))


def _poses_at(case: Case, seconds: float) -> Array:
    """T_base_gripper (n, 4, 4) at times + seconds, along the screw between neighbours in time."""
    T, t = case.data.T_base_gripper, case.times
    last = len(T) - 1
    i = np.arange(len(T))
    a, b = np.maximum(i - 1, 0), np.minimum(i + 1, last)
    twist = se3.log(se3.inverse(T[a]) @ T[b]) / (t[b] - t[a])[:, None]  # type: ignore[index]
    return T @ se3.exp(seconds * twist)


def _later(case: Case, seconds: float) -> Case:
    """The robot poses as they were `seconds` later."""
    return replace(case, data=replace(case.data, T_base_gripper=_poses_at(case, seconds)))
