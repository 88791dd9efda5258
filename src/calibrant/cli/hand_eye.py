"""`calibrant hand-eye`: where the camera is, from photos and robot poses."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from calibrant.cli import options as o
from calibrant.cli.robot_choice import RobotChoice


def hand_eye(
    poses: Annotated[
        list[str],
        typer.Option("--poses", metavar="FILES", help="File of robot poses, or one file a pose.", show_default=False),
    ],
    images: Annotated[
        list[str] | None,
        typer.Option("--images", "-i", metavar="IMAGES", help="Photos, folders or patterns.", show_default=False),
    ] = None,
    target: o.Target = None,
    observations: o.ObservationsFile = None,
    target_poses: Annotated[
        list[str] | None,
        typer.Option(
            "--target-poses", metavar="FILES", show_default=False,
            help="Poses of the target in the camera, instead of photos.",
        ),
    ] = None,
    camera: Annotated[
        Path | None,
        typer.Option(
            "--camera", metavar="FILE", show_default=False,
            help="Known camera (any format); without it the photos calibrate it.",
        ),
    ] = None,
    setup: Annotated[str, typer.Option("--setup", metavar="SETUP", help="auto, eye-in-hand or eye-to-hand.")] = "auto",
    pose_units: Annotated[str, typer.Option("--pose-units", metavar="UNIT", help="auto, mm or m.")] = "auto",
    pose_rotation: Annotated[
        str,
        typer.Option(
            "--pose-rotation", metavar="FORM",
            help="auto, quat-xyzw, quat-wxyz, rotvec, euler:ZYX, euler:xyz …, matrix.",
        ),
    ] = "auto",
    pose_angle: Annotated[str, typer.Option("--pose-angle", metavar="UNIT", help="auto, deg or rad.")] = "auto",
    pose_direction: Annotated[
        str, typer.Option("--pose-direction", metavar="NAME", help="auto, base-gripper or gripper-base.")
    ] = "auto",
    robot_format: o.RobotFormat = None,
    robot: o.Robot = None,
    robot_link: o.RobotLink = None,
    robot_base: o.RobotBase = None,
    joint_angle: o.JointAngle = "auto",
    workspace: Annotated[
        str | None,
        typer.Option(
            "--workspace", metavar="VOLUME", show_default=False,
            help="Say the accuracy in this volume of the base: 300mm:700mm,-200mm:200mm,0mm:100mm (x, y, z).",
        ),
    ] = None,
    tolerance: Annotated[
        str | None,
        typer.Option(
            "--tolerance", metavar="LENGTH", show_default=False,
            help="Fail unless 95 % of the errors in the workspace stay below this, e.g. 1mm.",
        ),
    ] = None,
    target_sigma: Annotated[
        str | None,
        typer.Option(
            "--target-sigma", metavar="PERCENT", show_default=False,
            help="How well the board's size is known (1 sigma), for the workspace; 0.05% unless given.",
        ),
    ] = None,
    model: o.Model = "brown",
    fix: o.Fix = None,
    mirror_x: o.MirrorX = False,
    exclude: o.Exclude = None,
    workers: o.Workers = None,
    cache: o.Cache = None,
    out: o.Out = None,
    report: o.Report = None,
    json: o.Json = False,
    quiet: o.Quiet = False,
    force: o.Force = False,
    debug: o.Debug = False,
) -> None:  # fmt: skip
    """Find where the camera is: on the gripper or beside the robot.

    calibrant hand-eye --images photos/*.png --poses poses.csv --target chessboard:9x6:25mm --out result.json

    Reads the poses as they are written (units, rotation, direction are found from the data and said), calibrates
    camera, robot and target in one problem, and refuses what the motions cannot determine.
    """
    from calibrant.cli import hand_eye_run, session

    outputs = session.Outputs(out, report, json, quiet, force)
    outputs.check()
    request = hand_eye_run.Request(
        poses=tuple(poses),
        images=tuple(images or ()),
        target=target,
        observations=observations,
        target_poses=tuple(target_poses or ()),
        camera=camera,
        setup=setup,
        units=pose_units,
        rotation=pose_rotation,
        angle=pose_angle,
        direction=pose_direction,
        model=model,
        fix=o.split_names(fix),
        mirror_x=mirror_x,
        exclude=o.split_names(exclude),
        workers=workers,
        cache=cache,
        quiet=quiet or json,
        arm=RobotChoice(robot, robot_link, robot_base, joint_angle, robot_format),
        workspace=workspace,
        tolerance=tolerance,
        target_sigma=target_sigma,
    )
    outputs.spare(hand_eye_run.named_files(request))
    with session.explain_refusal(outputs):
        session.finish(hand_eye_run.calibrate(request), outputs)
