"""Calibrate two cameras that are fixed to each other: images paired, boards found in each, one problem, review."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

from calibrant.errors import RefusedError
from calibrant.tasks.cameras.pair_faults import contradicts_itself, faults_of_pairs
from calibrant.tasks.cameras.stereo_pictures import StereoPictures, pictures_of
from calibrant.tasks.inputs import session
from calibrant.tasks.inputs.bags.sharpest import refuse_beside_bag, taken_together
from calibrant.tasks.inputs.by_partner import partner_notes
from calibrant.tasks.inputs.by_side import SIDES, named_by_side, one_by_side, several_by_side
from calibrant.tasks.inputs.marked import with_pair_marks, without_marked
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.bags import BagOptions
from calibrant.tasks.options.choices import MODELS, PAIR_RULES
from calibrant.tasks.options.images import CornerOptions, PairSearchOptions, PointsOptions
from calibrant.tasks.options.option import Option
from calibrant.tasks.options.words import pixels
from calibrant.tasks.outcome import Document, Outcome

if TYPE_CHECKING:
    from calibrant.cameras import Camera
    from calibrant.data import CalibrationResult, Observations

V = TypeVar("V")
EXAMPLE = 'cb.stereo(left="photos/left*.jpg", right="photos/right*.jpg", target="chessboard:9x6:25mm")'
BESIDE = "stereo.yml"


@dataclass(frozen=True, kw_only=True)
class Request:
    """Calibrate two cameras that are fixed to each other, from images of a board that both took at once.

    calibrant stereo --left photos/left*.jpg --right photos/right*.jpg --target chessboard:9x6:25mm --out stereo.json

    Finds both lenses and how the cameras stand to each other in one problem; says how far points lie from the lines of
    their partners, what lengths on the board are measured to, and which pairs were left out and why.

    What holds for one camera has its side before it: --model left:kannala_brandt, --fix left:k3,right:focal, --camera
    right=wide.yml.
    """

    left: Annotated[tuple[str, ...], Option("IMAGES", "-l")] = ()
    """Images of the left camera, folders or patterns."""
    right: Annotated[tuple[str, ...], Option("IMAGES", "-r")] = ()
    """Images of the right camera, folders or patterns."""
    recording: BagOptions = BagOptions()
    target: Annotated[tuple[str, ...], Option("SPEC", "-t")] = ()
    """The board: chessboard:9x6:25mm (inner corners), charuco:5x7:36mm:18mm:DICT_6X6_250 (squares), or a file; for
    one camera, such as a thermal one that sees it inverted: right:SPEC."""
    points: PointsOptions = PointsOptions()
    pairs: Annotated[str, Option("RULE", choices=PAIR_RULES)] = "auto"
    """What belongs together: by name (left01 and right01, or equal names in two folders), by the time stamps in the
    names, by order; auto: the first of these that fits."""
    times: Annotated[Path | None, Option("FILE")] = None
    """CSV of when each image was taken: camera (left, right), image (or its number, frame) and time, seconds, a row
    each; the nearest within half a period belong together."""
    model: Annotated[tuple[str, ...], Option("NAME", choices=MODELS)] = ()
    """Camera model of both, brown unless given, or of one: left:kannala_brandt."""
    fix: Annotated[tuple[str, ...], Option("NAMES", names=True)] = ()
    """Hold these: fx fy cx cy k1 k2 k3 p1 p2, aspect, radial, tangential, focal, principal; of one camera: left:k3."""
    same_focal: bool = False
    """Both cameras have one focal length: fx and fy are one unknown each."""
    max_iterations: Annotated[int, Option("N")] = 100
    """Steps of each solve; a calibration that has not converged by then is refused."""
    epsilon: Annotated[str | None, Option("PX")] = None
    """Stop when a step would lower the RMS error by less than this, e.g. 1e-6px; without it, at the least error."""
    camera: Annotated[tuple[str, ...], Option("SIDE=FILE")] = ()
    """Known camera (any format), held within its uncertainty: left=left.json. Both: give the option twice."""
    initial: Annotated[tuple[str, ...], Option("SIDE=FILE")] = ()
    """Start from this camera file, and hold what --fix holds as it has it: right=right.yml."""
    mark_left: Annotated[str | None, Option("PX")] = None
    """Only mark points of the left camera with a larger error, e.g. 0.5px: --without-marked of the next run leaves
    them out."""
    mark_right: Annotated[str | None, Option("PX")] = None
    """The same for the right camera."""
    mark_epipolar: Annotated[str | None, Option("PX")] = None
    """Only mark points that lie further than this from the line of their partner, in both images."""
    without_marked: Annotated[Path | None, Option("RESULT.json")] = None
    """Leave out the points that this result of --mark-left, --mark-right or --mark-epipolar has marked."""
    search: PairSearchOptions = PairSearchOptions()
    corners: CornerOptions = CornerOptions()
    opencv_yaml: Annotated[Path | None, Option("FILE.yml", output="file")] = None
    """Write the pair in OpenCV's format here (K1 D1 K2 D2 R T E F, T in mm); with --out, without this: stereo.yml
    beside it."""


def reads(request: Request) -> list[Path]:
    """The images or the file of points, and the cameras that are given."""
    return _inputs(request, _pictures(request, SILENT))


def _inputs(request: Request, pictures: StereoPictures) -> list[Path]:
    cameras = [*_files(request.camera, "--camera").values(), *_files(request.initial, "--initial").values()]
    marks = [] if request.without_marked is None else [request.without_marked]
    return [*pictures.inputs, *cameras, *marks]


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """The pair, reviewed. Raises: InputError; RefusedError with the result that failed its checks."""
    from calibrant.data import Check
    from calibrant.data.verdicts import refuse_if_failed

    limits = {side: pixels(getattr(request, f"mark_{side}"), option=f"--mark-{side}") for side in SIDES}
    epipolar = pixels(request.mark_epipolar, option="--mark-epipolar")
    pictures = _pictures(request, listener)
    found = _unmarked(pictures.read(), request)
    session.load_solver(listener)
    with listener.status("Calibrating …"):
        result = _sound(found, request)
    more = pictures.look_again(found, result)
    if more is not found:
        with listener.status("Calibrating …"):
            result = _sound(_unmarked(more, request), request)
        result = replace(result, notes=(*result.notes, *partner_notes([more])))
    given = {side: limit for side, limit in limits.items() if limit is not None}
    if given or epipolar is not None:
        result = with_pair_marks(result, given, epipolar_px=epipolar)
    if pictures.mirrored:
        result = replace(result, options={**result.options, "mirror_x": list(pictures.mirrored)})
    if pictures.paired:
        result = replace(result, checks=(Check("pairing", "ok", pictures.paired), *result.checks))
    result = replace(result, inputs=session.file_records(_inputs(request, pictures)))
    result = session.with_misses(result)
    refuse_if_failed(result)
    return Outcome(result=result, documents=_asked_for(result, request), beside=_beside(result, request))


def _pictures(request: Request, listener: Listener) -> StereoPictures:
    request.recording.check()
    bag = None
    if request.recording.bag is not None:
        refuse_beside_bag(
            **{
                "--left": request.left,
                "--right": request.right,
                "--observations": request.points.observations,
                "--times": request.times,
            }
        )
        bag = taken_together(request.recording, names=SIDES)
    return pictures_of(
        left=request.left if bag is None else bag.files["left"],
        right=request.right if bag is None else bag.files["right"],
        recorded=None if bag is None else bag.times,
        targets=one_by_side(request.target, option="--target"),
        observations=request.points.observations,
        rule=request.pairs,
        table=request.times,
        search=request.search,
        corners=request.corners,
        listener=listener,
    )


def _unmarked(found: Observations, request: Request) -> Observations:
    """What was found, without the points that an earlier run has marked."""
    return found if request.without_marked is None else without_marked(found, request.without_marked)


def _sound(found: Observations, request: Request) -> CalibrationResult:
    """The pair, of data in which the doctor finds no fault where they contradict themselves. Raises: RefusedError."""
    from calibrant.data import CalibrationResult

    try:
        result = _calibrated(found, request)
    except RefusedError as error:
        so_far = error.result if isinstance(error.result, CalibrationResult) else None
        _refuse_faults(found, request, so_far, error)
        raise
    if contradicts_itself(result):
        _refuse_faults(found, request, result)
    return result


def _refuse_faults(
    found: Observations, request: Request, so_far: CalibrationResult | None, cause: RefusedError | None = None
) -> None:
    """Asks the doctor. Raises: RefusedError for a fault that it finds, with the result so far."""
    names = tuple(found.image_sizes)
    fault = faults_of_pairs(
        found,
        cameras=_cameras(request.camera, "--camera", found),
        model=_named(one_by_side(request.model, option="--model"), names),
        photos=request.points.observations is None,
    )
    if fault is not None:
        error = RefusedError(fault)
        error.result = so_far
        raise error from cause


def _calibrated(found: Observations, request: Request) -> CalibrationResult:
    from calibrant.calibrate.stereo.calibrate import calibrate_stereo

    names = tuple(found.image_sizes)
    model = _named(one_by_side(request.model, option="--model"), names)
    fix = _named(several_by_side(request.fix, option="--fix"), names)
    return calibrate_stereo(
        found,
        cameras=_cameras(request.camera, "--camera", found),
        initial=_cameras(request.initial, "--initial", found),
        model=_same_for_both(model, names, "brown"),
        fix=_same_for_both(fix, names, ()),
        same_focal=request.same_focal,
        max_iterations=request.max_iterations,
        epsilon_px=pixels(request.epsilon, option="--epsilon") or 0.0,
    )


def _named(values: Mapping[str, V], names: tuple[str, ...]) -> dict[str, V]:
    """Values by side as values by camera: points found before may call their cameras otherwise."""
    return {name: values[side] for side, name in zip(SIDES, names) if side in values}


def _same_for_both(values: Mapping[str, V], names: tuple[str, ...], default: V) -> V | Mapping[str, V]:
    """One value where both cameras have it."""
    every = [values.get(name, default) for name in names]
    return every[0] if all(v == every[0] for v in every) else dict(zip(names, every))


def _files(values: tuple[str, ...], option: str) -> dict[str, Path]:
    return named_by_side(values, option=option)


def _cameras(values: tuple[str, ...], option: str, found: Observations) -> dict[str, Camera]:
    from calibrant.formats.cameras.read import read_camera

    files = _named(_files(values, option), tuple(found.image_sizes))
    return {name: read_camera(file, image_size=found.image_sizes[name], name=name) for name, file in files.items()}


def _asked_for(result: CalibrationResult, request: Request) -> tuple[Document, ...]:
    """The pair in OpenCV's format where it was asked for by name."""
    if request.opencv_yaml is None:
        return ()
    return (Document(request.opencv_yaml, partial(_in_opencvs_format, result)),)


def _beside(result: CalibrationResult, request: Request) -> tuple[Document, ...]:
    """stereo.yml goes along with the result file where OpenCV has both models."""
    from calibrant.formats.cameras.opencv_stereo import is_opencvs_pair

    if request.opencv_yaml is not None or not is_opencvs_pair(result):
        return ()
    return (Document(Path(BESIDE), partial(_in_opencvs_format, result)),)


def _in_opencvs_format(result: CalibrationResult) -> bytes:
    from calibrant.formats.cameras.opencv_stereo import stereo_text

    return stereo_text(result).encode()
