"""Find a tool's tip by touch: poses in which it touches one and the same point."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.option import Option
from calibrant.tasks.options.poses import TouchPoseOptions
from calibrant.tasks.options.robots import RobotOptions
from calibrant.tasks.outcome import Outcome

if TYPE_CHECKING:
    from calibrant.calibrate.tool.tip import ToolTip
    from calibrant.formats.poses.read import PoseNotation

EXAMPLE = 'cb.tool_touch(poses="touches.csv")'


@dataclass(frozen=True, kw_only=True)
class Request:
    """The tip from four or more poses in which it touches one and the same point.

    calibrant tool touch --poses touches.csv --out tool.json
    """

    poses: Annotated[tuple[str, ...], Option("FILES")]
    """File of robot poses, or one file a pose."""
    arm: RobotOptions = RobotOptions()
    form: TouchPoseOptions = TouchPoseOptions()


def reads(request: Request) -> list[str]:
    """The poses, and the robot's file."""
    return [*request.poses, *request.arm.files]


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """The tip on the flange. Raises: InputError; RefusedError as `tip_by_touch`."""
    from calibrant.calibrate.tool.moved_point import moved_point
    from calibrant.calibrate.tool.tip import TOUCH_MM, tip_by_touch
    from calibrant.tasks.inputs.pose_choice import best_reading
    from calibrant.tasks.robots.tool_tips import flange_poses, tip_result

    raw = request.form.read(request.poses, request.arm)

    def attempt(reading: PoseNotation) -> ToolTip:
        return tip_by_touch(flange_poses(reading))

    chosen = best_reading(raw, attempt, lambda tip: tip.sigma, credible=lambda tip: tip.sigma <= TOUCH_MM[1])
    poses = flange_poses(chosen.reading)
    return Outcome(result=tip_result(chosen.outcome, chosen.reading, reads(request), moved=moved_point(poses)))
