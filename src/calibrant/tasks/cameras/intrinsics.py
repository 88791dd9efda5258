"""Calibrate a camera: points, calibration, a second look at the photos with the camera known, review."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from calibrant.errors import InputError
from calibrant.tasks.inputs import session
from calibrant.tasks.inputs.bags.sharpest import only_camera
from calibrant.tasks.inputs.bags.topics import bag_files
from calibrant.tasks.inputs.marked import with_marks, without_marked
from calibrant.tasks.inputs.sources import Source
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.bags import BagOptions
from calibrant.tasks.options.cameras import LensOptions
from calibrant.tasks.options.images import CornerOptions, PhotoOptions, PointsOptions, SearchOptions
from calibrant.tasks.options.option import Option
from calibrant.tasks.options.words import pixels, split_names
from calibrant.tasks.outcome import Document, Outcome

if TYPE_CHECKING:
    from calibrant.data import CalibrationResult, Observations

EXAMPLE = 'cb.intrinsics("photos/*.jpg", target="chessboard:9x6:25mm", model="brown")'
BESIDE = "Intr.yml"


@dataclass(frozen=True, kw_only=True)
class Request:
    """Calibrate a camera from photos of a printed board.

    calibrant intrinsics photos/*.jpg --target chessboard:9x6:25mm --out camera.json --report camera.html

    Prints every parameter with its 1 and 3 sigma, each photo's error, and what was left out and why.
    """

    photos: PhotoOptions = PhotoOptions()
    recording: BagOptions = BagOptions()
    points: PointsOptions = PointsOptions()
    lens: LensOptions = LensOptions()
    initial: Annotated[Path | None, Option("FILE")] = None
    """Start from this camera file (any format)."""
    max_error: Annotated[str | None, Option("PX")] = None
    """Leave out points with a larger error, e.g. 1.0px, and calibrate again."""
    mark_outliers: Annotated[str | None, Option("PX")] = None
    """Only mark points with a larger error, e.g. 0.5px: --without-marked of the next run leaves them out."""
    without_marked: Annotated[Path | None, Option("RESULT.json")] = None
    """Leave out the points that this result of --mark-outliers has marked."""
    target_shape: Annotated[str, Option("flat|paraboloid|free")] = "flat"
    """Estimate the board's own shape with the camera: its bend, or every point."""
    shutter: Annotated[str, Option("global|rolling")] = "global"
    """Rows read all at once, or one after the other: rolling estimates each photo's motion with the camera."""
    max_iterations: Annotated[int, Option("N")] = 100
    """Steps of the solver; a calibration that has not converged by then is refused."""
    epsilon: Annotated[str | None, Option("PX")] = None
    """Stop when a step would lower the RMS error by less than this, e.g. 1e-6px; without it, at the least error."""
    name: Annotated[str, Option("NAME")] = "camera"
    """What the camera is called: its key under `cameras` in the result."""
    search: SearchOptions = SearchOptions()
    corners: CornerOptions = CornerOptions()
    opencv_yaml: Annotated[Path | None, Option("FILE.yml", output="file")] = None
    """Write the camera in OpenCV's format here; with --out, without this: Intr.yml beside it (left-Intr.yml beside
    left.json, where there is an Intr.yml already)."""


def reads(request: Request) -> list[Path]:
    """The photos or the file of points, and the camera to start from."""
    source = _source(request, SILENT)
    return _inputs(request, source, [] if request.recording.bag is not None else source.files())


def _inputs(request: Request, source: Source, files: list[Path]) -> list[Path]:
    given = (request.initial, request.without_marked)
    bag = [] if request.recording.bag is None else bag_files(request.recording.bag)
    return [*source.inputs(files), *map(Path, bag), *(file for file in given if file is not None)]


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """The camera, reviewed. Raises: InputError; RefusedError with the result that failed its checks."""
    from calibrant.data.renamed import check_camera_name, with_camera_name
    from calibrant.data.verdicts import refuse_if_failed

    check_camera_name(request.name)
    source = _source(request, listener)
    if request.recording.bag is not None:
        source = replace(source, images=only_camera(request.recording, request.photos.images))
    limit = pixels(request.max_error, option="--max-error")
    mark = pixels(request.mark_outliers, option="--mark-outliers")
    if mark is not None and request.target_shape != "flat":
        raise InputError("--mark-outliers takes the board as it is given: leave --target-shape out")
    files = source.files()
    found = _unmarked(source.read(files), request)
    session.load_solver(listener)
    with listener.status("Calibrating …"):
        result = _calibrated(found, request, limit)
    more = source.look_again(found, result.camera)
    if more is not found:
        with listener.status("Calibrating …"):
            result = _calibrated(_unmarked(more, request), request, limit)
    if mark is not None:
        result = with_marks(result, mark)
    if request.search.mirror_x:
        result = replace(result, options={**result.options, "mirror_x": True})
    result = replace(result, inputs=session.file_records(_inputs(request, source, files)))
    result = with_camera_name(session.with_misses(result), request.name)
    refuse_if_failed(result)
    return Outcome(result=result, documents=_asked_for(result, request), beside=_beside(result, request))


def _unmarked(found: Observations, request: Request) -> Observations:
    """What was found, without the points that an earlier run has marked."""
    return found if request.without_marked is None else without_marked(found, request.without_marked)


def _source(request: Request, listener: Listener) -> Source:
    request.recording.check()
    return Source.of(request.photos, request.search, listener, points=request.points, corners=request.corners)


def _calibrated(found: Observations, request: Request, limit: float | None) -> CalibrationResult:
    from calibrant.calibrate.intrinsics.calibrate import calibrate_intrinsics
    from calibrant.formats.cameras.read import read_camera

    size = next(iter(found.image_sizes.values()))
    start = None if request.initial is None else read_camera(request.initial, image_size=size)
    return calibrate_intrinsics(
        found,
        model=request.lens.model,
        fix=split_names(request.lens.fix),
        initial=start,
        max_error_px=limit,
        target_shape=request.target_shape,
        shutter=request.shutter,
        max_iterations=request.max_iterations,
        epsilon_px=pixels(request.epsilon, option="--epsilon") or 0.0,
    )


def _asked_for(result: CalibrationResult, request: Request) -> tuple[Document, ...]:
    """The camera in OpenCV's format where it was asked for by name."""
    if request.opencv_yaml is None:
        return ()
    return (Document(request.opencv_yaml, partial(_in_opencvs_format, result)),)


def _beside(result: CalibrationResult, request: Request) -> tuple[Document, ...]:
    """Intr.yml goes along with the result file where OpenCV has the model."""
    from calibrant.formats.cameras.opencv import is_opencvs

    if request.opencv_yaml is not None or not is_opencvs(result.camera):
        return ()
    return (Document(Path(BESIDE), partial(_in_opencvs_format, result)),)


def _in_opencvs_format(result: CalibrationResult) -> bytes:
    from calibrant.formats.cameras.opencv import intrinsics_text

    return intrinsics_text(result.camera, rms_px=result.rms_px).encode()
