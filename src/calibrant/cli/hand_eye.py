"""`calibrant hand-eye`: where the camera is, from photos and robot poses."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from calibrant.cli import options as o
from calibrant.cli import pose_options as p
from calibrant.tasks.inputs.robot_choice import RobotChoice


def hand_eye(
    poses: p.PosesOfRobots,
    images: p.ImagesOfCameras = None,
    target: Annotated[
        list[str] | None,
        typer.Option(
            "--target", "-t", metavar="SPEC", show_default=False,
            help="The board: chessboard:9x6:25mm (inner corners), charuco:5x7:36mm:18mm:DICT_6X6_250 (squares), or a "
            "file; of one of several cameras: NAME=SPEC.",
        ),
    ] = None,
    observations: o.ObservationsFile = None,
    target_poses: p.TargetPoses = None,
    target_pose_rotation: p.TargetPoseRotation = "auto",
    camera: p.KnownCameras = None,
    setup: p.SetupOfCameras = None,
    pose_units: p.Units = "auto",
    pose_rotation: p.Rotation = "auto",
    pose_angle: p.Angle = "auto",
    pose_direction: p.Direction = "auto",
    robot_format: o.RobotFormat = None,
    robot: o.Robot = None,
    robot_link: o.RobotLink = None,
    robot_base: o.RobotBase = None,
    joint_angle: o.JointAngle = "auto",
    identify: Annotated[
        list[str] | None,
        typer.Option(
            "--identify", metavar="GROUPS", show_default=False,
            help="With --robot and joint values: find the robot's own errors too: offsets, gear, coupling, geometry.",
        ),
    ] = None,
    method: Annotated[
        str,
        typer.Option(
            "--method",
            help="joint (weighs pixels and robot, states its uncertainty), or a closed form: tsai, park, horaud, …",
        ),
    ] = "joint",
    workspace: p.Workspace = None,
    tolerance: p.Tolerance = None,
    target_sigma: p.TargetSigma = None,
    model: o.Model = "brown",
    fix: o.Fix = None,
    mirror_x: o.MirrorX = False,
    exclude: o.Exclude = None,
    refine: o.Refine = "saddle",
    window: o.Window = None,
    zero_zone: o.ZeroZone = None,
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

    Several cameras: --images left=photos/left --images right=photos/right. Several robots: --poses a=a.csv --poses
    b=b.csv --images top@a=photos/a --images top@b=photos/b.
    """
    from calibrant.cli import session
    from calibrant.tasks.robots import hand_eye as hand_eye_run
    from calibrant.tasks.robots import hand_eye_cell as hand_eye_several

    outputs = session.Outputs(out, report, json, quiet, force)
    outputs.check()
    asked = (refine, window, zero_zone)  # detection is loaded for photos alone
    request = hand_eye_run.Request(
        poses=tuple(poses),
        images=tuple(images or ()),
        target=next((t for t in reversed(target or ()) if not hand_eye_several.named([t], "--target").named), None),
        observations=observations,
        target_poses=tuple(target_poses or ()),
        target_rotation=target_pose_rotation,
        camera=Path(camera[-1]) if camera else None,
        setup=setup[-1] if setup else "auto",
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
        refinement=o.refinement(refine, window, zero_zone) if images or asked != ("saddle", None, None) else None,
        arm=RobotChoice(robot, robot_link, robot_base, joint_angle, robot_format),
        method=method,
        workspace=workspace,
        tolerance=tolerance,
        target_sigma=target_sigma,
    )
    several = hand_eye_several.several_request(
        request,
        images=images or (),
        poses=poses,
        cameras=camera or (),
        setups=setup or (),
        targets=target or (),
        identify=o.split_names(identify),
    )
    if several is not None:
        outputs.spare(hand_eye_several.named_files(several))
        with session.explain_refusal(outputs):
            session.finish(hand_eye_several.calibrate(several), outputs)
        return
    outputs.spare(hand_eye_run.named_files(request))
    with session.explain_refusal(outputs):
        session.finish(hand_eye_run.calibrate(request), outputs)
