"""Find the offset between the clocks of camera and robot, from one motion that both recorded."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from calibrant.errors import InputError
from calibrant.tasks.inputs import session
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.choices import SETUPS
from calibrant.tasks.options.option import Option
from calibrant.tasks.options.robots import RobotOptions
from calibrant.tasks.outcome import Outcome

if TYPE_CHECKING:
    from calibrant.calibrate.clocks.offset import TimeOffset
    from calibrant.data import CalibrationResult, Check

EXAMPLE = 'cb.time_offset(poses="robot.csv", target_poses="camera.csv")'
WEAK_MS = 3.3
"""A tenth of a camera's frame at 30 per second: below it synchronisation is no longer the error that counts."""


@dataclass(frozen=True, kw_only=True)
class Request:
    """Find the constant offset between the clocks of camera and robot from one continuous motion.

    calibrant time-offset --poses robot.csv --target-poses camera.csv

    Both files have a column of times. Correlates the angular speeds, then refines the offset together with the camera's
    place, and says its sigma: t_robot = t_camera + offset.
    """

    poses: Annotated[Path, Option("FILE")]
    """Robot poses or joints with times."""
    target_poses: Annotated[Path, Option("FILE")]
    """Poses of the target in the camera with times."""
    setup: Annotated[str, Option("SETUP", choices=SETUPS[1:])] = "eye-in-hand"
    """eye-in-hand or eye-to-hand."""
    largest: Annotated[str, Option("TIME")] = "2s"
    """The offset is searched to either side, e.g. 2s or 500ms."""
    arm: RobotOptions = RobotOptions()


def reads(request: Request) -> list[Path | str]:
    """Both recordings, and the robot's file."""
    return [request.poses, request.target_poses, *request.arm.files]


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """The offset with its sigma, and the camera's place. Raises: InputError; RefusedError as `estimate_time_offset`."""
    from calibrant.calibrate.clocks.offset import estimate_time_offset
    from calibrant.data.verdicts import refuse_if_failed
    from calibrant.formats.poses.timed import read_timed_poses

    reach, arm = _seconds(request.largest), request.arm
    moved = read_timed_poses(request.poses, robot=arm.chain(), joint_angle=arm.joint_angle, maker=arm.robot_format)
    seen = read_timed_poses(request.target_poses)
    session.load_solver(listener)
    with listener.status("Aligning …"):
        # Times since 1970 lose no digits when counted from the start of the recording.
        origin = min(moved.times[0], seen.times[0])
        found = estimate_time_offset(
            moved.times - origin, moved.T, seen.times - origin, seen.T, setup=request.setup, largest=reach
        )
    result = _time_offset_result(found, request, f"robot: {moved.description}; camera: {seen.description}")
    refuse_if_failed(result)
    return Outcome(result=result)


def _seconds(text: str) -> float:
    units = {"ms": 1e-3, "s": 1.0}
    unit = next((u for u in units if text.strip().endswith(u)), None)
    try:
        value = float(text.strip().removesuffix(unit or "")) if unit else -1.0
    except ValueError:
        value = -1.0
    if unit is None or not 0 < value < 1e6:
        raise InputError(f"--largest takes a time with its unit, such as 2s or 500ms; got {text!r}")
    return value * units[unit]


def _time_offset_result(found: TimeOffset, request: Request, read: str) -> CalibrationResult:
    from calibrant.data import CalibrationResult, Measured, verdict_of
    from calibrant.data.verdicts import stamp

    checks = _time_offset_checks(found, read)
    return stamp(
        CalibrationResult(
            kind="time-offset",
            verdict=verdict_of(checks),
            checks=checks,
            transforms=(found.camera, found.target),
            options={"setup": request.setup, "largest": request.largest},
            figures={"offset": Measured(found.offset, found.sigma, "s")},
            decided={"pose_reading": read},
            inputs=session.file_records(reads(request)),
        )
    )


def _time_offset_checks(found: TimeOffset, read: str) -> tuple[Check, ...]:
    import numpy as np

    from calibrant.calibrate.clocks.offset import LOOP_ROTATION, LOOP_TRANSLATION
    from calibrant.data import Check

    ms, sigma = 1e3 * found.offset, 1e3 * found.sigma
    late = "behind" if ms >= 0 else "ahead of"
    sign = "+" if ms >= 0 else "−"
    words = (
        f"t_robot = t_camera {sign} {abs(ms):.3f} ms ± {sigma:.3f} ms: the camera's clock is {late} the robot's; "
        f"{'add' if ms >= 0 else 'take'} {abs(ms):.3f} ms {'to' if ms >= 0 else 'from'} its times"
    )
    weak = sigma > WEAK_MS
    position, rotation = found.noise[LOOP_TRANSLATION], found.noise[LOOP_ROTATION]
    loop = (
        f"closes to {found.rms_mm:.3g} mm and {found.rms_deg:.3g} deg rms, to {found.at_zero_mm:.3g} mm without the "
        f"offset; noise {1e3 * position.sigma:.3g} mm and {np.rad2deg(rotation.sigma):.3g} deg per axis"
    )
    more = "; move faster, or record for longer, for a better one" if weak else ""
    return (
        Check("time-offset", "warn" if weak else "ok", words + more, found.offset),
        Check("loop", "ok", loop, found.rms_mm),
        Check(
            "correlation", "ok", f"angular speeds correlate by {found.correlation:.4f}; {int(found.used.sum())} of "
            f"{len(found.used)} camera samples lie within the robot's", found.correlation,
        ),
        Check("pose-reading", "ok", read),
    )  # fmt: skip
