"""Fresh views against a result: errors in px, mm and deg beside what the calibration predicts for them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

from calibrant.errors import InputError
from calibrant.tasks.inputs import session
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.images import NamedPhotoOptions, SearchOptions
from calibrant.tasks.options.option import Option
from calibrant.tasks.options.poses import PoseOptions
from calibrant.tasks.options.robots import RobotOptions
from calibrant.tasks.options.words import pixels
from calibrant.tasks.outcome import Outcome
from calibrant.tasks.verify.photos import every_photo, photo_files, target_seen
from calibrant.tasks.verify.sides import Compare, check_size, seen_at_poses
from calibrant.tasks.verify.touch import refusal_of

EXAMPLE = 'cb.verify_held_out("hand-eye.json", images="fresh/*.png", poses="fresh.csv", tolerance="1mm")'


@dataclass(frozen=True, kw_only=True)
class Request:
    """Try a calibration on views that it never saw: errors in px, mm and deg beside the predicted ones, pass or fail.

    calibrant verify held-out hand-eye.json --images fresh/*.png --poses fresh.csv --tolerance 1mm
    calibrant verify held-out camera.json --images fresh/*.png --tolerance 0.5px

    Exit status 0: every view is within the tolerance; 1: not. With robot poses the calibration's target is where the
    calibration puts it, or not; without, the lens explains the views, or not.
    """

    result: Annotated[Path, Option("RESULT.json", positional=True)]
    """The calibration: a result of hand-eye, or with a camera."""
    photos: NamedPhotoOptions = NamedPhotoOptions()
    poses: Annotated[tuple[str, ...], Option("FILES")] = ()
    """Robot poses of the photos: a file, or one file a pose."""
    name: Annotated[str | None, Option("CAMERA")] = None
    """Which camera took the photos, where the result has several."""
    tolerance: Annotated[str | None, Option("LENGTH")] = None
    """Largest error of a view that passes: 1mm at the target's middle, or 0.5px rms."""
    form: PoseOptions = PoseOptions()
    arm: RobotOptions = RobotOptions()
    search: SearchOptions = SearchOptions()


def reads(request: Request) -> list[str | Path]:
    """The result, the photos, the poses and the robot's file."""
    return [request.result, *photo_files(request.photos, request.search), *request.poses, *request.arm.files]


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """The errors, as a result of kind "held-out". Raises: InputError as `verify unchanged`."""
    from calibrant.data.result_file import read_result
    from calibrant.targets.lengths import parse_length
    from calibrant.verification.held_out.result import at_poses, by_lens, held_out_result
    from calibrant.verification.watch.placed import at_robot_poses, placed_views
    from calibrant.verification.watch.sequential import joint_chi2

    compare = Compare.of(read_result(request.result), request.name, request.photos.target)
    if compare.target is None:
        raise InputError("the result does not name its target: give what the photos show (--target SPEC)")
    if request.poses and not compare.on_robot:
        raise InputError(f"--poses goes with a hand-eye result; this one is of kind {compare.kind!r}: leave them out")
    in_px = request.tolerance is not None and request.tolerance.strip().endswith("px")
    px = pixels(request.tolerance, option="--tolerance") if in_px else None
    mm = None if request.tolerance is None or in_px else 1e3 * parse_length(request.tolerance, what="--tolerance")
    photos = every_photo(request.photos, request.search)
    seen = target_seen(compare, [f for f, keep in photos if keep], request.search, listener, optional=False)
    views = [] if seen is None else [v for v in seen.views if len(v) >= 4]
    if seen is None or not views:
        raise InputError(f"no photo shows the target {compare.target}")
    check_size(compare, seen)
    session.load_solver(listener)
    with listener.status("Comparing with the calibration …"):
        if request.poses:
            side, now, T = seen_at_poses(compare, views, request, photos)
            placed = placed_views(compare.camera, now.views, side.predicted(T), stated_px=compare.sigma_px)
            sights = at_robot_poses(compare.camera, side, placed, T)
            rows, chi2 = at_poses(compare.camera, placed, sights), joint_chi2(sights)
        else:
            from calibrant.verification.unchanged.compare import seen_now

            alone = seen_now(compare.camera, views)
            placed = placed_views(compare.camera, alone.views, alone.T_camera_target)
            if compare.sigma_px is None:
                raise InputError("the result states no noise of its points to compare with; calibrate again")
            rows, total, freedom = by_lens(compare.camera, placed, compare.sigma_px)
            chi2 = (total, freedom)
    result = held_out_result(rows, chi2, tolerance_mm=mm, tolerance_px=px, observations=seen)
    options = {"result": str(request.result), "tolerance": request.tolerance, "camera": request.name}
    kept = {k: v for k, v in options.items() if v is not None}
    result = replace(result, options=kept, inputs=session.file_records(reads(request)))
    return Outcome(result=result, refusal=refusal_of(result, "held-out"))
