"""Find the offset between the clocks of camera and robot, from one motion that both recorded."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from calibrant.errors import InputError
from calibrant.tasks.inputs import session
from calibrant.tasks.inputs.bags.topics import bag_files, cameras_of_bag, recorded_pictures
from calibrant.tasks.inputs.sources import Source
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.bags import MovingBagOptions
from calibrant.tasks.options.cameras import LensOptions
from calibrant.tasks.options.choices import SETUPS
from calibrant.tasks.options.images import SearchOptions
from calibrant.tasks.options.option import Option
from calibrant.tasks.options.robots import RobotOptions
from calibrant.tasks.options.words import split_names
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

    Both files have a column of times; or a recording of ROS has both, the pictures of a board and the robot's poses:
    --bag run.mcap --image-topic /camera/image_raw --tf base_link:tool0 --target chessboard:9x6:25mm.

    Correlates the angular speeds, then refines the offset together with the camera's place, and says its sigma:
    t_robot = t_camera + offset.
    """

    poses: Annotated[Path | None, Option("FILE")] = None
    """Robot poses or joints with times."""
    target_poses: Annotated[Path | None, Option("FILE")] = None
    """Poses of the target in the camera with times."""
    recording: MovingBagOptions = MovingBagOptions()
    target: Annotated[str | None, Option("SPEC", "-t")] = None
    """With --bag: the board in its pictures, chessboard:9x6:25mm, charuco:5x7:36mm:18mm:DICT_6X6_250, or a file."""
    camera: Annotated[Path | None, Option("FILE")] = None
    """With --bag: the known camera (any format, or a camera_info topic); without it the pictures calibrate it."""
    setup: Annotated[str, Option("SETUP", choices=SETUPS[1:])] = "eye-in-hand"
    """eye-in-hand or eye-to-hand."""
    largest: Annotated[str, Option("TIME")] = "2s"
    """The offset is searched to either side, e.g. 2s or 500ms."""
    arm: RobotOptions = RobotOptions()
    lens: LensOptions = LensOptions()
    search: SearchOptions = SearchOptions()


def reads(request: Request) -> list[Path | str]:
    """Both recordings, or the bag and its camera, and the robot's file."""
    bag = [] if request.recording.bag is None else bag_files(request.recording.bag)
    given = (request.poses, request.target_poses, request.camera)
    return [*(f for f in given if f is not None), *bag, *request.arm.files]


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """The offset with its sigma, and the camera's place. Raises: InputError; RefusedError as `estimate_time_offset`."""
    from calibrant.data.verdicts import refuse_if_failed

    reach = _seconds(request.largest)
    request.recording.check()
    if request.recording.bag is not None:
        result = _of_bag(request, request.recording.bag, reach, listener)
    else:
        result = _of_files(request, reach, listener)
    refuse_if_failed(result)
    return Outcome(result=result)


def _of_files(request: Request, reach: float, listener: Listener) -> CalibrationResult:
    """From two files of poses with times. Raises: InputError where one of them is missing."""
    from calibrant.calibrate.clocks.offset import estimate_time_offset
    from calibrant.formats.poses.timed import read_timed_poses

    for option, value in (("--target", request.target), ("--camera", request.camera)):
        if value is not None:
            raise InputError(f"{option} goes with the pictures of a bag: give it (--bag FILE)")
    if request.poses is None or request.target_poses is None:
        missing = "--poses" if request.poses is None else "--target-poses"
        raise InputError(f"{missing} is missing: give --poses FILE and --target-poses FILE, or a recording, --bag FILE")
    arm = request.arm
    moved = read_timed_poses(request.poses, robot=arm.chain(), joint_angle=arm.joint_angle, maker=arm.robot_format)
    seen = read_timed_poses(request.target_poses)
    session.load_solver(listener)
    with listener.status("Aligning …"):
        # Times since 1970 lose no digits when counted from the start of the recording.
        origin = min(moved.times[0], seen.times[0])
        found = estimate_time_offset(
            moved.times - origin, moved.T, seen.times - origin, seen.T, setup=request.setup, largest=reach
        )
    return _time_offset_result(found, request, f"robot: {moved.description}; camera: {seen.description}")


def _of_bag(request: Request, bag: Path, reach: float, listener: Listener) -> CalibrationResult:
    """From a bag's pictures of a board and the robot's motion in it."""
    from calibrant.formats.cameras.read import read_camera
    from calibrant.tasks.inputs.bags.clocks import clock_offset, seen_motion, thinned
    from calibrant.tasks.inputs.bags.motion import robot_motion

    for option, value in (("--poses", request.poses), ("--target-poses", request.target_poses)):
        if value is not None:
            raise InputError(f"{option}: the bag has both motions; give --bag FILE or {option}, not both")
    with listener.status("Reading the bag …"):
        every = recorded_pictures(request.recording)
        if len(every) > 1:
            raise InputError("time-offset is about one camera's clock: give one --image-topic")
        recorded = thinned(next(iter(every.values())))
        robot = robot_motion(request.recording, request.arm)
    source = Source(
        images=tuple(map(str, recorded.files)), target=request.target, search=request.search, listener=listener
    )
    found = source.read(source.files())
    session.load_solver(listener)
    size = next(iter(found.image_sizes.values()))
    (place,) = cameras_of_bag(bag, () if request.camera is None else (str(request.camera),)) or (None,)
    camera = None if place is None else read_camera(place, image_size=size)
    with listener.status("Aligning …"):
        seen = seen_motion(found, recorded, camera, request.lens.model, split_names(request.lens.fix))
        offset, _ = clock_offset(robot, seen, setup=request.setup, largest=reach)
    words = f"robot: {robot.words}; camera: {len(seen.times)} of {len(recorded.files)} pictures of {recorded.topic}"
    return _time_offset_result(offset, request, words)


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
