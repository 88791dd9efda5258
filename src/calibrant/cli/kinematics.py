"""`calibrant kinematics`: a robot's own geometry from joint values and measured poses."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from calibrant.cli import options as o
from calibrant.cli import pose_options as p


def kinematics(
    measurements: Annotated[
        list[str],
        typer.Option(
            "--measurements", "-m", metavar="FILE", show_default=False,
            help="Joint values with the measured pose or position of the tool beside them.",
        ),
    ],
    robot: o.Robot = None,
    robot_link: o.RobotLink = None,
    robot_base: o.RobotBase = None,
    identify: Annotated[
        list[str] | None,
        typer.Option(
            "--identify", metavar="GROUPS", show_default=False,
            help="offsets, geometry, gear, coupling, elasticity; the first two by default.",
        ),
    ] = None,
    hold: Annotated[
        list[str] | None,
        typer.Option(
            "--hold", metavar="FRAMES", show_default=False,
            help="What is known: base (measured in the robot's base), tool (the flange itself was measured).",
        ),
    ] = None,
    payload: Annotated[
        str | None, typer.Option("--payload", metavar="MASS", help="At the flange, e.g. 5kg.", show_default=False)
    ] = None,
    joint_angle: o.JointAngle = "auto",
    pose_units: p.Units = "auto",
    pose_rotation: p.Rotation = "auto",
    pose_angle: p.Angle = "auto",
    robot_format: o.RobotFormat = None,
    exclude: Annotated[
        list[str] | None,
        typer.Option("--exclude", metavar="NAMES", help="Measurements to leave out, by name.", show_default=False),
    ] = None,
    corrected: Annotated[
        Path | None,
        typer.Option(
            "--corrected", metavar="FILE", help="Write the corrected robot here (.urdf, .yaml).", show_default=False
        ),
    ] = None,
    commands: Annotated[
        Path | None,
        typer.Option(
            "--commands", metavar="FILE", show_default=False,
            help="Joint targets of the nominal robot, to be corrected.",
        ),
    ] = None,
    commands_out: Annotated[
        Path | None,
        typer.Option(
            "--commands-out", metavar="FILE.csv", help="Write the corrected joint targets here.", show_default=False
        ),
    ] = None,
    out: o.Out = None,
    report: o.Report = None,
    json: o.Json = False,
    quiet: o.Quiet = False,
    force: o.Force = False,
    debug: o.Debug = False,
) -> None:  # fmt: skip
    """Identify a robot's geometry from joint values and measured poses, and correct it.

    calibrant kinematics --robot arm.urdf --measurements tracker.csv --corrected arm-corrected.urdf --out result.json

    Finds which parameters the measurements determine, estimates them with the noise, checks the result on measurements
    kept out, and writes the corrected robot and corrected joint targets. An --out that ends in .urdf or .yaml is the
    corrected robot.
    """
    from calibrant.cli import session
    from calibrant.tasks.robots import kinematics as kinematics_run

    if out is not None and corrected is None and out.suffix.lower() in kinematics_run.ROBOT_SUFFIXES:
        out, corrected = None, out
    outputs = session.Outputs(out, report, json, quiet, force)
    request = kinematics_run.Request(
        measurements=tuple(measurements),
        robot=robot,
        link=robot_link,
        base=robot_base,
        identify=o.split_names(identify) or ("offsets", "geometry"),
        hold=o.split_names(hold),
        payload=payload,
        joint_angle=joint_angle,
        units=pose_units,
        rotation=pose_rotation,
        angle=pose_angle,
        maker=robot_format,
        exclude=o.split_names(exclude),
        corrected=corrected,
        commands=commands,
        commands_out=commands_out,
        force=force,
        quiet=quiet or json,
    )
    kinematics_run.run(request, outputs)
