"""Identify a robot's geometry from joint values and measured poses; the corrected robot and joint targets."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from calibrant.errors import InputError
from calibrant.tasks.inputs import session
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.option import Option
from calibrant.tasks.options.poses import NotationOptions
from calibrant.tasks.options.robots import RobotOptions
from calibrant.tasks.options.words import split_names
from calibrant.tasks.outcome import Document, Outcome, result_document

if TYPE_CHECKING:
    from collections.abc import Iterator

    from calibrant.calibrate.kinematics.identify import KinematicCalibration
    from calibrant.calibrate.kinematics.model import Gravity
    from calibrant.data import CalibrationResult
    from calibrant.data.joint_measurements import JointMeasurements
    from calibrant.formats.robots.read import Robot

EXAMPLE = 'cb.kinematics(robot="arm.urdf", measurements="tracker.csv", corrected="arm-corrected.urdf")'
ROBOT_SUFFIXES = (".urdf", ".xml", ".yaml", ".yml")
IDENTIFIED = ("offsets", "geometry")
"""What is identified unless it is said."""


@dataclass(frozen=True, kw_only=True)
class Request:
    """Identify a robot's geometry from joint values and measured poses, and correct it.

    calibrant kinematics --robot arm.urdf --measurements tracker.csv --corrected arm-corrected.urdf --out result.json

    Finds which parameters the measurements determine, estimates them with the noise, checks the result on measurements
    kept out, and writes the corrected robot and corrected joint targets. An --out that ends in .urdf or .yaml is the
    corrected robot.
    """

    measurements: Annotated[tuple[str, ...], Option("FILE", "-m")]
    """Joint values with the measured pose or position of the tool beside them."""
    arm: RobotOptions = RobotOptions()
    identify: Annotated[tuple[str, ...], Option("GROUPS")] = ()
    """offsets, geometry, gear, coupling, elasticity; the first two by default."""
    hold: Annotated[tuple[str, ...], Option("FRAMES")] = ()
    """What is known: base (measured in the robot's base), tool (the flange itself was measured)."""
    payload: Annotated[str | None, Option("MASS")] = None
    """At the flange, e.g. 5kg."""
    form: NotationOptions = NotationOptions()
    exclude: Annotated[tuple[str, ...], Option("NAMES")] = ()
    """Measurements to leave out, by name."""
    corrected: Annotated[Path | None, Option("FILE", output="file")] = None
    """Write the corrected robot here (.urdf, .yaml)."""
    commands: Annotated[Path | None, Option("FILE")] = None
    """Joint targets of the nominal robot, to be corrected."""
    commands_out: Annotated[Path | None, Option("FILE.csv", output="file")] = None
    """Write the corrected joint targets here."""
    out: Annotated[Path | None, Option("FILE", "-o", output="file")] = None
    """Write the result file (JSON) here; a name in .urdf or .yaml: the corrected robot."""


def reads(request: Request) -> list[str | Path]:
    """The measurements, the robot's file, and the joint targets."""
    targets = [] if request.commands is None else [request.commands]
    return [*request.measurements, *request.arm.files, *targets]


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """The robot's geometry. Raises: InputError; RefusedError as `calibrate_kinematics`, or with the failed result."""
    from calibrant.data.verdicts import refuse_if_failed
    from calibrant.formats.robots.read import read_robot

    _check(request)
    arm = request.arm
    robot = None if arm.robot is None else read_robot(arm.robot, link=arm.robot_link, base=arm.robot_base)
    kept = _kept_measurements(request, robot)
    session.load_solver(listener)

    from calibrant.calibrate.kinematics.identify import calibrate_kinematics

    with listener.status("Identifying …"):
        calibration = calibrate_kinematics(
            kept,
            None if robot is None else robot.chain,
            identify=_identified(request),
            hold=split_names(request.hold),
            gravity=_gravity(request, robot),
        )
    result = _kinematics_result(calibration, request, kept.source)
    refuse_if_failed(result)
    return Outcome(result=result, documents=_documents(result, calibration, robot, request))


def _identified(request: Request) -> tuple[str, ...]:
    return split_names(request.identify) or IDENTIFIED


def _kept_measurements(request: Request, robot: Robot | None) -> JointMeasurements:
    """The measurements without those excluded. Raises: InputError for a name that is not there."""
    from calibrant.formats.measurements.read import read_measurements

    found = read_measurements(
        list(request.measurements),
        robot=None if robot is None else robot.chain,
        units=request.form.pose_units,
        rotation=request.form.pose_rotation,
        angle=request.form.pose_angle,
        joint_angle=request.arm.joint_angle,
        maker=request.arm.robot_format,
    )
    exclude = split_names(request.exclude)
    unknown = [name for name in exclude if name not in found.ids]
    if unknown:
        raise InputError(f"--exclude {unknown[0]}: no measurement of that name; there are {', '.join(found.ids[:6])} …")
    return found.take([i for i, name in enumerate(found.ids) if name not in exclude])


def _check(request: Request) -> None:
    """Raises: InputError for options that contradict each other."""
    if request.corrected is not None and request.corrected.suffix.lower() not in ROBOT_SUFFIXES:
        raise InputError(f"--corrected {request.corrected}: expected a name ending in {', '.join(ROBOT_SUFFIXES)}")
    if (request.commands is None) != (request.commands_out is None):
        raise InputError("--commands and --commands-out belong together: what to correct, and where to write it")
    if request.commands is not None and request.arm.robot is None:
        raise InputError("--commands are joint targets of a nominal robot: give it (--robot FILE)")
    if request.arm.robot is None and (request.arm.robot_link or request.arm.robot_base):
        raise InputError("--robot-link and --robot-base choose a part of a robot: give it (--robot FILE)")


def _gravity(request: Request, robot: Robot | None) -> Gravity | None:
    from calibrant.calibrate.kinematics.model import Gravity
    from calibrant.robots.links import LinkChain

    mass = _kilograms(request.payload)
    if "elasticity" not in _identified(request):
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


def _kinematics_result(calibration: KinematicCalibration, request: Request, source: str) -> CalibrationResult:
    from calibrant.calibrate.kinematics.result import as_result
    from calibrant.data.verdicts import stamp

    asked = {
        "robot": request.arm.robot,
        "identify": list(_identified(request)),
        "hold": list(split_names(request.hold)),
        "payload": request.payload,
    }
    result = stamp(as_result(calibration))
    return replace(
        result,
        inputs=session.file_records(reads(request)),
        options={**result.options, **{name: value for name, value in asked.items() if value is not None}},
        decided={**result.decided, "measurements": source},
    )


def _documents(
    result: CalibrationResult, calibration: KinematicCalibration, robot: Robot | None, request: Request
) -> Iterator[Document]:
    """The result, the corrected robot, the corrected joint targets: what was asked for by name."""
    out, corrected = request.out, request.corrected
    if out is not None and corrected is None and out.suffix.lower() in ROBOT_SUFFIXES:
        out, corrected = None, out
    if out is not None:
        yield result_document(result, out)
    if corrected is not None:
        yield Document(corrected, partial(_robot_text, calibration, robot, corrected.suffix))
    if request.commands is not None and request.commands_out is not None:
        yield Document(request.commands_out, partial(_corrected_targets, calibration, request.commands, request.arm))


def _robot_text(calibration: KinematicCalibration, robot: Robot | None, suffix: str) -> bytes:
    from calibrant.calibrate.kinematics.identify import identified_robot
    from calibrant.formats.robots.read import robot_text

    return robot_text(robot, identified_robot(calibration), suffix).encode()


def _corrected_targets(calibration: KinematicCalibration, commands: Path, arm: RobotOptions) -> bytes:
    """Joint targets with which the robot as it is reaches what the nominal one would, a line each, and the rest, mm."""
    from calibrant.calibrate.kinematics.compensation import compensate_joints
    from calibrant.formats.poses.joint_columns import joint_values, joints_of_robot, names_of
    from calibrant.formats.poses.read import read_table

    chain = calibration.nominal.chain
    table, _ = read_table(commands)
    try:
        q, _ = joint_values(table, joints_of_robot(table.header, chain), chain, angle=arm.joint_angle)
    except InputError as error:
        raise InputError(f"{commands}: {error}" if str(commands) not in str(error) else str(error)) from error
    done = compensate_joints(calibration.model, calibration.nominal, q)
    names = names_of(table) or tuple(str(i) for i in range(len(q)))
    header = ",".join(
        ["name", *(f"{j.name}[{'rad' if j.kind == 'revolute' else 'm'}]" for j in chain.joints), "off_mm"]
    )
    lines = [
        ",".join([name, *(f"{v:.9f}" for v in row), f"{off:.4f}"])
        for name, row, off in zip(names, done.joints.tolist(), done.off_mm.tolist())
    ]
    return ("\n".join([header, *lines]) + "\n").encode()
