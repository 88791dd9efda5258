"""A run as a result: what remains, how sure that is, the way it went."""

from __future__ import annotations

import numpy as np

from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, Check, Measured, TransformEstimate, verdict_of
from calibrant.data.records.servoing import ServoSample, ServoTrace
from calibrant.data.verdicts import stamp
from calibrant.servoing.loop import Sample, ServoOptions, ServoRun
from calibrant.servoing.stability import Margin


def servo_result(
    run: ServoRun, *, control: str, options: ServoOptions, camera: Camera, name: str, margin: Margin
) -> CalibrationResult:
    """Kind "servo": figures of what remains with 1 sigma of its worst direction, checks, and the trace.

    Args: control: the law's name; name: the camera's.
    """
    left = run.last
    arrived = (
        f"{left.mm:.2g} ± {left.sigma_mm:.2g} mm and {left.deg:.2g} ± {left.sigma_deg:.2g} deg remain (1 sigma), "
        f"within {options.tolerance_mm:g} mm and {options.tolerance_deg:g} deg at 99 %; {run.pictures} pictures"
    )
    checks = [Check("arrived", "ok", arrived, left.mm), stability_check(margin)]
    aside = np.hypot(run.whole.mm, 0.0)
    if aside > options.tolerance_mm + 3 * run.whole.sigma_mm:
        words = (
            f"{run.whole.mm:.3g} ± {run.whole.sigma_mm:.2g} mm and {run.whole.deg:.3g} ± {run.whole.sigma_deg:.2g} deg "
            f"differ along what {control} control leaves alone: height and tilt are not those that were taught"
        )
        checks.append(Check("left-alone", "warn", words, float(aside)))
    held = sorted({w for s in run.samples for w in s.bounds})
    if held:
        checks.append(Check("held", "ok", f"on the way {', '.join(held)} slowed the arm; it went on"))
    figures = {
        "remaining distance": Measured(left.mm, left.sigma_mm, "mm"),
        "remaining turn": Measured(left.deg, left.sigma_deg, "deg"),
        "pictures": Measured(run.pictures),
        "time": Measured(round(run.seconds, 3), unit="s"),
        "margin": Measured(round(margin.at_sigma, 4)),
    }
    there = TransformEstimate("base", "gripper", run.T_base_gripper)
    return stamp(
        CalibrationResult(
            "servo", verdict_of(tuple(checks)), tuple(checks), cameras={name: camera}, transforms=(there,),
            figures=figures, details=(trace_of(run, control),), options={"control": control},
        )
    )  # fmt: skip


def stability_check(margin: Margin) -> Check:
    """What a wrong calibration would do to the loop, in words."""
    words = (
        f"servoing converges with the focal length assumed {margin.focal_low:.2f} to {margin.focal_high:.2f} times the "
        f"true one, and with the camera's mounting wrong by up to {margin.hand_eye_deg:.0f} deg; at two sigmas of this "
        f"calibration its slowest direction has {100 * margin.at_sigma:.0f} % of the speed asked for"
    )
    status = "ok" if margin.at_sigma > 0.5 else "warn" if margin.at_sigma > 0 else "fail"
    return Check("stability", status, words, margin.at_sigma)  # type: ignore[arg-type]


def trace_of(run: ServoRun, control: str) -> ServoTrace:
    """The run's pictures, times from its first."""
    start = run.samples[0].time_s
    return ServoTrace(control, tuple(_sample(s, start) for s in run.samples))


def _sample(s: Sample, start: float) -> ServoSample:
    return ServoSample(
        time_s=round(s.time_s - start, 4), resting=s.resting, error_px=s.error_px, mm=s.mm, deg=s.deg,
        sigma_mm=s.sigma_mm, sigma_deg=s.sigma_deg, gain=s.gain,
        mm_s=1e3 * float(np.linalg.norm(s.twist[3:])), deg_s=float(np.rad2deg(np.linalg.norm(s.twist[:3]))),
        manipulability=None if np.isnan(s.manipulability) else s.manipulability, held_by=s.bounds,
    )  # fmt: skip
