"""The tip to a marker's centre: where to go, how far off it will be, and, when it was measured, how far it was."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from calibrant.errors import InputError
from calibrant.tasks.inputs import session
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.cell import CellOptions
from calibrant.tasks.options.images import NamedPhotoOptions, SearchOptions
from calibrant.tasks.options.option import Option
from calibrant.tasks.options.poses import PoseOptions
from calibrant.tasks.options.robots import RobotOptions
from calibrant.tasks.outcome import Outcome
from calibrant.tasks.verify.photos import photo_files
from calibrant.tasks.verify.placings import PlacedTargets, placed_targets
from calibrant.tasks.verify.tips import parse_table, parse_tip
from calibrant.tasks.verify.touch import refusal_of

if TYPE_CHECKING:
    from calibrant.arrays import Array
    from calibrant.verification.touch.errors import Touch
    from calibrant.verification.touch.placing import Placing

EXAMPLE = (
    'cb.verify_pinpoint("hand-eye.json", images="marker/*.png", poses="marker.csv", '
    'target="marker:100mm:DICT_5X5_50:7", tip="0,0,120mm")'
)


@dataclass(frozen=True, kw_only=True)
class Request:
    """Put the tip to a marker's centre: where the robot must go, the error that is predicted, and the one measured.

    calibrant verify pinpoint hand-eye.json --images marker/*.png --poses marker.csv \\
        --target marker:100mm:DICT_5X5_50:7 --tip 0,0,120mm
    calibrant verify pinpoint hand-eye.json --images marker/*.png --poses marker.csv \\
        --target marker:100mm:DICT_5X5_50:7 --tip 0,0,120mm --offsets read.csv --tolerance 2mm
    calibrant verify pinpoint --cell --view top --seeds 20

    First without --offsets: it says the coordinate of every marker and the robot's pose with the tip above it; nothing
    moves. Check the coordinate, drive there, and read how far the tip is off. Then with --offsets: the error beside the
    predicted one, pass or fail, and the correction of the camera's pose that all of them propose. With --cell all of it
    runs by itself in simulated cells, calibrated from their own pictures and measured by the truth.
    """

    result: Annotated[Path | None, Option("RESULT.json", positional=True)] = None
    """The calibration: a result of hand-eye; not with --cell."""
    photos: NamedPhotoOptions = NamedPhotoOptions()
    poses: Annotated[tuple[str, ...], Option("FILES")] = ()
    """Robot poses of the photos: a file, or one file a pose."""
    tip: Annotated[str, Option("X,Y,Z")] = ""
    """The tip on the flange: 0,0,120mm, or a result of `tool touch`."""
    hover: Annotated[str, Option("LENGTH")] = "5mm"
    """What the tip stops above the marker."""
    offsets: Annotated[Path | None, Option("FILE.csv")] = None
    """What was read when the arm stood: image, dx_mm, dy_mm, dz_mm: the tip less where it should be, along the base's
    axes."""
    reading: Annotated[str, Option("LENGTH")] = "0.5mm"
    """How well an offset was read, 1 sigma."""
    name: Annotated[str | None, Option("CAMERA")] = None
    """Which camera took the photos, where the result has several."""
    table: Annotated[str | None, Option("Z,SIGMA")] = None
    """Height of the table that the marker lies on, in the base, and its sigma: 0mm,1mm."""
    tolerance: Annotated[str | None, Option("LENGTH")] = None
    """Largest error that passes: 2mm."""
    yes: bool = False
    """Let a robot that could hit something move without asking."""
    cells: CellOptions = CellOptions()
    form: PoseOptions = PoseOptions()
    arm: RobotOptions = RobotOptions()
    search: SearchOptions = SearchOptions()


def reads(request: Request) -> list[str | Path]:
    """The result, the photos, the poses, the tip and what was read."""
    if request.cells.cell or request.result is None:
        return []
    offsets = [] if request.offsets is None else [request.offsets]
    tip = [request.tip] if request.tip.endswith(".json") else []
    photos = photo_files(request.photos, request.search)
    return [request.result, *photos, *request.poses, *offsets, *tip, *request.arm.files]


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """Where to go, or the errors, as a result of kind "pinpoint". Raises: InputError; RefusedError for a height that
    the table contradicts."""
    from calibrant.targets.lengths import parse_length
    from calibrant.verification.pinpoint.result import pinpoint_result, planned_result

    tolerance = None if request.tolerance is None else 1e3 * parse_length(request.tolerance, what="--tolerance")
    request.cells.check()
    if request.cells.cell:
        return _in_cells(request, tolerance, listener)
    if request.result is None:
        raise InputError(
            "give the calibration to verify (a result of `calibrant hand-eye`), or --cell for simulated ones"
        )
    if not request.tip:
        raise InputError("say where the tip is on the flange: --tip 0,0,120mm, or the result of `calibrant tool touch`")
    placed = placed_targets(request.result, request, parse_table(request.table), listener)
    goals = [_goal(placed, p, T, request) for p, T in zip(placed.placings, placed.T_base_gripper)]
    touches = [] if request.offsets is None else _touches(placed, goals, request)
    if touches:
        result = pinpoint_result(
            touches, placed.side.X, parent=placed.parent, camera=placed.compare.name, tolerance_mm=tolerance
        )
    else:
        said = [_said(placed, p, g, request) for p, g in zip(placed.placings, goals)]
        advice = (
            "Nothing has moved. Check each coordinate, drive the robot there slowly, and read along the base's axes "
            "how far "
            "the tip is from above the marker's middle; write that to a CSV file (image,dx_mm,dy_mm,dz_mm) and run "
            "again "
            "with --offsets FILE."
        )
        result = planned_result(said, tolerance_mm=tolerance, advice=advice)
    options = {"result": str(request.result), "tip": request.tip, "tolerance": request.tolerance}
    result = replace(result, options=options, inputs=session.file_records(reads(request)))
    return Outcome(result=result, refusal=refusal_of(result, "pinpoint"))


def _in_cells(request: Request, tolerance_mm: float | None, listener: Listener) -> Outcome:
    """The whole of it in simulated cells."""
    from calibrant.targets.lengths import parse_length
    from calibrant.tasks.verify.in_cell.pinpoint import pinpoint_series
    from calibrant.verification.runs import runs_text

    if request.result is not None or request.photos.images or request.offsets is not None:
        raise InputError("--cell calibrates and looks by itself: leave the result, the photos and the offsets out")
    hover = parse_length(request.hover, what="--hover")
    result = pinpoint_series(request.cells, tolerance_mm=tolerance_mm, hover=hover, yes=request.yes, listener=listener)
    return Outcome(result=result, printed=partial(runs_text, result), refusal=refusal_of(result, "pinpoint"))


def _goal(placed: PlacedTargets, placing: Placing, T_base_gripper: Array | None, request: Request) -> Array:
    """T_base_gripper (4, 4) with the tip above the target's middle."""
    import numpy as np

    from calibrant.geometry import se3
    from calibrant.targets.lengths import parse_length
    from calibrant.verification.pinpoint.goal import goal_above

    tip, _ = parse_tip(request.tip)
    now = np.diag([1.0, -1.0, -1.0]) if T_base_gripper is None else T_base_gripper[:3, :3]
    hover = parse_length(request.hover, what="--hover")
    return goal_above(placing.T_base_target, placed.middle, se3.make(np.eye(3), tip), now, hover=hover)[0]


def _said(placed: PlacedTargets, placing: Placing, goal: Array, request: Request) -> tuple[str, str, float]:
    """The name, the coordinate and the goal in words, and the predicted 95 % error, mm."""
    from calibrant.verification.pinpoint.goal import coordinate_words, pose_words
    from calibrant.verification.touch.placing import touch_of

    tip, sigma = parse_tip(request.tip)
    said, _ = placing.at(placed.middle)
    touch = touch_of(placing, placed.side, placed.middle, touched=said, tip=tip, T_base_gripper=goal, sigma=sigma)
    words = f"{coordinate_words(placing, placed.middle)}; flange to {pose_words(goal)}"
    return placing.name, words, 1e3 * touch.predicted_95


def _touches(placed: PlacedTargets, goals: list[Array], request: Request) -> list[Touch]:
    """What was read, at every photo that it names."""
    import numpy as np

    from calibrant.targets.lengths import parse_length
    from calibrant.tasks.inputs.columns import read_columns
    from calibrant.verification.touch.placing import touch_of

    if request.offsets is None:
        return []
    table = read_columns(request.offsets, ("dx_mm", "dy_mm", "dz_mm"))
    tip, sigma = parse_tip(request.tip)
    names = [p.name for p in placed.placings]
    if table.names is None and len(table.values) != len(names):
        raise InputError(
            f"{request.offsets} has {len(table.values)} rows without names for {len(names)} photos that show the "
            "target: "
            "add a column image, or give a row a photo"
        )
    rows = [names.index(n) if n in names else -1 for n in table.names or names]
    if -1 in rows:
        raise InputError(
            f"{request.offsets} names {(table.names or ())[rows.index(-1)]}, which is no photo that shows the target; "
            "there "
            f"are {', '.join(names[:6])}"
        )
    read = float(np.hypot(parse_length(request.reading, what="--reading"), sigma))
    out = []
    for row, off in zip(rows, 1e-3 * table.values):
        placing, goal = placed.placings[row], goals[row]
        said, _ = placing.at(placed.middle)
        out.append(
            touch_of(placing, placed.side, placed.middle, touched=said - off, tip=tip, T_base_gripper=goal, sigma=read)
        )
    return out
