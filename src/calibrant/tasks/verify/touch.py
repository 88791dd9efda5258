"""Points that the robot touches with its tip, against where a calibrated camera says they are."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from calibrant.errors import InputError, RefusedError
from calibrant.tasks.inputs import session
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.images import NamedPhotoOptions, SearchOptions
from calibrant.tasks.options.option import Option
from calibrant.tasks.options.poses import PoseOptions
from calibrant.tasks.options.robots import RobotOptions
from calibrant.tasks.outcome import Outcome
from calibrant.tasks.verify.photos import photo_files
from calibrant.tasks.verify.placings import PlacedTargets, as_calibrated, placed_targets
from calibrant.tasks.verify.tips import parse_table, parse_tip

if TYPE_CHECKING:
    from calibrant.arrays import Array
    from calibrant.data import CalibrationResult
    from calibrant.verification.touch.errors import Touch

EXAMPLE = (
    'cb.verify_touch("hand-eye.json", images="marker/*.png", poses="marker.csv", target="marker:100mm:DICT_5X5_50:7", '
    'touches="touches.csv", tip="0,0,120mm")'
)


@dataclass(frozen=True, kw_only=True)
class Request:
    """Touch points with the robot's tip, and compare with where the camera says they are: offset, its sigma, a verdict.

    calibrant verify touch hand-eye.json --images marker/*.png --poses marker.csv --target marker:100mm:DICT_5X5_50:7 \\
        --touches touches.csv --tip 0,0,120mm --tolerance 1mm

    Exit status 0: every point within the tolerance; 1: not. One photo a touch, in the same order or by name, or one
    photo for all touches. A camera beside the robot needs no --poses.
    """

    result: Annotated[Path, Option("RESULT.json", positional=True)]
    """The calibration: a result of hand-eye."""
    photos: NamedPhotoOptions = NamedPhotoOptions()
    poses: Annotated[tuple[str, ...], Option("FILES")] = ()
    """Robot poses of the photos: a file, or one file a pose."""
    touches: Annotated[tuple[str, ...], Option("FILES")] = ()
    """Robot poses in which the tip touches the target: a file, or one file a pose."""
    tip: Annotated[str, Option("X,Y,Z")] = ""
    """The tip on the flange: 0,0,120mm, or a result of `tool touch`."""
    points: Annotated[Path | None, Option("FILE.csv")] = None
    """Which point of the target each touch touches: x_mm, y_mm, z_mm in the target; else its middle."""
    name: Annotated[str | None, Option("CAMERA")] = None
    """Which camera took the photos, where the result has several."""
    table: Annotated[str | None, Option("Z,SIGMA")] = None
    """Height of the table that the target lies on, in the base, and its sigma: 0mm,1mm."""
    tolerance: Annotated[str | None, Option("LENGTH")] = None
    """Largest error that passes: 1mm."""
    form: PoseOptions = PoseOptions()
    arm: RobotOptions = RobotOptions()
    search: SearchOptions = SearchOptions()


def reads(request: Request) -> list[str | Path]:
    """The result, the photos, the poses, the touches and what describes them."""
    points = [] if request.points is None else [request.points]
    tip = [request.tip] if request.tip.endswith(".json") else []
    photos = photo_files(request.photos, request.search)
    return [request.result, *photos, *request.poses, *request.touches, *points, *tip, *request.arm.files]


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """Errors at the touched points, as a result of kind "touch". Raises: InputError; RefusedError for a height that the
    table contradicts."""
    from calibrant.targets.lengths import parse_length
    from calibrant.verification.touch.result import touch_result

    if not request.touches or not request.tip:
        raise InputError("give the robot's poses at the touches (--touches FILE) and the tip (--tip 0,0,120mm)")
    tolerance = None if request.tolerance is None else 1e3 * parse_length(request.tolerance, what="--tolerance")
    placed = placed_targets(request.result, request, parse_table(request.table), listener)
    touches = _touches(placed, request)
    result = touch_result(
        touches, placed.side.X, parent=placed.parent, camera=placed.compare.name, tolerance_mm=tolerance
    )
    options = {"result": str(request.result), "tip": request.tip, "tolerance": request.tolerance}
    result = replace(result, options=options, inputs=session.file_records(reads(request)))
    return Outcome(result=result, refusal=refusal_of(result, "touch"))


def refusal_of(result: CalibrationResult, name: str) -> RefusedError | None:
    """Why a task's answer is no, None where it is yes."""
    check = result.check(name)
    if check.status != "fail":
        return None
    error = RefusedError(check.message)
    error.result = result
    return error


def _touches(placed: PlacedTargets, request: Request) -> list[Touch]:
    from calibrant.geometry import se3
    from calibrant.verification.touch.placing import touch_of

    tip, sigma = parse_tip(request.tip)
    raw = request.form.read(request.touches, request.arm)
    at = as_calibrated(placed.compare, raw, list(range(len(raw))), _ids(len(raw)))
    if len(placed.placings) not in (1, len(at)):
        raise InputError(
            f"{len(at)} touches and {len(placed.placings)} photos that show the target: take one photo for all "
            "touches, or "
            "one for each, in the same order"
        )
    placings = placed.placings * (len(at) if len(placed.placings) == 1 else 1)
    points = _points(placed, request.points, len(at))
    return [
        touch_of(
            replace(placing, name=f"touch {i + 1}"),
            placed.side,
            point,
            touched=se3.apply(T, tip),
            tip=tip,
            T_base_gripper=T,
            sigma=sigma,
        )
        for i, (placing, T, point) in enumerate(zip(placings, at, points))
    ]


def _ids(count: int) -> list[str]:
    return [f"touch {i + 1}" for i in range(count)]


def _points(placed: PlacedTargets, file: Path | None, count: int) -> Array:
    """Touched points (n, 3) of the target."""
    import numpy as np

    from calibrant.tasks.inputs.columns import read_columns

    if file is None:
        return np.tile(placed.middle, (count, 1))
    points = 1e-3 * read_columns(file, ("x_mm", "y_mm", "z_mm")).values
    if len(points) != count:
        raise InputError(f"{file} has {len(points)} points for {count} touches: one row a touch")
    return points
