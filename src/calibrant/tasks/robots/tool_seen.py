"""Find a tool's tip by sight: poses in which a calibrated camera that stands still sees it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from calibrant.errors import InputError
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.option import Option
from calibrant.tasks.options.poses import PoseOptions
from calibrant.tasks.options.robots import RobotOptions
from calibrant.tasks.outcome import Outcome

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from calibrant.calibrate.tool.tip import ToolTip
    from calibrant.cameras import Camera
    from calibrant.data import CalibrationResult, TransformEstimate
    from calibrant.formats.poses.read import PoseNotation

    Array = NDArray[np.float64]

EXAMPLE = 'cb.tool_seen(poses="poses.csv", pixels="tip.csv", result="hand-eye.json")'
NOT_A_TIP_PX = 20.0
"""Noise per axis of pixels that show another thing than the tip, or another session: no one clicks that badly."""
NO_TIP = (
    "no reading of the poses puts one tip where the pixels are; do poses, pixels and --result belong to one session?"
)


@dataclass(frozen=True, kw_only=True)
class Request:
    """The tip from three or more poses in which a calibrated camera that stands still sees it.

    calibrant tool seen --poses poses.csv --pixels tip.csv --result hand-eye.json
    """

    poses: Annotated[tuple[str, ...], Option("FILES")]
    """File of robot poses, or one file a pose."""
    pixels: Annotated[Path, Option("FILE.csv")]
    """Where the camera sees the tip at each pose: columns image, u, v."""
    result: Annotated[Path, Option("FILE")]
    """The camera that stands still: a hand-eye result, eye-to-hand."""
    arm: RobotOptions = RobotOptions()
    form: PoseOptions = PoseOptions()


def reads(request: Request) -> list[str | Path]:
    """The poses, the pixels, the camera's result, and the robot's file."""
    return [*request.poses, request.pixels, request.result, *request.arm.files]


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """The tip on the flange. Raises: InputError; RefusedError as `tip_by_sight`."""
    from calibrant.calibrate.tool.tip import tip_by_sight
    from calibrant.data.result_file import read_result
    from calibrant.formats.poses.pairing import match_by_order, match_raw
    from calibrant.tasks.inputs.columns import read_columns
    from calibrant.tasks.inputs.pose_choice import best_reading
    from calibrant.tasks.robots.tool_tips import flange_poses, tip_result

    camera, base_camera, covariance = _standing(read_result(request.result), request.result)
    table = read_columns(request.pixels, ("u", "v"))
    names = table.names or tuple(str(i) for i in range(len(table.values)))
    raw = request.form.read(request.poses, request.arm)
    pairing = match_by_order(len(raw), names) if table.names is None else match_raw(raw, names)
    uv = table.values[list(pairing.view_index)]

    def attempt(reading: PoseNotation) -> ToolTip:
        paired = reading.take(list(pairing.pose_index), [names[v] for v in pairing.view_index])
        return tip_by_sight(flange_poses(paired), uv, camera=camera, base_camera=base_camera, covariance=covariance)

    chosen = best_reading(raw, attempt, lambda tip: tip.sigma, fits=lambda tip: tip.sigma < NOT_A_TIP_PX, what=NO_TIP)
    return Outcome(result=tip_result(chosen.outcome, chosen.reading, reads(request)))


def _standing(known: CalibrationResult, path: Path) -> tuple[Camera, TransformEstimate, Array | None]:
    """The camera that stands still, T_base_camera, and the covariance of both together where the result tells it.

    Raises: InputError for a result of another kind.
    """
    import numpy as np

    from calibrant.diagnose.budget.cell import error_budget

    name = next(iter(known.cameras), "camera")
    place = next((t for t in known.transforms if (t.parent, t.child) == ("base", name)), None)
    if place is None or len(known.cameras) != 1:
        there = ", ".join(f"{t.parent} -> {t.child}" for t in known.transforms) or "no transform"
        raise InputError(
            f"{path}: expected the hand-eye result of a camera that stands still (base -> camera, eye-to-hand); it has "
            f"{there}. A camera on the gripper cannot tell where a tool on that gripper is"
        )
    if known.robot_poses is None or known.observations is None:
        return known.camera, place, None
    rows = np.r_[0:6, 12 : 12 + len(known.camera.values)]
    return known.camera, place, error_budget(known).covariance[np.ix_(rows, rows)]
