"""`calibrant doctor`: what is wrong with hand-eye data, and the data repaired."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from calibrant.cli import options as o
from calibrant.cli import pose_options as p
from calibrant.tasks.inputs.robot_choice import RobotChoice


def doctor(
    poses: p.Poses,
    images: p.Images = None,
    target: o.Target = None,
    observations: o.ObservationsFile = None,
    target_poses: p.TargetPoses = None,
    target_pose_rotation: p.TargetPoseRotation = "auto",
    camera: p.KnownCamera = None,
    setup: p.Setup = "auto",
    pose_units: p.Units = "auto",
    pose_rotation: p.Rotation = "auto",
    pose_angle: p.Angle = "auto",
    pose_direction: p.Direction = "auto",
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
    from calibrant.cli import session
    from calibrant.tasks.robots import doctor as doctor_run
    from calibrant.tasks.robots import hand_eye_data

    outputs = session.Outputs(out, report, json, quiet, force)
    outputs.check()
    request = hand_eye_data.Request(
        poses=tuple(poses),
        images=tuple(images or ()),
        target=target,
        observations=observations,
        target_poses=tuple(target_poses or ()),
        target_rotation=target_pose_rotation,
        camera=None if camera is None else Path(camera),
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
