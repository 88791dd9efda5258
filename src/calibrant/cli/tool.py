"""`calibrant tool`: where the tool's tip is on the flange, and a hand camera from the gripper that it sees."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from calibrant.cli import options as o
from calibrant.cli import pose_options as p
from calibrant.cli.session import Outputs

app = typer.Typer(
    help="Find a tool's tip, by touch or by sight, or a hand camera from the gripper it sees.", no_args_is_help=True
)


def _outputs(
    out: o.Out = None, json: o.Json = False, quiet: o.Quiet = False, force: o.Force = False, debug: o.Debug = False
) -> Outputs:
    """The outputs of every subcommand; `debug` is the application's own."""
    outputs = Outputs(out, None, json, quiet, force)
    outputs.check()
    return outputs


def with_outputs(run: Callable[..., None]) -> Callable[..., None]:
    """The command with the options of `_outputs` behind its own; `run` takes what they make as `outputs`."""
    own = [p for p in inspect.signature(run, eval_str=True).parameters.values() if p.name != "outputs"]
    shared = list(inspect.signature(_outputs, eval_str=True).parameters.values())

    @functools.wraps(run)
    def command(**given: Any) -> None:
        outputs = _outputs(**{p.name: given.pop(p.name) for p in shared})
        run(outputs=outputs, **given)

    # Typer reads a command's options from its signature and its annotations.
    command.__signature__ = inspect.Signature([*own, *shared])  # type: ignore[attr-defined]
    command.__annotations__ = {p.name: p.annotation for p in (*own, *shared)}
    return command


TouchDirection = Annotated[
    str,
    typer.Option(
        "--pose-direction", metavar="NAME", help="base-gripper or gripper-base: inverted poses close as well."
    ),
]


@app.command("touch")
@with_outputs
def touch(
    outputs: Outputs,
    poses: p.Poses,
    robot: o.Robot = None,
    robot_link: o.RobotLink = None,
    robot_base: o.RobotBase = None,
    joint_angle: o.JointAngle = "auto",
    robot_format: o.RobotFormat = None,
    pose_units: p.Units = "auto",
    pose_rotation: p.Rotation = "auto",
    pose_angle: p.Angle = "auto",
    pose_direction: TouchDirection = "base-gripper",
) -> None:
    """The tip from four or more poses in which it touches one and the same point.

    calibrant tool touch --poses touches.csv --out tool.json
    """
    from calibrant.cli import session
    from calibrant.tasks.inputs.pose_choice import PoseForm
    from calibrant.tasks.inputs.robot_choice import RobotChoice
    from calibrant.tasks.robots import tool as tool_run

    outputs.spare(poses)
    form = PoseForm(pose_units, pose_rotation, pose_angle, pose_direction)
    arm = RobotChoice(robot, robot_link, robot_base, joint_angle, robot_format)
    session.finish(tool_run.touched(tuple(poses), form, arm), outputs)


@app.command("seen")
@with_outputs
def seen(
    outputs: Outputs,
    poses: p.Poses,
    pixels: Annotated[
        Path,
        typer.Option(
            "--pixels", metavar="FILE.csv", show_default=False,
            help="Where the camera sees the tip at each pose: columns image, u, v.",
        ),
    ],
    result: Annotated[
        Path,
        typer.Option(
            "--result", metavar="FILE", show_default=False,
            help="The camera that stands still: a hand-eye result, eye-to-hand.",
        ),
    ],
    robot: o.Robot = None,
    robot_link: o.RobotLink = None,
    robot_base: o.RobotBase = None,
    joint_angle: o.JointAngle = "auto",
    robot_format: o.RobotFormat = None,
    pose_units: p.Units = "auto",
    pose_rotation: p.Rotation = "auto",
    pose_angle: p.Angle = "auto",
    pose_direction: p.Direction = "auto",
) -> None:  # fmt: skip
    """The tip from three or more poses in which a calibrated camera that stands still sees it.

    calibrant tool seen --poses poses.csv --pixels tip.csv --result hand-eye.json
    """
    from calibrant.cli import session
    from calibrant.tasks.inputs.pose_choice import PoseForm
    from calibrant.tasks.inputs.robot_choice import RobotChoice
    from calibrant.tasks.robots import tool as tool_run

    outputs.spare([*poses, pixels, result])
    form = PoseForm(pose_units, pose_rotation, pose_angle, pose_direction)
    arm = RobotChoice(robot, robot_link, robot_base, joint_angle, robot_format)
    session.finish(tool_run.seen(tuple(poses), form, arm, pixels, result), outputs)


@app.command("self-visibility")
@with_outputs
def self_visibility(
    outputs: Outputs,
    image: Annotated[
        Path,
        typer.Option(
            "--image", metavar="FILE", show_default=False,
            help="A photo by the hand camera of the board with the gripper flat on it.",
        ),
    ],
    features: Annotated[
        Path,
        typer.Option(
            "--features", metavar="FILE.csv", show_default=False,
            help="Two or more gripper features: u, v in the photo, x_mm, y_mm, z_mm in the gripper (z 0 on the board).",
        ),
    ],
    camera: Annotated[
        Path, typer.Option("--camera", metavar="FILE", help="The hand camera (any format).", show_default=False)
    ],
    target: o.Target = None,
    sigma_px: Annotated[str, typer.Option("--sigma-px", metavar="LENGTH", help="Noise of a feature.")] = "0.5px",
) -> None:  # fmt: skip
    """Where a hand camera sits, from one photo: the robot does not move.

    calibrant tool self-visibility --image photo.png --features features.csv --camera camera.json --target
    chessboard:9x6:25mm
    """
    from calibrant.cli import session
    from calibrant.tasks.robots import tool as tool_run

    outputs.spare([image, features, camera])
    noise = o.pixels(sigma_px, option="--sigma-px") or 0.0
    silent = outputs.quiet or outputs.json
    session.finish(tool_run.self_visible(image, features, camera, target, noise, quiet=silent), outputs)
