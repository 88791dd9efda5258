"""Options that commands with robot poses share: what the data are, and where the accuracy is asked for."""

from __future__ import annotations

from typing import Annotated

import typer

Poses = Annotated[
    list[str],
    typer.Option("--poses", metavar="FILES", help="File of robot poses, or one file a pose.", show_default=False),
]
PosesOfRobots = Annotated[
    list[str],
    typer.Option(
        "--poses", metavar="FILES", show_default=False,
        help="File of robot poses, or one file a pose; of several robots: NAME=FILE for each.",
    ),
]  # fmt: skip
Images = Annotated[
    list[str] | None,
    typer.Option("--images", "-i", metavar="IMAGES", help="Photos, folders or patterns.", show_default=False),
]
ImagesOfCameras = Annotated[
    list[str] | None,
    typer.Option(
        "--images", "-i", metavar="IMAGES", show_default=False,
        help="Photos, folders or patterns; of several cameras: NAME=IMAGES for each, NAME@ROBOT=IMAGES with several "
        "robots.",
    ),
]  # fmt: skip
TargetPoses = Annotated[
    list[str] | None,
    typer.Option(
        "--target-poses", metavar="FILES", show_default=False,
        help="Poses of the target in the camera, instead of photos.",
    ),
]  # fmt: skip
KnownCamera = Annotated[
    str | None,
    typer.Option(
        "--camera", metavar="FILE", show_default=False,
        help="Known camera (any format); without it the photos calibrate it.",
    ),
]  # fmt: skip
KnownCameras = Annotated[
    list[str] | None,
    typer.Option(
        "--camera", metavar="FILE", show_default=False,
        help="Known camera (any format), of several NAME=FILE; without it the photos calibrate it.",
    ),
]  # fmt: skip
Setup = Annotated[str, typer.Option("--setup", metavar="SETUP", help="auto, eye-in-hand or eye-to-hand.")]
SetupOfCameras = Annotated[
    list[str] | None,
    typer.Option(
        "--setup", metavar="SETUP", show_default=False,
        help="auto (the default), eye-in-hand or eye-to-hand; of one of several cameras: NAME=SETUP, or NAME=standing "
        "for a camera and a board that both stand beside the robot.",
    ),
]  # fmt: skip
Units = Annotated[str, typer.Option("--pose-units", metavar="UNIT", help="Unit of positions: auto, m, mm, cm or in.")]
Rotation = Annotated[
    str,
    typer.Option(
        "--pose-rotation", metavar="FORM", help="auto, quat-xyzw, quat-wxyz, rotvec, euler:ZYX, euler:xyz …, matrix."
    ),
]
TargetPoseRotation = Annotated[
    str,
    typer.Option(
        "--target-pose-rotation", metavar="FORM", help="The same of --target-poses, where the data cannot tell."
    ),
]
Angle = Annotated[str, typer.Option("--pose-angle", metavar="UNIT", help="auto, deg or rad.")]
Direction = Annotated[str, typer.Option("--pose-direction", metavar="NAME", help="auto, base-gripper or gripper-base.")]
Workspace = Annotated[
    str | None,
    typer.Option(
        "--workspace", metavar="VOLUME", show_default=False,
        help="Say the accuracy in this volume of the base: 300mm:700mm,-200mm:200mm,0mm:100mm (x, y, z).",
    ),
]  # fmt: skip
Tolerance = Annotated[
    str | None,
    typer.Option(
        "--tolerance", metavar="LENGTH", show_default=False,
        help="Fail unless 95 % of the errors in the workspace stay below this, e.g. 1mm.",
    ),
]  # fmt: skip
TargetSigma = Annotated[
    str | None,
    typer.Option(
        "--target-sigma", metavar="PERCENT", show_default=False,
        help="How well the board's size is known (1 sigma), for the workspace; 0.05% unless given.",
    ),
]  # fmt: skip
