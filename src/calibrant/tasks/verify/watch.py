"""Has the camera been moved: pictures of a tag, a board or the gripper's own features, one after another."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from calibrant.errors import InputError, RefusedError
from calibrant.tasks.inputs import session
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.cell import CellOptions
from calibrant.tasks.options.images import NamedPhotoOptions, SearchOptions
from calibrant.tasks.options.option import Option
from calibrant.tasks.options.poses import PoseOptions
from calibrant.tasks.options.robots import RobotOptions
from calibrant.tasks.options.words import pixels
from calibrant.tasks.outcome import Outcome
from calibrant.tasks.verify.photos import every_photo, target_seen
from calibrant.tasks.verify.sides import Compare, check_size, seen_at_poses

if TYPE_CHECKING:
    from calibrant.arrays import Array
    from calibrant.data import CalibrationResult, View
    from calibrant.verification.watch.dots import DotsThen
    from calibrant.verification.watch.result import Moved, Watched

EXAMPLE = 'cb.verify_watch("hand-eye.json", images="today/*.png", poses="today.csv")'


@dataclass(frozen=True, kw_only=True)
class Request:
    """Watch a camera while it works: when and by how much it has been moved, with a stated rate of false alarms.

    calibrant verify watch hand-eye.json --images today/*.png --poses today.csv
    calibrant verify watch self-visibility.json --images today/*.png --features features.csv
    calibrant verify watch --cell --view front --seeds 20

    Exit status 0: not moved; 1: moved. The pictures are taken one after another, in their order. With robot poses the
    target of the calibration is compared with where the calibration puts it; without, a camera that stands still with
    the target's place of then (a pose result) or of the first picture; with --features, the gripper's own features
    with their pixels of then.
    """

    result: Annotated[Path | None, Option("RESULT.json", positional=True)] = None
    """The calibration: a result of hand-eye, pose, intrinsics, rig or tool self-visibility; not with --cell."""
    photos: NamedPhotoOptions = NamedPhotoOptions()
    poses: Annotated[tuple[str, ...], Option("FILES")] = ()
    """Robot poses of the pictures: a file, or one file a pose."""
    features: Annotated[Path | None, Option("FILE.csv")] = None
    """Gripper features as `tool self-visibility` takes them: u, v in the picture of then, x_mm, y_mm, z_mm."""
    sigma_px: Annotated[str, Option("LENGTH")] = "0.2px"
    """Noise of a gripper feature."""
    name: Annotated[str | None, Option("CAMERA")] = None
    """Which camera took the pictures, where the result has several."""
    run: Annotated[str, Option("PICTURES")] = "100000"
    """Pictures between two false alarms, in the mean: 100000 raises one in 1 % of runs of 1000 pictures at most."""
    cells: CellOptions = CellOptions()
    form: PoseOptions = PoseOptions()
    arm: RobotOptions = RobotOptions()
    search: SearchOptions = SearchOptions()


def reads(request: Request) -> list[str | Path]:
    """The result, the pictures, the poses, the features and the robot's file."""
    if request.cells.cell or request.result is None:
        return []
    photos = [file for file, keep in every_photo(request.photos, request.search) if keep]
    features = [] if request.features is None else [request.features]
    return [request.result, *photos, *request.poses, *features, *request.arm.files]


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """Since when the camera has been moved, as a result of kind "watch"; a moved camera is the outcome's refusal.

    Raises: InputError where the pictures do not show what is watched; the same as the parts do.
    """
    from calibrant.data.result_file import read_result
    from calibrant.verification.watch.result import watch_result

    request.cells.check()
    if request.cells.cell:
        return _in_cells(request, listener)
    if request.result is None:
        raise InputError("give the calibration that the pictures are compared with, or --cell for simulated ones")
    known = read_result(request.result)
    compare = Compare.of(known, request.name, request.photos.target)
    if request.features is not None:
        found, moved = _by_features(compare, request.features, request, listener)
    else:
        found, moved = _by_target(compare, request, listener)
    result = watch_result(found, moved)
    options = {"result": str(request.result), "camera": request.name, "run": _run(request.run)}
    kept = {k: v for k, v in options.items() if v is not None}
    result = replace(result, options=kept, inputs=session.file_records(reads(request)))
    return Outcome(result=result, refusal=_refusal(result))


def _in_cells(request: Request, listener: Listener) -> Outcome:
    """Simulated cells whose camera is pushed at a picture."""
    from calibrant.tasks.verify.in_cell.watch import watch_series
    from calibrant.verification.runs import runs_text

    if request.result is not None or request.photos.images or request.features is not None:
        raise InputError("--cell calibrates and looks by itself: leave the result, the pictures and the features out")
    found = watch_series(request.cells, run=_run(request.run), listener=listener)
    return Outcome(result=found, printed=partial(runs_text, found), refusal=_refusal(found))


def _run(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 100 <= value < float("inf"):
        raise InputError(f"--run {text}: give the pictures between two false alarms, 100 or more, such as 100000")
    return value


def _refusal(result: CalibrationResult) -> RefusedError | None:
    check = result.check("watch")
    if check.status != "fail":
        return None
    error = RefusedError(f"the camera was watched: {check.message}")
    error.result = result
    return error


def _by_target(compare: Compare, request: Request, listener: Listener) -> tuple[Watched, Moved | None]:
    """The target in every picture, against where it should be."""
    if compare.target is None:
        raise InputError("the result does not name its target: give what the pictures show (--target SPEC)")
    if request.poses and not compare.on_robot:
        raise InputError(f"--poses goes with a hand-eye result; this one is of kind {compare.kind!r}: leave them out")
    photos = every_photo(request.photos, request.search)
    files = [file for file, keep in photos if keep]
    observations = target_seen(compare, files, request.search, listener, optional=False)
    views = [] if observations is None else [v for v in observations.views if len(v) >= 4]
    if observations is None or not views:
        raise InputError(f"no picture shows the target {compare.target}")
    check_size(compare, observations)
    session.load_solver(listener)

    from calibrant.verification.watch.placed import (
        at_robot_poses,
        placed_views,
        shared_while_still,
        standing_still,
    )
    from calibrant.verification.watch.result import Watched, moved_camera, moved_in_hand, watched
    from calibrant.verification.watch.sequential import Rule, fit_since

    missed = tuple((m.id, m.reason) for m in observations.missed)
    with listener.status("Watching …"):
        if request.poses:
            side, seen, T = seen_at_poses(compare, views, request, photos)
            expected = side.predicted(T)
            placed = placed_views(compare.camera, seen.views, expected, stated_px=compare.sigma_px)
            sights = at_robot_poses(compare.camera, side, placed, T)
            rule = Rule(_run(request.run), side.freedom)
        else:
            then, covariance = _then(compare)
            expected = _expected(compare, views, then)
            placed = placed_views(compare.camera, views, expected, stated_px=compare.sigma_px)
            sights = standing_still(placed, then, covariance)
            rule = Rule(_run(request.run))
        middle = 0.5 * (views[0].points.min(axis=0) + views[0].points.max(axis=0))
        places = tuple(one.T_camera_target[:3, :3] @ middle + one.T_camera_target[:3, 3] for one in placed)
        found = Watched(sights, watched(sights, rule), missed, compare.camera, places, observations)
        alarm = found.last.alarm
        if alarm is None:
            return found, None
        if request.poses:
            return found, moved_in_hand(found, alarm.since)
        move, C, _ = fit_since(sights, alarm.since, noise=found.last.starts[0].noise)
        return found, moved_camera(found, move, C + shared_while_still(sights[-1]))


def _then(compare: Compare) -> tuple[Array | None, Array | None]:
    """T_camera_target of then with its covariance, where the result is of one place of the target."""
    if compare.kind != "pose" or len(compare.known.transforms) != 1:
        return None, None
    estimate = compare.known.transforms[0]
    return estimate.matrix, estimate.covariance


def _expected(compare: Compare, views: list[View], then: Array | None) -> Array:
    """T_camera_target (n, 4, 4) of pictures of a target that stands still: of then, else by the first picture."""
    import numpy as np

    from calibrant.verification.unchanged.compare import seen_now

    first = seen_now(compare.camera, views[:1]).T_camera_target[0] if then is None else then
    return np.tile(first, (len(views), 1, 1))


def _by_features(
    compare: Compare, features: Path, request: Request, listener: Listener
) -> tuple[Watched, Moved | None]:
    """The gripper's features in every picture, against their pixels of then."""
    import numpy as np

    from calibrant.data.file_names import distinct_names
    from calibrant.detection.images.images import load_grey
    from calibrant.tasks.inputs.columns import read_columns
    from calibrant.verification.watch.dots import DotsThen, dot_sights, find_dots
    from calibrant.verification.watch.result import Watched, watched
    from calibrant.verification.watch.sequential import Rule

    if request.poses:
        raise InputError("--features watches the gripper that the camera sits on, from every pose: leave --poses out")
    table = read_columns(features, ("u", "v", "x_mm", "y_mm", "z_mm"))
    noise = pixels(request.sigma_px, option="--sigma-px") or 0.2
    then = DotsThen(table.values[:, :2], 1e-3 * table.values[:, 2:], noise)
    photos = every_photo(request.photos, request.search)
    files = [file for file, keep in photos if keep]
    names, found, missed = distinct_names(files), [], []
    with listener.status("Watching the gripper's features …"):
        for file in files:
            uv = find_dots(load_grey(file), then.uv)
            lost = np.flatnonzero(~np.isfinite(uv).all(axis=1))
            if len(lost):
                missed.append((names[file], f"feature {lost[0] + 1} is not near the pixel where it was"))
            else:
                found.append((names[file], uv))
        if not found:
            raise InputError(f"no picture shows all {len(then.uv)} gripper features near where they were: {missed[0]}")
        sights = dot_sights([n for n, _ in found], np.stack([uv for _, uv in found]), then)
        states = watched(sights, Rule(_run(request.run)))
    result = Watched(sights, states, tuple(missed), compare.camera)
    return result, _shifted(compare, result, then)


def _shifted(compare: Compare, found: Watched, then: DotsThen) -> Moved | None:
    """What the dots tell of the camera's move."""
    import numpy as np

    from calibrant.data import Measured
    from calibrant.diagnose.movement import figure, side_words
    from calibrant.verification.watch.dots import camera_move
    from calibrant.verification.watch.result import PUSHED, Moved, moved_camera
    from calibrant.verification.watch.sequential import fit_since

    alarm = found.last.alarm
    if alarm is None:
        return None
    shift, C, _ = fit_since(found.sights, alarm.since)
    mean = np.tile(np.eye(2), len(then.uv)) / len(then.uv)
    step, spread = mean @ shift, mean @ C @ mean.T
    size, sigma = float(np.linalg.norm(step)), float(np.sqrt(np.linalg.eigvalsh(spread)[-1]))
    seen = f"the gripper's features have moved {figure(size, sigma)} px {side_words(step, spread)} in the picture"
    figures = {"in the picture": Measured(size, sigma, "px")}
    place = next((t for t in compare.known.transforms if (t.parent, t.child) == ("gripper", "camera")), None)
    known = None if place is None else camera_move(compare.camera, place.matrix, then, shift, C)
    if known is None:
        return Moved(f"{seen} (two features do not tell a shift of the camera from a turn)", PUSHED, figures)
    told = moved_camera(found, *known)
    return Moved(f"{seen}: {told.words}", told.advice, figures | told.figures)
