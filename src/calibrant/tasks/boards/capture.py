"""Views of a board from a running camera, taken by themselves until the camera is known."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from calibrant.cancel import answered, checkpoint
from calibrant.errors import InputError, RefusedError
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.choices import MODELS
from calibrant.tasks.options.devices import CameraDeviceOptions
from calibrant.tasks.options.option import Option
from calibrant.tasks.options.words import pixels
from calibrant.tasks.outcome import Document, Outcome

if TYPE_CHECKING:
    from calibrant.data import CalibrationResult, Observations, View
    from calibrant.detection.live import Frame, Session

EXAMPLE = 'cb.capture(camera="0", target="chessboard:9x6:25mm", until="0.5px", to="photos")'

LEAST_VIEWS = 6
"""Views before the first calibration: with fewer, sigma says little."""

MOST_FOR_CORNERS = 20
"""Views after which points in every corner are no longer waited for: a large board may not get there."""

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


@dataclass(frozen=True, kw_only=True)
class Request:
    """Take views of a board from a running camera, until the camera is known well enough.

    calibrant capture --camera 0 --target chessboard:9x6:25mm --until 0.5px --to photos --out camera.json

    Takes still and sharp views by itself; says how much of X, Y, size and skew is covered, and which view is missing.
    Ctrl-C ends the taking, and what was taken is calibrated.
    """

    target: Annotated[str, Option("SPEC", "-t")]
    """The board."""
    camera: Annotated[str | None, Option("N")] = None
    """The camera's number; or a video file or folder that plays it."""
    device: CameraDeviceOptions = CameraDeviceOptions()
    to: Annotated[Path | None, Option("DIR", output="folder")] = None
    """Keep the pictures taken in this new folder."""
    until: Annotated[str, Option("SIGMA")] = "1px"
    """Stop when fx, fy, cx and cy are known to this (1 sigma), and no check asks for more views."""
    model: Annotated[str, Option("NAME", choices=MODELS)] = "brown"
    """Camera model, as of intrinsics."""


@dataclass(eq=False)
class _Taken:
    """What a session has taken so far: it grows while the camera runs."""

    views: list[View] = field(default_factory=list)
    pictures: list[Document] = field(default_factory=list)
    passed: Counter[str] = field(default_factory=Counter)
    size: tuple[int, int] = (0, 0)
    result: CalibrationResult | None = None


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """The camera, and the pictures it was found from: these are kept even where the views do not suffice.

    Raises: InputError for a camera, board or folder that cannot be used.
    """
    from calibrant.detection.live import Session
    from calibrant.targets.registry import parse_target

    goal_px = pixels(request.until, option="--until") or 1.0
    if request.to is not None and request.to.exists():
        raise InputError(f"{request.to} exists already; give the pictures a new folder")
    board = parse_target(request.target)
    taken = _Taken()
    state = start = Session(board)
    try:
        for state in _looked(_frames(request, listener), start, taken, request):
            taken.result = _so_far(taken, request)
            worst = None if taken.result is None else _worst_sigma_px(taken.result)
            wanting = "" if taken.result is None else _wanting(taken.result)
            listener.note(_line(taken.views[-1].id, len(taken.views), state, worst, wanting))
            if worst is not None and worst <= goal_px and not wanting:
                break
    except KeyboardInterrupt:  # a camera has no end of its own: this is how a person says that it is enough
        answered()
        listener.note("Stopped; calibrating from the views taken so far.")
    try:
        result = taken.result or _final(taken.views, taken.size, board.spec, request.model, state)
    except RefusedError as error:
        refused = RefusedError(f"{error}{_passed_over(taken.passed)}{_where(taken.views, request.to)}")
        refused.result = error.result
        return Outcome(documents=tuple(taken.pictures), refusal=refused)
    return Outcome(result=result, documents=tuple(taken.pictures))


def _frames(request: Request, listener: Listener) -> Iterator[Frame]:
    """Of the camera that was named in one of both ways. Raises: InputError for none or both."""
    from calibrant.detection.live import frames_from

    if (request.camera is None) == (request.device.camera_device is None):
        raise InputError("name the camera: --camera 0, or --camera-device SPEC, one of both")
    return frames_from(request.camera) if request.camera is not None else request.device.frames(listener)


def _looked(frames: Iterable[Frame], state: Session, taken: _Taken, request: Request) -> Iterator[Session]:
    """The session after every view that was worth keeping; what it shows is added to `taken`."""
    from calibrant.data import View
    from calibrant.detection.registry import detector_for

    board = state.target
    detector = detector_for(board.kind)
    row_of = {int(label): row for row, label in enumerate(board.point_ids)}
    for frame in frames:
        checkpoint()
        detection = detector.detect(frame.grey, board)
        state, reason = state.look(frame, detection)
        if reason is not None:
            taken.passed[reason] += 1
            continue
        rows = [row_of[int(label)] for label in detection.point_ids]
        taken.size = (frame.grey.shape[1], frame.grey.shape[0])
        file = None if request.to is None else request.to / Path(frame.name).with_suffix(".png")
        if file is not None:
            taken.pictures.append(Document(file, _png(frame)))
        taken.views.append(
            View(frame.name, board.points[rows], detection.uv, detection.point_ids, sigma_px=detection.sigma_px,
                 covariance_px=detection.covariance_px, file=None if file is None else str(file))
        )  # fmt: skip
        yield state


def _png(frame: Frame) -> bytes:
    """The picture, compressed at once: all are kept until the end."""
    from calibrant.opencv import cv2

    return bytes(cv2.imencode(".png", frame.grey)[1])


def _so_far(taken: _Taken, request: Request) -> CalibrationResult | None:
    """The calibration of the views taken; None with too few of them, or while they do not determine the camera."""
    from calibrant.data import Observations

    if len(taken.views) < LEAST_VIEWS:
        return None
    return _calibrated(Observations(tuple(taken.views), {"camera": taken.size}, request.target), request.model)


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


def _wanting(result: CalibrationResult) -> str:
    """What a check of the result asks for that more views give: taking ends when nothing does."""
    asked = [c for c in result.checks if c.status != "ok" and c.name in ("views", "corner-coverage")]
    if len(result.views) >= MOST_FOR_CORNERS:
        asked = [c for c in asked if c.name == "views"]
    return "; ".join(c.message for c in asked)


def _worst_sigma_px(result: CalibrationResult) -> float:
    """The largest sigma of focal lengths and principal point, px."""
    sigma = result.camera.sigma
    return max(sigma.get(name, 0.0) for name in ("fx", "fy", "cx", "cy"))


def _line(name: str, count: int, state: Session, worst: float | None, wanting: str) -> str:
    covered = "  ".join(f"{key} {100 * part:3.0f} %" for key, part in state.coverage().items())
    known = "" if worst is None else f"  camera known to {worst:.2f} px"
    missing = state.missing()
    # What the session misses is said first; when it misses nothing, what the calibration's checks ask for.
    asked = missing or wanting
    return f"{count:3d}  {name:14s} {covered}{known}{f'; next: {asked}' if asked else ''}"
