"""What `calibrant kinematics` does: read, identify, show, write the corrected robot and commands."""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from calibrant.cli import session
from calibrant.errors import InputError

if TYPE_CHECKING:
    from calibrant.calibrate.kinematics.identify import KinematicCalibration
    from calibrant.calibrate.kinematics.model import Gravity
    from calibrant.data import CalibrationResult
    from calibrant.formats.robots.read import Robot

ROBOT_SUFFIXES = (".urdf", ".xml", ".yaml", ".yml")


@dataclass(frozen=True)
class Request:
    """The command's arguments, as given."""

    measurements: tuple[str, ...]
    robot: str | None = None
    link: str | None = None
    base: str | None = None
    identify: tuple[str, ...] = ("offsets", "geometry")
    hold: tuple[str, ...] = ()
    payload: str | None = None
    joint_angle: str = "auto"
    units: str = "auto"
    rotation: str = "auto"
    angle: str = "auto"
    maker: str | None = None
    exclude: tuple[str, ...] = ()
    corrected: Path | None = None
    commands: Path | None = None
    commands_out: Path | None = None
    force: bool = False
    quiet: bool = False


def run(request: Request, outputs: session.Outputs) -> None:
    """Run the whole command. Raises: InputError, RefusedError as the parts do."""
    from calibrant.formats.poses.measurements import read_measurements
    from calibrant.formats.robots.read import read_robot

    outputs.check()
    outputs.spare([*request.measurements, *([request.robot] if request.robot else [])])
    _check(request)
    robot = None if request.robot is None else read_robot(request.robot, link=request.link, base=request.base)
    measurements = read_measurements(
        list(request.measurements),
        robot=None if robot is None else robot.chain,
        units=request.units,
        rotation=request.rotation,
        angle=request.angle,
        joint_angle=request.joint_angle,
        maker=request.maker,
    )
    unknown = [name for name in request.exclude if name not in measurements.ids]
    if unknown:
        raise InputError(
            f"--exclude {unknown[0]}: no measurement of that name; there are {', '.join(measurements.ids[:6])} …"
        )
    kept = measurements.take([i for i, name in enumerate(measurements.ids) if name not in request.exclude])
    session.load_solver(quiet=request.quiet)

    from calibrant.calibrate.kinematics.identify import calibrate_kinematics

    with session.status("Identifying …", quiet=request.quiet):
        calibration = calibrate_kinematics(
            kept,
            None if robot is None else robot.chain,
            identify=request.identify,
            hold=request.hold,
            gravity=_gravity(request, robot),
        )
    result = _complete(calibration, request, measurements.source)
    session.finish(result, outputs)
    _write_robot(calibration, robot, request)
    _write_commands(calibration, request)
    further = [str(path) for path in (request.corrected, request.commands_out) if path is not None]
    if further and not request.quiet and not outputs.quiet:
        sys.stdout.write(f"Written: {', '.join(further)}\n")


def _check(request: Request) -> None:
    written = session.Outputs(request.corrected, request.commands_out, force=request.force)
    written.check()
    written.spare([*request.measurements, *([request.robot] if request.robot else [])])
    if request.corrected is not None and request.corrected.suffix.lower() not in ROBOT_SUFFIXES:
        raise InputError(f"--corrected {request.corrected}: expected a name ending in {', '.join(ROBOT_SUFFIXES)}")
    if (request.commands is None) != (request.commands_out is None):
        raise InputError("--commands and --commands-out belong together: what to correct, and where to write it")
    if request.commands is not None and request.robot is None:
        raise InputError("--commands are joint targets of a nominal robot: give it (--robot FILE)")
    if request.robot is None and (request.link or request.base):
        raise InputError("--robot-link and --robot-base choose a part of a robot: give it (--robot FILE)")


def _gravity(request: Request, robot: Robot | None) -> Gravity | None:
    from calibrant.calibrate.kinematics.model import Gravity
    from calibrant.robots.links import LinkChain

    mass = _kilograms(request.payload)
    if "elasticity" not in request.identify:
        if mass:
            raise InputError("--payload serves the elasticity of joints: add --identify elasticity")
        return None
    if robot is None:
        raise InputError("elasticity under gravity needs a nominal robot: --robot FILE")
    loads = robot.chain.loads if isinstance(robot.chain, LinkChain) else ()
    return Gravity(robot.chain, loads, mass) if loads or mass else None


def _kilograms(text: str | None) -> float:
    if text is None:
        return 0.0
    try:
        value = float(text.strip().removesuffix("kg"))
    except ValueError:
        value = -1.0
    if not text.strip().endswith("kg") or not 0 < value < 1e4:
        raise InputError(f"--payload takes a mass with its unit, such as 5kg; got {text!r}")
    return value


def _complete(calibration: KinematicCalibration, request: Request, source: str) -> CalibrationResult:
    from calibrant.calibrate.kinematics.result import as_result
    from calibrant.data.verdicts import stamp

    result = stamp(as_result(calibration))
    files = [*request.measurements, *([request.robot] if request.robot else [])]
    options = {
        **result.options,
        "robot": request.robot,
        "identify": list(request.identify),
        "hold": list(request.hold),
        "measurements": source,
    }
    return replace(
        result, inputs=session.file_records(files), options={k: v for k, v in options.items() if v is not None}
    )


def _write_robot(calibration: KinematicCalibration, robot: Robot | None, request: Request) -> None:
    if request.corrected is None:
        return
    from calibrant.calibrate.kinematics.identify import identified_robot
    from calibrant.data.result_file import write_text
    from calibrant.formats.robots.read import robot_text

    text = robot_text(robot, identified_robot(calibration), request.corrected.suffix)
    write_text(text, request.corrected, force=request.force)


def _write_commands(calibration: KinematicCalibration, request: Request) -> None:
    if request.commands is None or request.commands_out is None:
        return
    from calibrant.calibrate.kinematics.compensation import compensate_joints
    from calibrant.data.result_file import write_text
    from calibrant.formats.poses.joint_columns import joint_values, joints_of_robot, names_of
    from calibrant.formats.poses.read import read_table

    chain = calibration.nominal.chain
    table, _ = read_table(request.commands)
    q, _ = joint_values(table, joints_of_robot(table.header, chain), chain, angle=request.joint_angle)
    done = compensate_joints(calibration.model, calibration.nominal, q)
    names = names_of(table) or tuple(str(i) for i in range(len(q)))
    header = ",".join(
        ["name", *(f"{j.name}[{'rad' if j.kind == 'revolute' else 'm'}]" for j in chain.joints), "off_mm"]
    )
    lines = [
        ",".join([name, *(f"{v:.9f}" for v in row), f"{off:.4f}"])
        for name, row, off in zip(names, done.joints.tolist(), done.off_mm.tolist())
    ]
    write_text("\n".join([header, *lines]) + "\n", request.commands_out, force=request.force)
