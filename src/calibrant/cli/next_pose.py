"""`calibrant next-pose`: which views to take next, or from the start, to know the camera best with the fewest."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from calibrant.cli import options as o


def next_pose(
    robot: Annotated[
        str,
        typer.Option(
            "--robot", metavar="FILE", show_default=False,
            help="The robot with its joint limits: URDF, DH table (YAML), or a name such as ur5e.",
        ),
    ],
    result: Annotated[
        Path | None,
        typer.Option(
            "--result", metavar="FILE", show_default=False,
            help="What was calibrated so far (hand-eye --out FILE); without it the plan starts from nothing.",
        ),
    ] = None,
    camera: Annotated[
        Path | None,
        typer.Option("--camera", metavar="FILE", help="Known camera, where there is no result.", show_default=False),
    ] = None,
    target: o.Target = None,
    setup: Annotated[str, typer.Option("--setup", metavar="SETUP", help="eye-in-hand or eye-to-hand.")] = "eye-in-hand",
    camera_at: Annotated[
        str | None,
        typer.Option(
            "--camera-at", metavar="PLACE", show_default=False,
            help="Roughly where the camera is: x, y, z, roll, pitch, yaw in the gripper (eye-in-hand) or the base.",
        ),
    ] = None,
    target_at: Annotated[
        str | None,
        typer.Option(
            "--target-at", metavar="PLACE", show_default=False,
            help="Roughly where the target is: in the base (eye-in-hand) or in the gripper (eye-to-hand).",
        ),
    ] = None,
    count: Annotated[
        int | None,
        typer.Option("--count", "-n", metavar="N", min=1, show_default=False, help="Poses: 1 after a result, else 10."),
    ] = None,
    wanted: Annotated[
        str, typer.Option("--wanted", metavar="WHAT", help="What is to be known well: point (seen) or camera.")
    ] = "point",
    at: Annotated[
        str | None,
        typer.Option(
            "--at", metavar="LENGTH", show_default=False,
            help="Distance from the camera at which its work lies; the middle of --distance unless given.",
        ),
    ] = None,
    workspace: Annotated[
        str | None,
        typer.Option(
            "--workspace", metavar="VOLUME", show_default=False,
            help="For a camera that stands still: where its work lies, 300mm:700mm,-200mm:200mm,0mm:100mm.",
        ),
    ] = None,
    distance: Annotated[
        str, typer.Option("--distance", metavar="FROM:TO", help="Distances at which the target is in focus.")
    ] = "300mm:800mm",
    tilt: Annotated[str, typer.Option("--tilt", metavar="ANGLE", help="Largest tilt of the target.")] = "40deg",
    in_view: Annotated[
        str, typer.Option("--in-view", metavar="PERCENT", help="Share of the target that must be in the image.")
    ] = "100%",
    geometry: Annotated[
        Path | None,
        typer.Option(
            "--geometry", metavar="FILE", show_default=False,
            help="What the arm must not hit (YAML: link_radius, floor, boxes, spheres).",
        ),
    ] = None,
    sigma_px: Annotated[
        str, typer.Option("--sigma-px", metavar="LENGTH", help="Noise of a corner, where there is no result.")
    ] = "0.2px",
    sigma_robot: Annotated[
        str, typer.Option("--sigma-robot", metavar="NOISE", help="Noise of its poses, where there is no result.")
    ] = "0.1mm,0.02deg",
    seed: Annotated[int, typer.Option("--seed", metavar="N", help="Of the candidates that are drawn.")] = 0,
    robot_link: o.RobotLink = None,
    robot_base: o.RobotBase = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="FILE.csv", help="Write poses and joint values here.", show_default=False),
    ] = None,
    json: o.Json = False,
    quiet: o.Quiet = False,
    force: o.Force = False,
    debug: o.Debug = False,
) -> None:  # fmt: skip
    """Say which poses to take so that the camera is known best with the fewest.

    calibrant next-pose --robot ur5e --result hand-eye.json

    calibrant next-pose --robot ur5e --camera camera.json --target chessboard:9x6:25mm --camera-at
    20mm,-60mm,50mm,0deg,0deg,23deg --target-at 620mm,110mm,20mm,180deg,0deg,0deg --count 8 --out plan.csv

    Every pose is within the joint limits, has the target in view and in focus, and hits nothing that --geometry names.
    Each comes with the uncertainty that is left after it. The flange is the gripper.
    """
    from calibrant.tasks.robots import next_pose as next_pose_run

    next_pose_run.run(
        next_pose_run.Request(
            robot=robot, link=robot_link, base=robot_base, result=result, camera=camera, target=target, setup=setup,
            camera_at=camera_at, target_at=target_at, count=count, wanted=wanted, at=at, workspace=workspace,
            distance=distance, tilt=tilt, in_view=in_view, geometry=geometry, sigma_px=sigma_px,
            sigma_robot=sigma_robot, seed=seed, out=out, json=json, quiet=quiet, force=force,
        )
    )  # fmt: skip
