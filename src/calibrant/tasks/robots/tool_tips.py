"""What `tool touch` and `tool seen` share: poses of the flange, and a tip as a result."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from calibrant.tasks.inputs import session

if TYPE_CHECKING:
    from calibrant.calibrate.tool.moved_point import MovedPoint
    from calibrant.calibrate.tool.tip import ToolTip
    from calibrant.data import CalibrationResult, Check, RobotPoses, ViewResult
    from calibrant.data.details import TouchedPoint
    from calibrant.formats.poses.read import PoseNotation

ODD = 0.01
"""Chance below which some pose is flagged when all are good: once in a hundred tools."""
LEVER = 10.0
"""Times the noise of a touch that the tip may be uncertain by: turns of some 6 degrees, where 30 leave two times it."""


def flange_poses(reading: PoseNotation) -> RobotPoses:
    """The poses of a file, read in one way."""
    from calibrant.data import RobotPoses

    return RobotPoses(reading.ids, reading.T_base_gripper, reading.description)


def tip_result(
    tip: ToolTip, reading: PoseNotation, files: Sequence[str | Path], *, moved: MovedPoint | None = None
) -> CalibrationResult:
    """A tip as a result, that passed its checks.

    Args: reading: how the poses were read; files: what was read; moved: where the touched point moved.

    Raises: RefusedError with the result that failed them.
    """
    from calibrant.data import CalibrationResult, Check, as_transform, verdict_of
    from calibrant.data.verdicts import refuse_if_failed, stamp
    from calibrant.geometry import se3

    covariance = np.zeros((6, 6))
    covariance[3:, 3:] = tip.covariance
    against = "; ".join(reading.contradicts)
    words = f"{reading.description} ({against})" if against else reading.description
    read = Check("pose-reading", "warn" if against else "ok", words)
    checks = (_agreement(tip), *_moved(tip, moved), _tip_certainty(tip), read)
    found = stamp(
        CalibrationResult(
            "tool", verdict_of(checks), checks, views=_tip_views(tip), decided={"pose_reading": reading.description},
            details=_touched(tip), inputs=session.file_records(files),
            transforms=(as_transform("flange", "tip", se3.make(np.eye(3), tip.tip), covariance),),
            sigma_px=tip.sigma if tip.unit == "px" else None,
        )
    )  # fmt: skip
    refuse_if_failed(found)
    return found


def _tip_views(tip: ToolTip) -> tuple[ViewResult, ...]:
    from calibrant.data import ViewResult

    odd = tip.chances < ODD / len(tip.chances)
    return tuple(
        ViewResult(
            name, True, 1, float(r) if tip.unit == "px" else None,
            f"{r:.3g} {tip.unit} off, at odds with the others" if bad else None,
        )
        for name, r, bad in zip(tip.ids, tip.residuals, odd)
    )  # fmt: skip


def _touched(tip: ToolTip) -> tuple[TouchedPoint, ...]:
    from calibrant.data.details import TouchedPoint

    if tip.point is None:
        return ()
    x, y, z = (round(1e3 * float(c), 6) for c in tip.point)
    off = {name: round(float(r), 6) for name, r in zip(tip.ids, tip.residuals)}
    return (TouchedPoint((x, y, z), off),)


def _agreement(tip: ToolTip) -> Check:
    from calibrant.data import Check

    text = f"the poses agree on the tip to {tip.sigma:.3g} {tip.unit} (1 sigma per axis)"
    worst = int(np.argmin(tip.chances))
    far = int(np.argmax(tip.residuals))
    odd = tip.chances[worst] < ODD / len(tip.chances)
    if odd:
        text += (
            f"; {tip.ids[worst]} is off by {tip.residuals[worst]:.3g} {tip.unit}, at odds with the others: "
            "repeat it, or leave it out"
        )
    from calibrant.calibrate.tool.tip import TOUCH_MM

    if tip.unit == "mm" and tip.sigma > TOUCH_MM[0]:
        text += "" if odd else f", farthest {tip.ids[far]}, {tip.residuals[far]:.3g} mm"
        text += (
            f"; one and the same point is touched to better than {TOUCH_MM[0]:g} mm: are these the poses of the "
            "touches, and is their unit right?"
        )
        return Check("agreement", "fail" if tip.sigma > TOUCH_MM[1] else "warn", text, tip.sigma)
    if odd:
        return Check("agreement", "warn", text, tip.sigma)
    return Check("agreement", "ok", f"{text}; farthest {tip.ids[far]}, {tip.residuals[far]:.3g} {tip.unit}", tip.sigma)


def _moved(tip: ToolTip, moved: MovedPoint | None) -> tuple[Check, ...]:
    from calibrant.data import Check

    if moved is None:
        return ()
    message = (
        f"the touched point moved by {moved.mm:.3g} mm between {tip.ids[moved.first - 1]} and {tip.ids[moved.first]}: "
        f"with two points the touches agree to {moved.sigma_mm:.2g} mm instead of {tip.sigma:.2g} mm; fix the point "
        "and touch it again, or give one part alone"
    )
    return (Check("point-moved", "fail", message, moved.mm),)


def _tip_certainty(tip: ToolTip) -> Check:
    from calibrant.data import Check

    mm = float(1e3 * np.sqrt(np.linalg.eigvalsh(tip.covariance)[-1]))
    text = f"the tip is known to {mm:.2g} mm (1 sigma, worst direction)"
    if tip.unit == "mm" and mm > LEVER * tip.sigma > 0:
        text += (
            f", {mm / tip.sigma:.0f} times what the touches agree to: tilt the tool further between them, 30 degrees"
        )
        return Check("certainty", "warn", text, mm)
    if tip.unit == "px":
        text += f"; {100 * tip.of_camera:.0f} % of its variance is the camera's own place and lens"
    return Check("certainty", "ok", text, mm)
