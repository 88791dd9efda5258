"""`calibrant time-offset`: the offset between the clocks of camera and robot."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calibrant.cli import options as o
from calibrant.errors import InputError
from calibrant.tasks.inputs.robot_choice import RobotChoice

if TYPE_CHECKING:
    from calibrant.calibrate.clocks.offset import TimeOffset
    from calibrant.data import CalibrationResult


def time_offset(
    poses: Annotated[
        Path, typer.Option("--poses", metavar="FILE", help="Robot poses or joints with times.", show_default=False)
    ],
    target_poses: Annotated[
        Path,
        typer.Option(
            "--target-poses", metavar="FILE", help="Poses of the target in the camera with times.", show_default=False
        ),
    ],
    setup: Annotated[str, typer.Option("--setup", metavar="SETUP", help="eye-in-hand or eye-to-hand.")] = "eye-in-hand",
    largest: Annotated[
        str, typer.Option("--largest", metavar="TIME", help="The offset is searched to either side, e.g. 2s or 500ms.")
    ] = "2s",
    robot_format: o.RobotFormat = None,
    robot: o.Robot = None,
    robot_link: o.RobotLink = None,
    robot_base: o.RobotBase = None,
    joint_angle: o.JointAngle = "auto",
    out: o.Out = None,
    json: o.Json = False,
    quiet: o.Quiet = False,
    force: o.Force = False,
    debug: o.Debug = False,
) -> None:
    """Find the constant offset between the clocks of camera and robot from one continuous motion.

    calibrant time-offset --poses robot.csv --target-poses camera.csv

    Both files have a column of times. Correlates the angular speeds, then refines the offset together with the camera's
    place, and says its sigma: t_robot = t_camera + offset.
    """
    from calibrant.cli import session

    outputs = session.Outputs(out, None, json, quiet, force)
    outputs.check()
    outputs.spare([poses, target_poses])
    reach = _seconds(largest)

    from calibrant.calibrate.clocks.offset import estimate_time_offset
    from calibrant.formats.poses.timed import read_timed_poses

    arm = RobotChoice(robot, robot_link, robot_base, joint_angle, robot_format)
    moved = read_timed_poses(poses, robot=arm.chain(), joint_angle=joint_angle, maker=robot_format)
    seen = read_timed_poses(target_poses)
    session.load_solver(quiet=quiet or json)
    with session.status("Aligning …", quiet=quiet or json):
        # Times since 1970 lose no digits when counted from the start of the recording.
        origin = min(moved.times[0], seen.times[0])
        found = estimate_time_offset(
            moved.times - origin, moved.T, seen.times - origin, seen.T, setup=setup, largest=reach
        )
    read = f"robot: {moved.description}; camera: {seen.description}"
    result = _result(found, setup, read, session.file_records([poses, target_poses, *arm.files]))
    session.finish(result, outputs)


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


def _result(found: TimeOffset, setup: str, read: str, inputs: tuple[dict[str, str], ...]) -> CalibrationResult:
    import numpy as np

    from calibrant.calibrate.clocks.offset import LOOP_ROTATION, LOOP_TRANSLATION
    from calibrant.data import CalibrationResult, Check, Measured, verdict_of
    from calibrant.data.verdicts import stamp

    ms, sigma = 1e3 * found.offset, 1e3 * found.sigma
    late = "behind" if ms >= 0 else "ahead of"
    sign = "+" if ms >= 0 else "−"
    words = (
        f"t_robot = t_camera {sign} {abs(ms):.3f} ms ± {sigma:.3f} ms: the camera's clock is {late} the robot's; "
        f"{'add' if ms >= 0 else 'take'} {abs(ms):.3f} ms {'to' if ms >= 0 else 'from'} its times"
    )
    # A tenth of a camera's frame at 30 per second: below it synchronisation is no longer the error that counts.
    weak = sigma > 3.3
    position, rotation = found.noise[LOOP_TRANSLATION], found.noise[LOOP_ROTATION]
    loop = (
        f"closes to {found.rms_mm:.3g} mm and {found.rms_deg:.3g} deg rms, to {found.at_zero_mm:.3g} mm without the "
        f"offset; noise {1e3 * position.sigma:.3g} mm and {np.rad2deg(rotation.sigma):.3g} deg per axis"
    )
    more = "; move faster, or record for longer, for a better one" if weak else ""
    checks = (
        Check("time-offset", "warn" if weak else "ok", words + more, found.offset),
        Check("loop", "ok", loop, found.rms_mm),
        Check(
            "correlation", "ok", f"angular speeds correlate by {found.correlation:.4f}; {int(found.used.sum())} of "
            f"{len(found.used)} camera samples lie within the robot's", found.correlation,
        ),
        Check("pose-reading", "ok", read),
    )  # fmt: skip
    return stamp(
        CalibrationResult(
            kind="time-offset",
            verdict=verdict_of(checks),
            checks=checks,
            transforms=(found.camera, found.target),
            options={"setup": setup},
            figures={"offset": Measured(found.offset, found.sigma, "s")},
            decided={"pose_reading": read},
            inputs=inputs,
        )
    )
