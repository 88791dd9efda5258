"""calibrant capture: views of a board from a running camera, taken by themselves until the camera is known."""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calibrant.cli import options as o
from calibrant.errors import InputError, RefusedError

if TYPE_CHECKING:
    from calibrant.data import CalibrationResult, Observations, View
    from calibrant.detection.live import Session

LEAST_VIEWS = 6
"""Views before the first calibration: with fewer, sigma says little."""

LEAST_SOLVABLE = 3
"""Views of a plane that determine a camera."""
ADVICE = {
    "no board": ("without the board", "Show the whole board, lit evenly, and check --target."),
    "moving": ("with the board moving", "Hold the board still for a moment at every place, or lay the camera down."),
    "not sharp": ("blurred", "Focus, or light the board better so that exposures are short."),
    "too few points": ("with too few points", "Show more of the board."),
    "seen before": ("like views kept before", "Move the board between views: other places, nearer, tilted."),
}
"""Reasons of `Session.look`: how many frames there were of them, in words, and what to do."""


def capture(
    camera: Annotated[
        str, typer.Option("--camera", metavar="N", help="The camera's number; or a video file or folder that plays it.")
    ],
    target: Annotated[str, typer.Option("--target", "-t", metavar="SPEC", help="The board.", show_default=False)],
    to: Annotated[
        Path | None,
        typer.Option("--to", metavar="DIR", help="Keep the pictures taken in this new folder.", show_default=False),
    ] = None,
    until: Annotated[
        str, typer.Option("--until", metavar="SIGMA", help="Stop when fx, fy, cx and cy are known to this (1 sigma).")
    ] = "1px",
    model: o.Model = "brown",
    out: o.Out = None,
    report: o.Report = None,
    json: o.Json = False,
    quiet: o.Quiet = False,
    force: o.Force = False,
    debug: o.Debug = False,
) -> None:
    """Take views of a board from a running camera, until the camera is known well enough.

    calibrant capture --camera 0 --target chessboard:9x6:25mm --until 0.5px --to photos --out camera.json

    Takes still and sharp views by itself; says how much of X, Y, size and skew is covered, and which view is missing.
    """
    from calibrant.cli import session

    outputs = session.Outputs(out=out, report=report, json=json, quiet=quiet, force=force)
    outputs.check()
    goal = o.pixels(until, option="--until")
    if to is not None and to.exists():
        raise InputError(f"{to} exists already; give the pictures a new folder")
    if to is not None and not to.parent.is_dir():
        raise InputError(f"cannot make {to}: there is no folder {to.parent}; make it first")
    session.finish(_run(camera, target, to, goal or 1.0, model, say=not (quiet or json)), outputs)


def _run(source: str, spec: str, to: Path | None, goal_px: float, model: str, *, say: bool) -> CalibrationResult:
    from calibrant.data import Observations, View
    from calibrant.detection.live import Session, frames_from
    from calibrant.detection.registry import detector_for
    from calibrant.opencv import cv2
    from calibrant.targets.registry import parse_target

    board = parse_target(spec)
    detector = detector_for(board.kind)
    row_of = {int(label): row for row, label in enumerate(board.point_ids)}
    state, views = Session(board), list[View]()
    result: CalibrationResult | None = None
    size = (0, 0)
    passed = Counter[str]()
    for frame in frames_from(source):
        detection = detector.detect(frame.grey, board)
        state, reason = state.look(frame, detection)
        if reason is not None:
            passed[reason] += 1
            continue
        rows = [row_of[int(label)] for label in detection.point_ids]
        size = (frame.grey.shape[1], frame.grey.shape[0])
        file = None if to is None else to / Path(frame.name).with_suffix(".png")
        if file is not None:
            file.parent.mkdir(exist_ok=True)
            cv2.imwrite(str(file), frame.grey)
        views.append(
            View(frame.name, board.points[rows], detection.uv, detection.point_ids, sigma_px=detection.sigma_px,
                 file=None if file is None else str(file))
        )  # fmt: skip
        observations = Observations(tuple(views), {"camera": size}, board.spec)
        result = _calibrated(observations, model) if len(views) >= LEAST_VIEWS else None
        worst = None if result is None else _worst_sigma_px(result)
        if say:
            sys.stdout.write(_line(frame.name, len(views), state, worst) + "\n")
        if worst is not None and worst <= goal_px:
            break
    if result is not None:
        return result
    try:
        return _final(views, size, board.spec, model, state)
    except RefusedError as error:
        refused = RefusedError(f"{error}{_passed_over(passed)}{_where(views, to)}")
        refused.result = error.result
        raise refused from error


def _final(views: list[View], size: tuple[int, int], spec: str, model: str, state: Session) -> CalibrationResult:
    """The calibration of all views taken. Raises: RefusedError saying which views are missing."""
    if len(views) < LEAST_SOLVABLE:
        kept = f"only {len(views)} view{'s were' if len(views) != 1 else ' was'} worth keeping"
        raise RefusedError(
            f"{kept}, a calibration needs {LEAST_SOLVABLE}; next: {state.missing() or 'take more views'}"
        )
    from calibrant.calibrate.intrinsics.calibrate import calibrate_intrinsics
    from calibrant.data import Observations

    return calibrate_intrinsics(Observations(tuple(views), {"camera": size}, spec), model=model)


def _passed_over(passed: Counter[str]) -> str:
    """Why the other frames were not kept, the most frequent first, and what to do about that."""
    if not passed:
        return ""
    counts = ", ".join(f"{count} {ADVICE[reason][0]}" for reason, count in passed.most_common())
    return f"\nnot kept: {counts}. {ADVICE[passed.most_common(1)[0][0]][1]}"


def _where(views: list[View], to: Path | None) -> str:
    if not views:
        return ""
    if to is None:
        return "\nThe pictures of the views were not kept: --to DIR keeps them."
    return (
        f"\nThe {len(views)} picture{'s' if len(views) != 1 else ''} taken so far stay in {to}; take more into another "
        "folder, and give both to calibrant intrinsics."
    )


def _calibrated(observations: Observations, model: str) -> CalibrationResult | None:
    """The calibration so far; None while the views do not determine the camera."""
    from calibrant.calibrate.intrinsics.calibrate import calibrate_intrinsics

    try:
        return calibrate_intrinsics(observations, model=model)
    except RefusedError:
        # More views are on their way; at the end the refusal is told.
        return None


def _worst_sigma_px(result: CalibrationResult) -> float:
    """The largest sigma of focal lengths and principal point, px."""
    sigma = result.camera.sigma
    return max(sigma.get(name, 0.0) for name in ("fx", "fy", "cx", "cy"))


def _line(name: str, count: int, state: Session, worst: float | None) -> str:
    covered = "  ".join(f"{key} {100 * part:3.0f} %" for key, part in state.coverage().items())
    known = "" if worst is None else f"  camera known to {worst:.2f} px"
    missing = state.missing()
    return f"{count:3d}  {name:14s} {covered}{known}{'' if missing is None else f'; next: {missing}'}"
