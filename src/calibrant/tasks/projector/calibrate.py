"""Calibrate a projector: captures decoded, boards carried into it, one problem with its camera, review."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from calibrant.errors import DetectionError, InputError, RefusedError
from calibrant.tasks.inputs import session
from calibrant.tasks.inputs.captures import capture_folders, files_of, read_captured
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.choices import MODELS
from calibrant.tasks.options.images import CornerOptions
from calibrant.tasks.options.option import Option
from calibrant.tasks.options.patterns import PatternOptions
from calibrant.tasks.options.words import split_names
from calibrant.tasks.outcome import Outcome

if TYPE_CHECKING:
    from calibrant.cameras import Camera
    from calibrant.data import CalibrationResult, Missed, Observations, View
    from calibrant.data.details_scene import ProjectorCapture
    from calibrant.detection.structured_light.boards import LitBoard
    from calibrant.detection.structured_light.capture import Capture

EXAMPLE = 'cb.projector_calibrate(captures="captures/*", projector_size="1024x768", target="chessboard:9x7:75mm")'
CAMERA, PROJECTOR = "camera", "projector"


@dataclass(frozen=True, kw_only=True)
class Request:
    """Calibrate a projector and its camera, from photos of a printed board on which the projector showed its patterns.

    calibrant projector calibrate --captures captures/* --projector-size 1024x768 --target chessboard:9x7:75mm

    A capture is a folder: the photos of all patterns, in their order, of one pose of the board. Ten poses, tilted
    differently, out to the corners of the picture. Prints the projector's and the camera's parameters, how they stand
    to each other, and what each capture was worth.
    """

    captures: Annotated[tuple[str, ...], Option("DIRS")] = ()
    """A folder of photos for each pose of the board, or one that holds these folders."""
    target: Annotated[str | None, Option("SPEC", "-t")] = None
    """The board: chessboard:9x6:25mm (inner corners), charuco:5x7:36mm:18mm:DICT_6X6_250 (squares), or a file."""
    patterns: PatternOptions = PatternOptions()
    camera: Annotated[Path | None, Option("FILE", "-c")] = None
    """Known camera (any format), held within its uncertainty; without it the captures calibrate it."""
    model: Annotated[str, Option("NAME", choices=MODELS)] = "brown"
    """Model of both lenses."""
    fix: Annotated[tuple[str, ...], Option("NAMES", names=True)] = ()
    """Hold these at 0, or at the camera's: k1 k2 k3 p1 p2, aspect, radial, tangential."""
    mirror_x: bool = False
    """The camera delivers mirror images: flip them left to right."""
    exclude: Annotated[tuple[str, ...], Option("NAMES")] = ()
    """Captures to leave out, by the folder's name."""
    cache: Annotated[str | None, Option("DIR")] = None
    """Keep what was detected in this folder (else in the user's cache folder); none: keep nothing."""
    corners: CornerOptions = CornerOptions()


def reads(request: Request) -> list[Path]:
    """The photos of all captures, and the camera."""
    files = [f for folder in _folders(request) for f in files_of(folder)]
    return [*files, *([request.camera] if request.camera is not None else [])]


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """The projector, reviewed. Raises: InputError; RefusedError with the result that failed its checks."""
    from calibrant.data.verdicts import refuse_if_failed

    sequence = request.patterns.sequence()
    folders = _folders(request)
    given = None if request.camera is None else _camera(request, folders[0])
    boards, missed = _boards(request, folders, listener)
    observations = _observations(request, boards, missed, sequence.projector_size)
    session.load_solver(listener)
    with listener.status("Calibrating …"):
        result = _calibrated(observations, request, given)
    result = _with_captures(result, boards, len(sequence.patterns), sequence.code)
    result = replace(result, inputs=session.file_records(reads(request)))
    result = session.with_misses(result)
    refuse_if_failed(result)
    return Outcome(result=result)


def seen_of(request: Request, listener: Listener = SILENT) -> Observations:
    """What the camera and the projector of a request's captures see of the board. Raises: as `run`, before it
    calibrates."""
    sequence = request.patterns.sequence()
    boards, missed = _boards(request, _folders(request), listener)
    return _observations(request, boards, missed, sequence.projector_size)


def _folders(request: Request) -> list[Path]:
    """The captures' folders, without those excluded. Raises: InputError."""
    from calibrant.targets.registry import parse_target
    from calibrant.tasks.inputs.sources import kept

    if not request.captures:
        raise InputError("--captures is missing: name a folder of photos for each pose of the board")
    if request.target is None:
        raise InputError("captures need the board they show: --target, such as chessboard:9x7:75mm")
    parse_target(request.target)
    folders = capture_folders(request.captures)
    keep = kept([f.name for f in folders], split_names(request.exclude), what="capture")
    return [f for f, k in zip(folders, keep) if k]


def _camera(request: Request, folder: Path) -> Camera:
    from calibrant.detection.images.images import load_grey
    from calibrant.formats.cameras.read import read_camera

    height, width = load_grey(files_of(folder)[0]).shape
    return read_camera(request.camera or Path(), image_size=(width, height), name=CAMERA)


def _boards(request: Request, folders: list[Path], listener: Listener) -> tuple[list[LitBoard], list[Missed]]:
    """The boards of all captures, and those that show none in the camera."""
    from calibrant.data import Missed
    from calibrant.data.file_names import distinct_names
    from calibrant.detection.structured_light.boards import check_upright, lit_board

    sequence = request.patterns.sequence()
    names = distinct_names(folders)
    boards: list[LitBoard] = []
    missed: list[Missed] = []
    sizes: dict[str, tuple[int, int]] = {}
    with listener.progress("Decoding captures") as step:
        for k, folder in enumerate(folders):
            capture = read_captured(names[folder], folder, sequence, mirror_x=request.mirror_x)
            _check_size(capture, sizes)
            seen = _seen(request, capture)
            if isinstance(seen, Missed):
                missed.append(seen)
            else:
                boards.append(lit_board(capture, seen))
            step(k + 1, len(folders), names[folder])
    check_upright(boards)
    return boards, missed


def _check_size(capture: Capture, sizes: dict[str, tuple[int, int]]) -> None:
    """Raises: InputError where captures are of several sizes. sizes: (height, width) by capture, this one's added."""
    sizes[capture.name] = height, width = capture.white.shape
    name, (h, w) = next(iter(sizes.items()))
    if (height, width) != (h, w):
        raise InputError(
            f"{capture.name} has pictures of {width}x{height} px, {name} of {w}x{h} px: one camera takes one size; "
            "calibrate those of each size apart (--exclude leaves captures out)"
        )


def _seen(request: Request, capture: Capture) -> View | Missed:
    """The board in the picture of white light."""
    from calibrant.data import Missed
    from calibrant.detection.pipeline import detect
    from calibrant.detection.subpixel.refinement import DEFAULT

    file = capture.names[capture.place("white")]
    try:
        found = detect(
            [file],
            target=request.target or "",
            mirror_x=request.mirror_x,
            workers=1,
            cache=session.cache_folder(request.cache),
            refinement=request.corners.refinement() or DEFAULT,
        )
    except DetectionError as error:
        return Missed(capture.name, f"white light: {error}", CAMERA, file)
    if not found.views:
        return Missed(capture.name, found.missed[0].reason if found.missed else "no board", CAMERA, file)
    return replace(found.views[0], id=capture.name, moment=capture.name, camera=CAMERA)


def _observations(
    request: Request, boards: list[LitBoard], missed: list[Missed], projector_size: tuple[int, int]
) -> Observations:
    """Views of camera and projector. Raises: RefusedError where no capture shows the board."""
    from calibrant.data import Missed, Observations
    from calibrant.detection.images.images import load_grey

    dark = [Missed(b.seen.id, b.reason, PROJECTOR) for b in boards if b.lit is None]
    lit = [b.lit for b in boards if b.lit is not None]
    if not lit:
        said = "; ".join(f"{m.id}: {m.reason}" for m in (*missed, *dark))
        raise RefusedError(f"no capture shows the board in the projector's light: {said}")
    height, width = load_grey(boards[0].seen.file or "").shape
    views = (*(b.seen for b in boards), *(replace(v, file=None) for v in lit))
    sizes = {CAMERA: (width, height), PROJECTOR: projector_size}
    return Observations(views, sizes, request.target, (*missed, *dark))


def _calibrated(observations: Observations, request: Request, given: Camera | None) -> CalibrationResult:
    from calibrant.calibrate.projector.calibrate import calibrate_projector

    return calibrate_projector(observations, camera=given, model=request.model, fix=split_names(request.fix))


def _with_captures(result: CalibrationResult, boards: list[LitBoard], patterns: int, code: str) -> CalibrationResult:
    """The result with what each capture was worth, and the checks of their light."""
    from calibrant.data import verdict_of
    from calibrant.data.details_scene import ProjectorCaptures
    from calibrant.detection.structured_light.light_checks import light_checks

    rms = {v.id: v.rms_px for v in result.views if v.camera == PROJECTOR and v.used}
    records = tuple(_record(b, rms.get(b.seen.id)) for b in boards)
    checks = (*result.checks, *light_checks([(b.seen.id, b.figures) for b in boards], code))
    detailed = replace(result, checks=checks, verdict=verdict_of(checks))
    return detailed.with_detail(ProjectorCaptures(code, patterns, records))


def _record(board: LitBoard, rms_px: float | None) -> ProjectorCapture:
    from calibrant.data.details_scene import ProjectorCapture

    carried = 0 if board.lit is None else len(board.lit)
    return ProjectorCapture(board.seen.id, len(board.seen), carried, **vars(board.figures), rms_px=rms_px)
