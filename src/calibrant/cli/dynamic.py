"""`calibrant dynamic`: a camera beside the robot, located through the calibrated wrist camera and a target both see."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from calibrant.cli import options as o
from calibrant.cli import pose_options as p


def dynamic(
    wrist: Annotated[
        Path,
        typer.Option("--wrist", metavar="FILE", help="The wrist camera's hand-eye result.", show_default=False),
    ],
    camera: Annotated[
        Path,
        typer.Option("--camera", metavar="FILE", help="The external camera (any format).", show_default=False),
    ],
    wrist_images: Annotated[
        list[str],
        typer.Option("--wrist-images", metavar="IMAGES", help="Photos by the wrist camera.", show_default=False),
    ],
    external_images: Annotated[
        list[str],
        typer.Option("--external-images", metavar="IMAGES", help="Photos by the external one.", show_default=False),
    ],
    poses: Annotated[
        list[str],
        typer.Option("--poses", metavar="FILES", help="Robot poses of the wrist's photos.", show_default=False),
    ],
    target: o.Target = None,
    target_stands: Annotated[
        str,
        typer.Option(
            "--target-stands", metavar="HOW",
            help="still: in one place for all photos; moves: the n-th photos of both show its n-th place.",
        ),
    ] = "still",
    sigma_px: Annotated[
        str | None,
        typer.Option(
            "--sigma-px", metavar="LENGTH", show_default=False,
            help="Noise of the external camera's corners; that of the wrist camera unless given.",
        ),
    ] = None,
    robot: o.Robot = None,
    robot_link: o.RobotLink = None,
    robot_base: o.RobotBase = None,
    joint_angle: o.JointAngle = "auto",
    robot_format: o.RobotFormat = None,
    pose_units: p.Units = "auto",
    pose_rotation: p.Rotation = "auto",
    pose_angle: p.Angle = "auto",
    pose_direction: p.Direction = "auto",
    out: o.Out = None,
    json: o.Json = False,
    quiet: o.Quiet = False,
    force: o.Force = False,
    debug: o.Debug = False,
) -> None:  # fmt: skip
    """Locate a camera beside the robot through the wrist camera and a target that both see.

    calibrant dynamic --wrist hand-eye.json --camera front.json --wrist-images wrist/*.png --external-images front/*.png
    --poses poses.csv --target charuco:5x7:36mm:18mm:DICT_6X6_250

    Says how certain the place is, and which source it owes that to: the wrist's calibration, either camera's pixels,
    the external intrinsics, or the robot.
    """
    from calibrant.cli import session
    from calibrant.tasks.inputs.pose_choice import PoseForm
    from calibrant.tasks.inputs.robot_choice import RobotChoice
    from calibrant.tasks.robots import dynamic as dynamic_run

    outputs = session.Outputs(out, None, json, quiet, force)
    outputs.check()
    outputs.spare([wrist, camera, *poses, *wrist_images, *external_images])
    request = dynamic_run.Request(
        wrist, camera, tuple(wrist_images), tuple(external_images), tuple(poses), target, target_stands,
        o.pixels(sigma_px, option="--sigma-px"), PoseForm(pose_units, pose_rotation, pose_angle, pose_direction),
        RobotChoice(robot, robot_link, robot_base, joint_angle, robot_format), quiet or json,
    )  # fmt: skip
    session.finish(dynamic_run.calibrate(request), outputs)
