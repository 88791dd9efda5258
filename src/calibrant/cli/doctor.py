"""`calibrant doctor`: what is wrong with hand-eye data, and the data repaired."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from calibrant.cli import options as o
from calibrant.cli.robot_choice import RobotChoice


def doctor(
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
    apply: Annotated[
        bool,
        typer.Option("--apply", help="Repair the data in memory and calibrate: --out, --repaired-poses are new files."),
    ] = False,
    repaired_poses: Annotated[
        Path | None,
        typer.Option(
            "--repaired-poses", metavar="FILE.csv", show_default=False,
            help="With --apply: the repaired poses, T_base_gripper in metres.",
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
    """Find what is wrong with hand-eye data: how poses are written, pairing, flipped boards, size, motion.

    calibrant doctor --images photos/*.png --poses poses.csv --target chessboard:9x6:25mm

    Proposes a repair for each fault and shows how the loop closes before and after it. Nothing is changed: --apply
    calibrates from the repaired data and writes new files. Exit status 1 when a fault stands unrepaired.
    """
    from calibrant.cli import doctor_run, hand_eye_data, session

    outputs = session.Outputs(out, report, json, quiet, force)
    outputs.check()
    request = hand_eye_data.Request(
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
    )
    inputs = hand_eye_data.named_files(request)
    outputs.spare(inputs)
    repair = doctor_run.Repair(apply, repaired_poses)
    repair.check(outputs, inputs)
    doctor_run.run(request, outputs, repair)
