"""The dynamic method live: place and sigma after every picture, and the way to where the camera is wanted."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from calibrant.cancel import answered, checkpoint
from calibrant.errors import InputError, RefusedError
from calibrant.tasks.inputs import session
from calibrant.tasks.listener import Listener
from calibrant.tasks.outcome import Outcome

if TYPE_CHECKING:
    from collections.abc import Iterable

    from calibrant.arrays import Array
    from calibrant.calibrate.dynamic.track import DynamicCalibration
    from calibrant.detection.live import Frame
    from calibrant.servoing.located_live import Located
    from calibrant.tasks.robots.dynamic_request import Request


def live(request: Request, listener: Listener) -> Outcome:
    """The external camera where it was last, as a result. Raises: InputError; RefusedError where it was never seen."""
    if request.cell:
        return _in_cell(request, listener)
    from calibrant.detection.live import frames_from
    from calibrant.formats.cameras.read import read_camera
    from calibrant.formats.poses.pairing import match_raw
    from calibrant.targets.registry import parse_target
    from calibrant.tasks.inputs.pose_choice import best_reading
    from calibrant.tasks.robots import dynamic_views as views_of
    from calibrant.tasks.robots.dynamic_request import needed

    device = request.device
    if device.camera_device is None and len(request.external_images) != 1:
        raise InputError(
            "--live takes one external camera: its number, a video, or a folder (--external-images 0), or "
            "--camera-device"
        )
    given = needed(request)
    wrist, noise = views_of.wrist_of(given.wrist)
    external = read_camera(given.camera)
    near = views_of.boards(request, request.wrist_images, "wrist", listener)
    raw = request.form.read(request.poses, request.arm)
    pairing = match_raw(raw, [v.id for v in near.views])
    session.load_solver(listener)

    def attempt(reading):  # type: ignore[no-untyped-def]
        T = reading.T_base_gripper[list(pairing.pose_index)]
        views = [near.views[i] for i in pairing.view_index]
        return views_of.take_in(wrist, external, noise, views, T, (), moves=False)

    chosen = best_reading(
        raw, attempt, lambda t: t.known.solution.cost if t.known.solution else float("inf"),
        fits=lambda t: t.off < views_of.NO_FIT, what=views_of.DO_NOT_FIT,
    )  # fmt: skip
    frames = frames_from(request.external_images[0]) if device.camera_device is None else device.frames(listener)
    board = parse_target(given.target)
    known, seen = _followed(frames, chosen.outcome.known, board, _wanted(request), request.pictures, listener)
    if known.new_place:
        raise RefusedError(f"none of {seen} pictures shows the board to the external camera")
    done = views_of.dynamic_result(
        replace(chosen.outcome, known=known), request, chosen.reading.description, pairing.message, noise
    )
    return Outcome(result=done)


def _followed(  # type: ignore[no-untyped-def]
    frames: Iterable[Frame], known: DynamicCalibration, board, wanted: Array | None, most: int, listener: Listener
) -> tuple[DynamicCalibration, int]:
    """What is known after the frames, and how many there were."""
    from calibrant.data import View
    from calibrant.detection.registry import detector_for
    from calibrant.servoing.located_live import EXTERNAL, FEWEST, after_external
    from calibrant.servoing.sight.eye import Model

    detector, model, count = detector_for(board.kind), Model.target(board), 0
    try:
        for frame in frames:
            checkpoint()
            count += 1
            found = detector.detect(frame.grey, board)
            view: View | str = found.reason or f"{len(found.uv)} points of the board, {FEWEST} are needed"
            if found.found and len(found.uv) >= FEWEST:
                points = model.of(found.point_ids)
                view = View(frame.name, points, found.uv, found.point_ids, camera=EXTERNAL, sigma_px=found.sigma_px)
            located = after_external(known, frame.name, view, wanted)
            known = located.known
            listener.note(located.words)
            if count == most:
                break
    except KeyboardInterrupt:  # a camera has no end of its own: this is how a person says that it is enough
        answered()
        listener.note("Stopped; the result is of the pictures so far.")
    return known, count


def _wanted(request: Request) -> Array | None:
    """T_base_external that the camera is led to. Raises: InputError for a result without it."""
    if request.wanted is None:
        return None
    from calibrant.data.result_file import read_result

    known = read_result(request.wanted)
    places = [t for t in known.transforms if t.parent == "base"]
    named = [t for t in places if t.child == "external"] or places
    if len(named) != 1:
        raise InputError(
            f"{request.wanted}: expected one transform base -> external, the wanted place; it has "
            f"{', '.join(f'{t.parent} -> {t.child}' for t in known.transforms) or 'none'}"
        )
    return named[0].matrix


def _in_cell(request: Request, listener: Listener) -> Outcome:
    """A simulated cell: located, then led."""
    from calibrant.data import CalibrationResult, Check, Measured, verdict_of
    from calibrant.data.verdicts import stamp
    from calibrant.studies.live_cell import live_run
    from calibrant.tasks.robots.dynamic_views import wrist_from

    if request.seed < 0:
        raise InputError(f"--seed {request.seed}: 0 or more")
    said: list[str] = []

    def heard(located: Located) -> None:
        said.append(located.words)
        listener.note(located.words)

    with listener.status("Calibrating the cell's cameras …"):
        run = live_run(request.seed, partial(wrist_from, name="the cell's wrist camera"), heard=heard)
    last = run.said[-1]
    place = last.T_base_external
    if place is None:
        raise RefusedError(f"the front camera was not located: {last.words}")
    found = (
        f"found {run.error_mm:.2g} mm and {run.error_deg:.2g} deg from the truth, after {len(run.said) - 2} pictures; "
        f"led to {run.left_mm:.2g} mm and {run.left_deg:.2g} deg from where it was wanted"
    )
    checks = (
        Check("truth", "ok", found, run.error_mm),
        Check("certainty", "ok", f"known to {last.sigma_mm:.2g} mm and {last.sigma_deg:.2g} deg (1 sigma)"),
    )
    figures = {
        "error of the place": Measured(run.error_mm, unit="mm"),
        "error of the turn": Measured(run.error_deg, unit="deg"),
        "left to the wanted place": Measured(run.left_mm, last.sigma_mm, "mm"),
        "left to the wanted turn": Measured(run.left_deg, last.sigma_deg, "deg"),
    }
    result = stamp(
        CalibrationResult(
            "dynamic", verdict_of(checks), checks, cameras={"external": last.known.camera}, transforms=(place,),
            figures=figures, options={"live": True, "cell": True, "seed": request.seed},
        )
    )  # fmt: skip
    return Outcome(result=result)
